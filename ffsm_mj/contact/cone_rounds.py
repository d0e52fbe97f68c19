"""Generators of a cone from which a rim or an ellipsoid inside it has a local minimum of its distance.

Along the generator at the angle phi with the inward normal n(phi), the distance is G(phi) = n . c - h(-n), with the centre c
relative to the apex and the support function h. At a local minimum the extreme point is in the meridian plane of phi. A rim
has up to two: on one side of the plane through its axis and that of the cone, and on the other.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.body_motion import Vector, cross, dot, scaled, shifted
from ffsm_mj.contact.features.cone_gaps import Cone
from ffsm_mj.state import Stateful

SLOTS = 2
"""Minima that are followed."""
_SAMPLES = 48
"""Generators at which the distance is sampled for its minima: two within 15 degrees have nearly the same normal."""
_STEPS = 60
"""Newton's steps, safeguarded by bisection, which alone takes 50."""
_LEAST_STEP = 1e-15
"""Last step of the angle, rad: rounding."""
_LEAST = 1e-300
"""Length that stands for zero where it divides."""


@dataclass(frozen=True)
class RoundCore:
    """A rim or an ellipsoid, in the axes of its geom.

    Attributes:
        centre: Centre, (3,), m.
        squares: Squares of the semi-axes, (3,), m^2: a rim is an ellipsoid without thickness.
    """

    centre: FloatArray
    squares: FloatArray


class NearestGenerators(Stateful):
    """Finds the local minima at a state, and tells by the last state which is which.

    Two pairs share it, one for each minimum: by their order alone they would change places when they are equally near.
    """

    @dataclass
    class State:
        """Angles of the minima at the last state, rad; NaN: there was none."""

        angles: FloatArray

    def __init__(self, cone: Cone, geom: int, core: RoundCore) -> None:
        """Start without minima.

        Args:
            cone: The cone.
            geom: Id of the geom of the core.
            core: Rim or ellipsoid.
        """
        self._cone, self._geom, self._core = cone, geom, core
        self._angles = np.full(SLOTS, np.nan)
        self._closed: set[int] = set()
        self._grid = 2.0 * np.pi * np.arange(_SAMPLES) / _SAMPLES
        outwards = np.array([cone.outward(angle) for angle in self._grid.tolist()])
        self._normals = cone.sine * np.array(cone.axis) - cone.cosine * outwards
        self._known: tuple[bytes, list[tuple[float, float, Vector]]] = b"", []

    def place(self, data: Any, slot: int) -> FloatArray | None:
        """Point of the core at one of the minima at the state in ``data``, in the world, (3,), m; None if there is none."""
        angles = [angle for _, angle, _ in self._at(data)]
        angle = self._angles[slot]
        return self.places(data)[angles.index(angle)] if angle in angles else None

    def places(self, data: Any) -> list[FloatArray]:
        """Points of the core at all minima, the lowest first, in the world, (3,), m."""
        body, apex = self._cone.body.id, self._cone.apex
        axes = data.xmat[body].reshape(3, 3)
        return [np.asarray(data.xpos[body] + axes @ np.add(place, apex)) for _, _, place in self._at(data)]

    def recall(self, data: Any, slot: int, point: FloatArray) -> None:
        """Give a slot the minimum that is nearest to a point in the world, at the state in ``data``."""
        places = [math.dist(place, point) for place in self.places(data)]
        if places:
            holder = int(np.flatnonzero(self._angles == self._at(data)[int(np.argmin(places))][1])[0])
            self._angles[[slot, holder]] = self._angles[[holder, slot]]

    def hold(self, slot: int, *, closed: bool) -> None:
        """Note whether persistent contact holds one of the minima."""
        (self._closed.add if closed else self._closed.discard)(slot)

    def is_closed(self, slot: int) -> bool:
        """Whether it does."""
        return slot in self._closed

    def least_elsewhere(self, data: Any) -> float:
        """Half the least distance at the state in ``data`` from generators at which a second minimum may come, m.

        Between two minima the distance has a maximum: the second is not where it is convex round the first. Half, as what
        is convex shrinks with the motion that brings the second nearer.
        """
        distances = self._distances(*self._placed(data))
        lowest = int(np.argmin(distances))
        rising = np.roll(np.roll(distances, -1) - 2.0 * distances + np.roll(distances, 1), -lowest) <= 0.0
        outside = np.roll(distances, -lowest)[int(np.argmax(rising)) : _SAMPLES - int(np.argmax(rising[::-1]))]
        return 0.5 * float(outside.min(initial=math.inf)) if rising.any() else math.inf

    def variation(self, data: Any) -> float:
        """How much the distance varies round the axis at the state in ``data``, m."""
        return float(np.ptp(self._distances(*self._placed(data))))

    def angle(self, data: Any, slot: int) -> float:
        """Angle of one of the minima at the state in ``data``, rad; NaN if there is none."""
        self._at(data)
        return float(self._angles[slot])

    def _at(self, data: Any) -> list[tuple[float, float, Vector]]:
        """Distance in m, angle in rad and point of the lowest minima, axes of the cone about its apex."""
        centre, axes = self._placed(data)
        key = centre.tobytes() + axes.tobytes()
        if key != self._known[0]:
            self._known = key, sorted(self._minima(centre, axes))[:SLOTS]
        angles = [angle for _, angle, _ in self._known[1]]
        # A state that was taken back has angles of its own.
        if not set(angles).issubset(self._angles.tolist()):
            self._assign(angles)
        return self._known[1]

    def _placed(self, data: Any) -> tuple[FloatArray, FloatArray]:
        """Centre of the core relative to the apex, m, and its axes as columns, in axes of the cone."""
        body, geom = self._cone.body.id, self._geom
        back, rotation = data.xmat[body].reshape(3, 3).T, data.geom_xmat[geom].reshape(3, 3)
        place = data.geom_xpos[geom] + rotation @ self._core.centre
        return back @ (place - data.xpos[body]) - self._cone.apex, back @ rotation

    def _distances(self, centre: FloatArray, axes: FloatArray) -> FloatArray:
        """Distances at the generators of the grid, m."""
        return np.asarray(self._normals @ centre - np.sqrt((self._normals @ axes) ** 2 @ self._core.squares))

    def _minima(self, centre: FloatArray, axes: FloatArray) -> Iterator[tuple[float, float, Vector]]:
        """Distance, angle and point of each local minimum."""
        distances = self._distances(centre, axes)
        low = (distances <= np.roll(distances, 1)) & (distances < np.roll(distances, -1))
        low[np.argmin(distances)] |= not low.any()  # level to the last bit, as a rim in its place
        middle, columns = tuple(centre.tolist()), [tuple(column) for column in axes.T.tolist()]
        for angle in self._grid[low].tolist():
            yield self._refined(middle, columns, angle)

    def _refined(self, centre: Vector, axes: list[Vector], angle: float) -> tuple[float, float, Vector]:
        """The minimum next to an angle of the grid, by Newton's method where it stays between the bounds."""
        cone, width = self._cone, 2.0 * math.pi / _SAMPLES
        low, high = angle - width, angle + width
        squares = self._core.squares.tolist()
        for _ in range(_STEPS):
            outward = cone.outward(angle)
            around, normal = cross(cone.axis, outward), shifted(scaled(cone.sine, cone.axis), -cone.cosine, outward)
            # The extreme point against the normal, and the radius of curvature there round the axis.
            along = [dot(axis, normal) for axis in axes]
            across = [dot(axis, around) for axis in axes]
            reach = max(math.sqrt(sum(square * a * a for square, a in zip(squares, along, strict=True))), _LEAST)
            place = centre
            for axis, square, a in zip(axes, squares, along, strict=True):
                place = shifted(place, -square * a / reach, axis)
            mixed = sum(square * a * b for square, a, b in zip(squares, along, across, strict=True)) / reach
            stiff = (sum(square * b * b for square, b in zip(squares, across, strict=True)) - mixed * mixed) / reach
            slope = dot(around, place)  # falls through zero at a minimum
            low, high = (angle, high) if slope > 0.0 else (low, angle)
            curved = dot(outward, place) - cone.cosine * stiff
            step = slope / curved if curved > 0.0 else math.inf
            new = angle + step if low < angle + step < high else 0.5 * (low + high)
            if abs(new - angle) <= _LEAST_STEP:
                break
            angle = new
        return dot(normal, place), angle, place

    def _assign(self, minima: list[float]) -> None:
        """Give each minimum the slot of the nearest one of the last state; others take what is left, the lowest first."""
        angles, left = np.full(SLOTS, np.nan), list(range(SLOTS))
        apart = sorted(
            (abs(math.remainder(angle - known, 2.0 * math.pi)), k, slot)
            for k, angle in enumerate(minima)
            for slot, known in enumerate(self._angles.tolist())
            if not math.isnan(known)
        )
        waiting = dict(enumerate(minima))
        for _, k, slot in apart:
            if k in waiting and slot in left:
                angles[slot] = waiting.pop(k)
                left.remove(slot)
        for angle, slot in zip(waiting.values(), left, strict=False):
            angles[slot] = angle
        self._angles[:] = angles
