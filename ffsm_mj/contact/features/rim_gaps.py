"""Gap functions of the rim of a cap against another rim, a round side or an ellipsoid.

For the notation see :mod:`.point_line_gaps` and :mod:`.round_gaps`. A contact point that slides at the speed s along a rim
with the tangent t turns it: t' = omega x t - s / (radius of the rim) outward. With n . t = 0 this gives n' . t.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from ffsm_mj.contact.features.body_motion import BodyMotion, Vector, cross, dot, minus, scaled, shifted, unit
from ffsm_mj.contact.features.cores import Circle, Ellipsoid, Line
from ffsm_mj.contact.features.gap_function import FeatureState, GapFunction
from ffsm_mj.contact.features.point_line_gaps import NearestOnCircle
from ffsm_mj.contact.features.round_gaps import across_solution, outward_normal
from ffsm_mj.tolerances import CROSSING, NEWTON_STEP

_TURNS = 30
"""Largest number of Newton steps for the angles on the rims; a few suffice from the last ones."""


class RimOnRim(GapFunction):
    """Gap of two rims that cross; the normal is perpendicular to both tangents."""

    @dataclass
    class State(GapFunction.State):
        """Angles on both rims too, rad."""

        angles: tuple[float, float]

    def __init__(self, name: str, swapped: bool, first: Circle, second: Circle, sense: float) -> None:
        """Store the cores; ``sense`` is the sign of the normal along (tangent of the first) x (tangent of the second)."""
        super().__init__(name, swapped, first.radius, second.radius)
        self._first, self._second, self._sense = first, second, sense
        self._angles = (0.0, 0.0)

    def at(self, data: Any) -> FeatureState:
        """Evaluate the gap: n . t = 0 for both tangents gives n', and opposite contact points give the slides."""
        one, other = self._first, self._second
        first, second = one.body.motion(data), other.body.motion(data)
        self._contact(first, second)
        (arm, c, outward), (other_arm, d, other_outward) = (
            core.at_angle(motion, angle)
            for core, motion, angle in ((one, first, self._angles[0]), (other, second, self._angles[1]))
        )
        product = cross(c, d)
        square, cosine = dot(product, product), dot(c, d)
        normal = scaled(self._sense / math.sqrt(square), product)
        on_first, on_second = shifted(first.origin, 1.0, arm), shifted(second.origin, 1.0, other_arm)
        gap, velocity = dot(normal, minus(on_second, on_first)), second.velocity_at(other_arm)
        w = minus(velocity, first.velocity_at(arm))
        turn_c, turn_d = dot(normal, cross(first.omega, c)), dot(normal, cross(second.omega, d))
        curved_c, curved_d = dot(normal, outward) / one.size, dot(normal, other_outward) / other.size
        drive_c, drive_d = dot(w, c) + gap * turn_c, dot(w, d) + gap * turn_d
        stretch_c, stretch_d = 1.0 + gap * curved_c, 1.0 - gap * curved_d
        whole = stretch_c * stretch_d - cosine * cosine
        slide_c = (stretch_d * drive_c - cosine * drive_d) / whole
        slide_d = (cosine * drive_c - stretch_c * drive_d) / whole
        bound_c, bound_d = turn_c - slide_c * curved_c, turn_d - slide_d * curved_d
        turning_c, turning_d = (cosine * bound_d - bound_c) / square, (cosine * bound_c - bound_d) / square
        terms = (turning_c * dot(w, c), turning_d * dot(w, d), slide_d * turn_d, -slide_c * turn_c)
        turning = shifted(scaled(turning_c, c), turning_d, d)
        inside = min(
            one.inside(first, arm, scaled(one.size, normal)) if one.bounded else one.size * (math.sqrt(square) - CROSSING),
            other.inside(second, other_arm, scaled(-other.size, normal)) if other.bounded else math.inf,
        )
        moving = shifted(velocity, slide_d, d)
        return self._state(gap, dot(normal, w), normal, turning, (on_first, on_second), moving, terms, inside)

    def _contact(self, first: BodyMotion, second: BodyMotion) -> None:
        """Find the angles at which both tangents are perpendicular to the offset, by Newton's method from the last ones."""
        one, other = self._first, self._second
        for _ in range(_TURNS):
            angle, other_angle = self._angles
            arm, c, outward = one.at_angle(first, angle)
            other_arm, d, other_outward = other.at_angle(second, other_angle)
            offset = minus(shifted(second.origin, 1.0, other_arm), shifted(first.origin, 1.0, arm))
            cosine, p, q = dot(c, d), dot(offset, c), dot(offset, d)
            left, right = one.size + dot(offset, outward), other.size - dot(offset, other_outward)
            whole = one.size * other.size * cosine * cosine - left * right
            step = (other.size * cosine * q - right * p) / whole
            other_step = (left * q - one.size * cosine * p) / whole
            self._angles = (angle + step, other_angle + other_step)
            if abs(step) + abs(other_step) < NEWTON_STEP:
                break


class SideOnRim(GapFunction):
    """Gap of the side of a capsule or cylinder over a rim: the distance of a line from a circle.

    As the line has a radius, the normal is defined where it is parallel to the tangent of the rim, too.
    """

    @dataclass
    class State(GapFunction.State):
        """The point of the rim too."""

        nearest: Any

    def __init__(self, name: str, swapped: bool, rim: Circle, side: Line) -> None:
        """Store the cores."""
        super().__init__(name, swapped, rim.radius, side.radius)
        self._rim, self._side = rim, side
        self._nearest = NearestOnCircle(rim)

    def tilt(self, data: Any) -> Vector | None:
        """Sine of half the angle of the chord of a level cap; None elsewhere."""
        second = self._side.body.motion(data)
        middle, d = second.place(self._side.centre), second.turned(self._side.direction)
        return self._nearest.chord_sine(self._rim.body.motion(data), middle, d)

    def at(self, data: Any) -> FeatureState:
        """Evaluate the gap: n . t = 0 on the rim, n . d = 0 along the side and opposite contact points give the slides."""
        rim, side = self._rim, self._side
        first, second = rim.body.motion(data), side.body.motion(data)
        d, middle = second.turned(side.direction), second.place(side.centre)
        arm, c, outward = self._nearest.follow(first, middle, d)
        on_first = shifted(first.origin, 1.0, arm)
        length = dot(minus(on_first, middle), d)
        on_second = shifted(middle, length, d)
        offset = minus(on_second, on_first)
        distance = math.hypot(*offset)
        normal = scaled(1.0 / distance, offset)
        velocity = second.velocity_at(minus(on_second, second.origin))
        w = minus(velocity, first.velocity_at(arm))
        rate, cosine, square = dot(normal, w), dot(c, d), math.hypot(*cross(c, d)) ** 2
        turn_c, turn_d = dot(normal, cross(first.omega, c)), dot(normal, cross(second.omega, d))
        drive_c, drive_d = dot(w, c) + distance * turn_c, dot(w, d) + distance * turn_d
        slide_c = (drive_c - cosine * drive_d) / (square + distance * dot(normal, outward) / rim.size)
        slide_d = cosine * slide_c - drive_d
        moving = shifted(velocity, slide_d, d)
        parting = shifted(shifted(shifted(w, slide_d, d), -slide_c, c), -rate, normal)
        turning = scaled(1.0 / distance, parting)
        terms = (dot(turning, w), slide_d * turn_d, -slide_c * turn_c)
        inside = side.half - abs(length)
        if rim.bounded:
            inside = min(inside, rim.inside(first, arm, scaled(rim.size, normal)))
        elif self._nearest.end != 0.0:
            inside = min(inside, rim.size * (self._nearest.end * dot(outward, d) - CROSSING))
        return self._state(distance, rate, normal, turning, (on_first, on_second), moving, terms, inside)


class RimOnEllipsoid(GapFunction):
    """Gap of a rim against an ellipsoid; the nearest point of the rim by Newton's method from the last angle."""

    @dataclass
    class State(GapFunction.State):
        """Angle on the rim too, rad."""

        angle: float

    def __init__(self, name: str, swapped: bool, ellipsoid: Ellipsoid, rim: Circle) -> None:
        """Store the cores."""
        super().__init__(name, swapped, ellipsoid.radius, rim.radius)
        self._ellipsoid, self._rim = ellipsoid, rim
        self._angle = 0.0

    def at(self, data: Any) -> FeatureState:
        """Evaluate the gap.

        With a point of the rim, opposite contact points give (K + gap) n' = w + s t + K (omega x n), and n . t = 0 gives the
        slide s.
        """
        core, rim = self._ellipsoid, self._rim
        first, second = core.body.motion(data), rim.body.motion(data)
        self._contact(first, second)
        arm, tangent, outward = rim.at_angle(second, self._angle)
        on_second = shifted(second.origin, 1.0, arm)
        normal, foot, gap = self._nearest(first, on_second)
        velocity = second.velocity_at(arm)
        w = minus(velocity, first.velocity_at(foot))
        turning_rate = cross(first.omega, normal)
        driven = self._turning(first, normal, gap, shifted(w, 1.0, core.extreme_rate(first, normal, turning_rate)))
        by_slide = self._turning(first, normal, gap, tangent)
        turn, curved = dot(normal, cross(second.omega, tangent)), dot(normal, outward) / rim.size
        slide = (dot(driven, tangent) + turn) / (curved - dot(by_slide, tangent))
        turning = shifted(driven, slide, by_slide)
        foot_slide = core.extreme_rate(first, normal, minus(turning, turning_rate))
        terms = (dot(turning, w), -dot(normal, cross(first.omega, foot_slide)), slide * turn)
        # A contact point on the surface has no offset from the rim: the bounds are evaluated along the normal.
        inside = rim.inside(second, arm, scaled(-rim.size, normal))
        on_first, moving = shifted(first.origin, 1.0, foot), shifted(velocity, slide, tangent)
        return self._state(gap, dot(normal, w), normal, turning, (on_first, on_second), moving, terms, inside)

    def _contact(self, first: BodyMotion, second: BodyMotion) -> None:
        """Find the angle at which the tangent is perpendicular to the normal of the ellipsoid."""
        rim = self._rim
        for _ in range(_TURNS):
            arm, tangent, outward = rim.at_angle(second, self._angle)
            normal, _, gap = self._nearest(first, shifted(second.origin, 1.0, arm))
            turned = self._turning(first, normal, gap, tangent)
            step = dot(normal, tangent) / (rim.size * dot(turned, tangent) - dot(normal, outward))
            self._angle -= step
            if abs(step) < NEWTON_STEP:
                break

    def _nearest(self, motion: BodyMotion, place: Vector) -> tuple[Vector, Vector, float]:
        """Normal of the ellipsoid towards a place in the world, the arm of its nearest point, and the distance."""
        normal = outward_normal(self._ellipsoid, motion, place)
        foot = self._ellipsoid.extreme(motion, normal)
        return normal, foot, dot(normal, minus(minus(place, motion.origin), foot))

    def _turning(self, motion: BodyMotion, normal: Vector, gap: float, velocity: Vector) -> Vector:
        """Rate of the normal of a still ellipsoid towards a point that moves: (K + gap) n' is its velocity across n."""
        core = self._ellipsoid
        return across_solution(
            lambda vector: shifted(core.extreme_rate(motion, normal, vector), gap, vector), normal, velocity
        )


def level_crossings(one: Circle, other: Circle, data: Any) -> Iterator[tuple[Circle, Circle]]:
    """Copies of the rims of two caps that lie on each other, with angle 0 where the rims cross; none if they do not.

    Rims that nearly coincide cross nowhere: the direction from centre to centre may be rounding.
    """
    first, second = one.body.motion(data), other.body.motion(data)
    axis, centre, other_centre = first.turned(one.axis), first.place(one.centre), second.place(other.centre)
    offset = minus(other_centre, centre)
    offset = shifted(offset, -dot(offset, axis), axis)
    distance = math.hypot(*offset)
    if not abs(one.size - other.size) < distance < one.size + other.size:
        return
    # The crossings are on the line on which the powers of a point with respect to both circles are equal.
    towards = scaled(1.0 / distance, offset)
    along = 0.5 * (distance + (one.size**2 - other.size**2) / distance)
    height = math.sqrt(max(one.size**2 - along**2, 0.0))
    if height * distance <= CROSSING * one.size * other.size:  # the sine of the angle between the rims, as for caps
        return
    for side in (height, -height):
        crossing = shifted(shifted(centre, along, towards), side, cross(axis, towards))
        yield (
            replace(rim_towards(one, first, crossing), bounded=False),
            replace(rim_towards(other, second, crossing), bounded=False),
        )


def rim_towards(rim: Circle, motion: BodyMotion, place: Vector) -> Circle:
    """The rim with angle 0 towards a place in the world."""
    offset = motion.local(minus(place, motion.place(rim.centre)))
    return replace(rim, start=unit(shifted(offset, -dot(offset, rim.axis), rim.axis)))
