"""Gap functions of round cores: a rim or an ellipsoid over a plane, an ellipsoid against a point, a line or an ellipsoid.

With the radii of curvature K at the extreme point along n, that point slides over its surface at K (n' - omega x n). For the
notation see :mod:`.point_line_gaps`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from ffsm_mj.contact.features.body_motion import BodyMotion, Vector, cross, dot, minus, scaled, shifted, unit
from ffsm_mj.contact.features.cores import Circle, Ellipsoid, Face, Line, Point
from ffsm_mj.contact.features.gap_function import FeatureState, GapFunction
from ffsm_mj.tolerances import NEWTON_STEP

_TURNS = 100
"""Largest number of Newton steps for the closest point."""
_SHORTEST = 2.0**-20
"""Smallest share of a Newton step that is tried while the direction is far from the normal."""


class RoundOnFace(GapFunction):
    """Gap of the extreme point of a rim or an ellipsoid over a plane."""

    def __init__(self, name: str, swapped: bool, face: Face, extreme: Circle | Ellipsoid) -> None:
        """Store the cores."""
        super().__init__(name, swapped, face.radius, extreme.radius)
        self._face, self._round = face, extreme

    def tilt(self, data: Any) -> Vector | None:
        """Tilt of a rim; None for an ellipsoid."""
        core = self._round
        if not isinstance(core, Circle):
            return None
        normal = core.body.motion(data).local(self._face.body.motion(data).turned(self._face.normal))
        return shifted(normal, -dot(normal, core.axis), core.axis)

    def rise(self, data: Any) -> float:
        """Height of the highest point of a rim above its lowest one, m; infinite for an ellipsoid."""
        tilt, core = self.tilt(data), self._round
        return 2.0 * core.size * math.hypot(*tilt) if tilt is not None and isinstance(core, Circle) else math.inf

    def tilt_rate(self, data: Any) -> Vector | None:
        """Rate of the tilt of a rim: its body sees the face turn at omega_plane - omega_round; None for an ellipsoid."""
        core = self._round
        if not isinstance(core, Circle):
            return None
        first, second = self._face.body.motion(data), core.body.motion(data)
        turning = second.local(cross(minus(first.omega, second.omega), first.turned(self._face.normal)))
        return shifted(turning, -dot(turning, core.axis), core.axis)

    def at(self, data: Any) -> FeatureState:
        """Evaluate the gap: with t = (omega_plane - omega_round) x n, gap'' contains 2 (omega_plane x n) . w - t . K t."""
        face, core = self._face, self._round
        first, second = face.body.motion(data), core.body.motion(data)
        normal = first.turned(face.normal)
        against = scaled(-1.0, normal)
        arm = core.extreme(second, against)
        point = shifted(second.origin, 1.0, arm)
        first_arm = minus(point, first.origin)
        local = first.local(first_arm)
        velocity, turning = second.velocity_at(arm), cross(first.omega, normal)
        w = minus(velocity, first.velocity_at(first_arm))
        rolling = cross(minus(first.omega, second.omega), normal)
        slide = core.extreme_rate(second, against, rolling)  # backwards: the extreme point is the one along -n
        terms = (2.0 * dot(turning, w), -dot(rolling, slide))
        gap, moving = dot(face.normal, minus(local, face.centre)), minus(velocity, slide)
        return self._state(gap, dot(normal, w), normal, turning, (point, point), moving, terms, face.inside(local))


class OnEllipsoid(GapFunction):
    """Gap of a point or a line against an ellipsoid; the closest point by Newton's method in one unknown."""

    def __init__(self, name: str, swapped: bool, ellipsoid: Ellipsoid, other: Point | Line) -> None:
        """Store the cores."""
        super().__init__(name, swapped, ellipsoid.radius, other.radius)
        self._ellipsoid, self._other = ellipsoid, other

    def at(self, data: Any) -> FeatureState:
        """Evaluate the gap: n . d = 0 along a line, and opposite contact points across it, give the rate of the normal."""
        core, other = self._ellipsoid, self._other
        first, second = core.body.motion(data), other.body.motion(data)
        arm = second.turned(other.centre)
        anchor = shifted(second.origin, 1.0, arm)
        direction = second.turned(other.direction) if isinstance(other, Line) else None
        normal = outward_normal(core, first, anchor, direction)
        foot = core.extreme(first, normal)
        on_first = shifted(first.origin, 1.0, foot)
        gap = dot(normal, minus(anchor, on_first))
        on_second = shifted(on_first, gap, normal)
        velocity = first.velocity_at(foot)
        w = minus(second.velocity_at(minus(on_second, second.origin)), velocity)
        turn = 0.0 if direction is None else dot(normal, cross(second.omega, direction))
        turning, slide = self._turning(first, normal, direction, turn, gap, w)
        terms = [dot(turning, w), -dot(normal, cross(first.omega, slide))]
        if direction is not None:
            terms.append(turn * dot(direction, shifted(minus(slide, w), gap, turning)))
        # A sharp vertex or edge in contact is at the surface, so an offset to it has no direction: the bounds are evaluated
        # with an offset along the normal, of the size of the ellipsoid.
        offset = scaled(-gap - math.sqrt(min(core.squares)), normal)
        if isinstance(other, Point):
            inside = other.inside(second, offset)
        else:
            inside = other.inside(second, minus(on_second, second.origin), offset)
        rate = dot(normal, w)
        moving = shifted(shifted(shifted(velocity, 1.0, slide), gap, turning), rate, normal)
        return self._state(gap, rate, normal, turning, (on_first, on_second), moving, terms, inside)

    def _turning(
        self, first: BodyMotion, normal: Vector, direction: Vector | None, turn: float, gap: float, w: Vector
    ) -> tuple[Vector, Vector]:
        """Rate of the normal, and velocity of the contact point over the ellipsoid."""
        core, turning_rate = self._ellipsoid, cross(first.omega, normal)
        fixed = (0.0, 0.0, 0.0) if direction is None else scaled(-turn, direction)
        one = cross(normal, direction or _across(normal))
        bent = core.extreme_rate(first, normal, one)
        stiff, right = dot(one, bent) + gap, dot(one, w) + dot(bent, minus(turning_rate, fixed))
        if direction is not None:
            turning = shifted(fixed, right / stiff, one)
        else:
            other = cross(normal, one)
            bent_other = core.extreme_rate(first, normal, other)
            stiff_other, right_other = dot(other, bent_other) + gap, dot(other, w) + dot(bent_other, turning_rate)
            mixed = dot(one, bent_other)
            whole = stiff * stiff_other - mixed * mixed
            turning = scaled((right * stiff_other - right_other * mixed) / whole, one)
            turning = shifted(turning, (right_other * stiff - right * mixed) / whole, other)
        return turning, core.extreme_rate(first, normal, minus(turning, turning_rate))


class EllipsoidOnEllipsoid(GapFunction):
    """Gap of two ellipsoids: the largest separation over all directions, found by Newton's method from the last one."""

    @dataclass
    class State(GapFunction.State):
        """The last normal too."""

        last: Vector | None

    def __init__(self, name: str, swapped: bool, first: Ellipsoid, second: Ellipsoid) -> None:
        """Store the cores."""
        super().__init__(name, swapped, first.radius, second.radius)
        self._first, self._second = first, second
        self._last: Vector | None = None

    def at(self, data: Any) -> FeatureState:
        """Evaluate the gap: opposite contact points give (K1 + K2 + gap) n' = w + K1 (omega1 x n) + K2 (omega2 x n)."""
        first, second = self._first.body.motion(data), self._second.body.motion(data)
        normal = self._last = self._normal(first, second)
        against = scaled(-1.0, normal)
        arm, other_arm = self._first.extreme(first, normal), self._second.extreme(second, against)
        on_first, on_second = shifted(first.origin, 1.0, arm), shifted(second.origin, 1.0, other_arm)
        gap = dot(normal, minus(on_second, on_first))
        velocity = second.velocity_at(other_arm)
        w = minus(velocity, first.velocity_at(arm))
        first_rate, other = cross(first.omega, normal), cross(second.omega, normal)
        right = shifted(w, 1.0, self._first.extreme_rate(first, normal, first_rate))
        right = shifted(right, 1.0, self._second.extreme_rate(second, against, other))
        turning = across_solution(partial(self._stiffness, first, second, normal, gap), normal, right)
        slide = self._first.extreme_rate(first, normal, minus(turning, first_rate))
        other_slide = self._second.extreme_rate(second, against, minus(other, turning))
        terms = (
            dot(turning, w),
            -dot(normal, cross(first.omega, slide)),
            dot(normal, cross(second.omega, other_slide)),
        )
        moving = shifted(velocity, 1.0, other_slide)
        return self._state(gap, dot(normal, w), normal, turning, (on_first, on_second), moving, terms, math.inf)

    def _normal(self, first: BodyMotion, second: BodyMotion) -> Vector:
        """Direction of largest separation.

        The separation has the gradient ``offset`` across the direction, and the Hessian -(K1 + K2 + separation).
        """
        normal = self._last or unit(minus(second.place(self._second.centre), first.place(self._first.centre)))
        offset = self._offset(first, second, normal)
        for _ in range(_TURNS):
            separation = dot(offset, normal)
            stiffness = partial(self._stiffness, first, second, normal, max(separation, 0.0))
            step = across_solution(stiffness, normal, offset)
            share = 1.0
            while True:
                turned = unit(shifted(normal, share, step))
                offset = self._offset(first, second, turned)
                share *= 0.5
                if dot(offset, turned) >= separation - NEWTON_STEP or share < _SHORTEST:
                    break
            normal = turned
            if math.hypot(*step) < NEWTON_STEP:
                break
        return normal

    def _offset(self, first: BodyMotion, second: BodyMotion, normal: Vector) -> Vector:
        """Vector from the extreme point of the first along a direction to that of the second against it."""
        on_first = shifted(first.origin, 1.0, self._first.extreme(first, normal))
        return minus(shifted(second.origin, 1.0, self._second.extreme(second, scaled(-1.0, normal))), on_first)

    def _stiffness(self, first: BodyMotion, second: BodyMotion, normal: Vector, gap: float, vector: Vector) -> Vector:
        """Product of K1 + K2 + gap and a vector across the normal."""
        bent = self._first.extreme_rate(first, normal, vector)
        bent = shifted(bent, 1.0, self._second.extreme_rate(second, scaled(-1.0, normal), vector))
        return shifted(bent, gap, vector)


def outward_normal(core: Ellipsoid, motion: BodyMotion, anchor: Vector, direction: Vector | None = None) -> Vector:
    """Outward normal of an ellipsoid towards a point, or towards a line, along which its projection is an ellipse."""
    axes = [motion.turned(axis) for axis in core.axes]
    offset = minus(anchor, shifted(motion.origin, 1.0, motion.turned(core.centre)))
    projected = list(zip(axes, core.squares, strict=True)) if direction is None else _ellipse(axes, core.squares, direction)
    places = [dot(axis, offset) for axis, _ in projected]
    root = _root([square for _, square in projected], places)
    normal = (0.0, 0.0, 0.0)
    for (axis, square), place in zip(projected, places, strict=True):
        normal = shifted(normal, place / (square + root), axis)
    return unit(normal)


def across_solution(matrix: Callable[[Vector], Vector], normal: Vector, right: Vector) -> Vector:
    """Solution across a normal of a symmetric linear system, given by products of its matrix and vectors."""
    one = _across(normal)
    other = cross(normal, one)
    of_one, of_other = matrix(one), matrix(other)
    a, b, c = dot(one, of_one), dot(one, of_other), dot(other, of_other)
    p, q = dot(one, right), dot(other, right)
    whole = a * c - b * b
    return shifted(scaled((c * p - b * q) / whole, one), (a * q - b * p) / whole, other)


def _across(vector: Vector) -> Vector:
    """A unit vector perpendicular to a unit vector."""
    x, y, z = vector
    return unit((0.0, z, -y) if abs(x) < 0.6 else (-z, 0.0, x))


def _ellipse(axes: Sequence[Vector], squares: Vector, direction: Vector) -> list[tuple[Vector, float]]:
    """Axes of the projection of an ellipsoid along a unit vector, and the squares of its semi-axes."""
    x = _across(direction)
    y = cross(direction, x)
    xx, yy, xy = (
        math.fsum(square * dot(axis, u) * dot(axis, v) for axis, square in zip(axes, squares, strict=True))
        for u, v in ((x, x), (y, y), (x, y))
    )
    mean, reach = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    long = shifted(scaled(math.cos(angle), x), math.sin(angle), y)
    return [(long, mean + reach), (cross(direction, long), mean - reach)]


def _root(squares: Sequence[float], places: Sequence[float]) -> float:
    """Root l > -min(squares) of sum of squares * places^2 / (squares + l)^2 = 1, by Newton's method.

    The sum is convex and decreasing there, so Newton's method converges.
    """
    root, least = 0.0, NEWTON_STEP * max(squares)
    for _ in range(_TURNS):
        value, slope = -1.0, 0.0
        for square, place in zip(squares, places, strict=True):
            over = 1.0 / (square + root)
            share = square * (place * over) ** 2
            value += share
            slope -= 2.0 * share * over
        before, root = root, root - value / slope
        if math.isclose(root, before, rel_tol=NEWTON_STEP, abs_tol=least):
            break
    return root
