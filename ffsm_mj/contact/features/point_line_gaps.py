"""Gap functions of points, lines, circles and planes, with their second rates in closed form.

The cores of a gap function do not change while it is in use. Let w be the velocity of the material point of the second core
relative to that of the first, n the normal from the first to the second, n' its rate, omega the angular velocity of a body,
and s the speed at which a contact point slides along a direction d fixed to its body. Then gap' = n . w and

    gap'' = n . (a_second - a_first) + n' . w + n . (omega_second x s_second d_second) - n . (omega_first x s_first d_first)

The point of a circle that is nearest to a line, followed from one state to the next.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from ffsm_mj.contact.features.body_motion import BodyMotion, Vector, cross, dot, minus, scaled, shifted, unit
from ffsm_mj.contact.features.cores import Circle, Curve, Face, Line, Point
from ffsm_mj.contact.features.gap_function import FeatureState, GapFunction
from ffsm_mj.state import Stateful
from ffsm_mj.tolerances import CROSSING, EPSILON, NEWTON_STEP

_TURNS = 30
"""Largest number of Newton steps for the angle; a few suffice from the last one."""
_LONGEST_TURN = 0.3
"""Longest Newton step, and the step away from the farthest point, rad."""


class NearestOnCircle(Stateful):
    """The point of a circle that is nearest to a line.

    A line that lies across a level cap is nearest to its rim at two points, the ends of a chord, and farthest away midway
    between them. As the chord shrinks these come together, so each end is known by the direction in which the line leaves
    the cap there.

    Attributes:
        angle: Angle of the point on the circle, rad.
        end: 1 or -1 where the line leaves a level cap along its direction or against it; 0 elsewhere.
    """

    @dataclass
    class State:
        """The point of the last state, from which the next one is found."""

        angle: float
        end: float

    def __init__(self, circle: Circle) -> None:
        """Start at angle 0."""
        self._circle = circle
        self.angle, self.end = 0.0, 0.0

    def follow(self, motion: BodyMotion, middle: Vector, d: Vector) -> tuple[Vector, Vector, Vector]:
        """Find the point at a state, from that of the last one.

        Args:
            motion: Motion of the body of the circle.
            middle: A point of the line, world axes.
            d: Unit vector along the line, world axes.

        Returns:
            Arm of the point, the tangent there, and the unit vector outwards; world axes.
        """
        circle = self._circle
        if self.end == 0.0 and not circle.bounded:
            leaves = dot(circle.at_angle(motion, self.angle)[2], d)
            self.end = math.copysign(1.0, leaves) if abs(leaves) > CROSSING else 0.0
        if self.end != 0.0:
            self.angle = self._end_of_chord(motion, middle, d)
        return self._descend(motion, middle, d)

    def chord_sine(self, motion: BodyMotion, middle: Vector, d: Vector) -> Vector | None:
        """Sine of half the angle of the chord across a level cap, as a vector; None elsewhere.

        The ends of a chord that shrinks travel at the inverse of this.
        """
        if self.end == 0.0:
            return None
        _, _, outward = self.follow(motion, middle, d)
        return (self.end * dot(outward, d), 0.0, 0.0)

    def _end_of_chord(self, motion: BodyMotion, middle: Vector, d: Vector) -> float:
        """Angle at which the projection of the line onto the plane of the circle leaves it, or comes nearest to it, rad."""
        circle = self._circle
        axis, start = motion.turned(circle.axis), motion.turned(circle.start)
        along = unit(shifted(d, -dot(d, axis), axis))
        offset = minus(middle, motion.place(circle.centre))
        across = shifted(shifted(offset, -dot(offset, axis), axis), -dot(offset, along), along)
        half = math.sqrt(max(circle.size**2 - dot(across, across), 0.0))
        outward = shifted(across, self.end * half, along)
        return math.atan2(dot(outward, cross(axis, start)), dot(outward, start))

    def _descend(self, motion: BodyMotion, middle: Vector, d: Vector) -> tuple[Vector, Vector, Vector]:
        """The point at which the tangent is perpendicular to the offset from the line, by Newton's method."""
        circle = self._circle
        for _ in range(_TURNS):
            arm, tangent, outward = circle.at_angle(motion, self.angle)
            offset = minus(minus(middle, motion.origin), arm)
            offset = shifted(offset, -dot(offset, d), d)
            slope = -circle.size * (1.0 - dot(d, tangent) ** 2) - dot(offset, outward)
            if slope < 0.0:
                step = max(-_LONGEST_TURN, min(_LONGEST_TURN, dot(offset, tangent) / slope))
            else:
                step = -math.copysign(_LONGEST_TURN, self.end * dot(tangent, d) if self.end else dot(offset, tangent))
            self.angle -= step
            if abs(step) < NEWTON_STEP:
                break
        return circle.at_angle(motion, self.angle)


class PointOnFace(GapFunction):
    """Gap of a point over a plane; both material points are at the point.

    Attributes:
        face: The face.
        point: The point.
    """

    def __init__(self, name: str, swapped: bool, face: Face, point: Point) -> None:
        """Store the cores."""
        super().__init__(name, swapped, face.radius, point.radius)
        self.face, self.point = face, point
        self._face_body, self._point_body = face.body, point.body
        self._level = dot(face.normal, face.centre)

    def at(self, data: Any) -> FeatureState:
        """Evaluate the gap: the normal is fixed to the body of the face, so n' = omega x n."""
        face, first, second = self.face, self._face_body.motion(data), self._point_body.motion(data)
        arm = second.turned(self.point.centre)
        point = shifted(second.origin, 1.0, arm)
        first_arm = minus(point, first.origin)
        local = first.local(first_arm)
        normal = first.turned(face.normal)
        velocity, turning = second.velocity_at(arm), cross(first.omega, normal)
        w = minus(velocity, first.velocity_at(first_arm))
        terms = (2.0 * dot(turning, w),)
        gap = dot(face.normal, local) - self._level
        return self._state(gap, dot(normal, w), normal, turning, (point, point), velocity, terms, face.inside(local))


class PointOnPoint(GapFunction):
    """Distance of two points."""

    def __init__(self, name: str, swapped: bool, first: Point, second: Point) -> None:
        """Store the cores."""
        super().__init__(name, swapped, first.radius, second.radius)
        self._first, self._second = first, second

    def at(self, data: Any) -> FeatureState:
        """Evaluate the gap: the line between the points turns with the part of w perpendicular to it."""
        first, second = self._first.body.motion(data), self._second.body.motion(data)
        arm, other_arm = first.turned(self._first.centre), second.turned(self._second.centre)
        on_first, on_second = shifted(first.origin, 1.0, arm), shifted(second.origin, 1.0, other_arm)
        offset = minus(on_second, on_first)
        distance = math.hypot(*offset)
        normal = unit(offset)
        velocity = second.velocity_at(other_arm)
        w = minus(velocity, first.velocity_at(arm))
        rate = dot(normal, w)
        across = shifted(w, -rate, normal)
        turning, terms = scaled(1.0 / distance, across), (dot(across, across) / distance,)
        inside = min(self._first.inside(first, offset), self._second.inside(second, minus(on_first, on_second)))
        return self._state(distance, rate, normal, turning, (on_first, on_second), velocity, terms, inside)


class PointOnCurve(GapFunction):
    """Distance of a point from a line or circle, on which its foot slides."""

    def __init__(self, name: str, swapped: bool, curve: Curve, point: Point) -> None:
        """Store the cores."""
        super().__init__(name, swapped, curve.radius, point.radius)
        self._curve, self._point = curve, point

    def at(self, data: Any) -> FeatureState:
        """Evaluate the gap: n . d = 0 and the curvature at the foot give n' . d = s (n . outward) - n . (omega x d)."""
        curve, first, second = self._curve, self._curve.body.motion(data), self._point.body.motion(data)
        arm = second.turned(self._point.centre)
        point = shifted(second.origin, 1.0, arm)
        foot, tangent, outward = curve.foot(first, minus(point, first.origin))
        on_first = shifted(first.origin, 1.0, foot)
        offset = minus(point, on_first)
        distance = math.hypot(*offset)
        normal = unit(offset)
        velocity = second.velocity_at(arm)
        w = minus(velocity, first.velocity_at(foot))
        rate, along = dot(normal, w), dot(tangent, w)
        across = shifted(shifted(w, -rate, normal), -along, tangent)
        turn, curved = dot(normal, cross(first.omega, tangent)), dot(normal, outward)
        stretch = 1.0 + distance * curved
        slide = (along + distance * turn) / stretch
        terms = (
            dot(across, across) / distance,
            along * along * curved / stretch,
            -along * turn / stretch,
            -slide * turn,
        )
        turning = shifted(scaled(1.0 / distance, across), slide * curved - turn, tangent)
        inside = min(curve.inside(first, foot, offset), self._point.inside(second, minus(on_first, point)))
        return self._state(distance, rate, normal, turning, (on_first, point), velocity, terms, inside)


class LineOnCurve(GapFunction):
    """Gap of two crossing lines, or of a line and a circle; the normal is perpendicular to both."""

    @dataclass
    class State(GapFunction.State):
        """The point of a circle too."""

        nearest: Any

    def __init__(self, name: str, swapped: bool, curve: Curve, line: Line, sense: float) -> None:
        """Store the cores; ``sense`` is the sign of the normal along (direction of the curve) x (direction of the line)."""
        super().__init__(name, swapped, curve.radius, line.radius)
        self._curve, self._line, self._sense = curve, line, sense
        self._nearest = NearestOnCircle(curve) if isinstance(curve, Circle) else None

    def tilt(self, data: Any) -> Vector | None:
        """Sine of the angle between two lines along their normal, in axes of the first; for a circle that of a chord."""
        curve, line = self._curve, self._line
        first, second = curve.body.motion(data), line.body.motion(data)
        d = second.turned(line.direction)
        if isinstance(curve, Circle):
            return self._nearest.chord_sine(first, second.place(line.centre), d) if self._nearest else None
        return cross(curve.direction, first.local(d))

    def at(self, data: Any) -> FeatureState:
        """Evaluate the gap: n . d = 0 for both directions gives n', and opposite contact points give the slides."""
        curve, line = self._curve, self._line
        first, second = curve.body.motion(data), line.body.motion(data)
        d, middle = second.turned(line.direction), shifted(second.origin, 1.0, second.turned(line.centre))
        if isinstance(curve, Line):
            arm, c, outward = first.turned(curve.centre), first.turned(curve.direction), (0.0, 0.0, 0.0)
        else:
            assert self._nearest is not None
            arm, c, outward = self._nearest.follow(first, middle, d)
            outward = scaled(1.0 / curve.size, outward)  # minus the curvature vector
        product = cross(c, d)
        # Past the end of a chord, where a trial step may go, an edge is parallel to the tangent: the bound alone counts.
        square, cosine = max(dot(product, product), EPSILON**2), dot(c, d)
        normal = scaled(self._sense / math.sqrt(square), product)
        offset = minus(middle, shifted(first.origin, 1.0, arm))
        along_c, along_d = dot(offset, c), dot(offset, d)
        sideways, length = (along_c - cosine * along_d) / square, (cosine * along_c - along_d) / square
        foot = shifted(arm, sideways, c)
        on_first, on_second = shifted(first.origin, 1.0, foot), shifted(middle, length, d)
        gap = dot(normal, minus(on_second, on_first))
        velocity = second.velocity_at(minus(on_second, second.origin))
        w = minus(velocity, first.velocity_at(foot))
        turn_c, turn_d = dot(normal, cross(first.omega, c)), dot(normal, cross(second.omega, d))
        curved = dot(normal, outward)
        drive_c, drive_d = dot(w, c) + gap * turn_c, dot(w, d) + gap * turn_d
        slide_c = (drive_c - cosine * drive_d) / (square + gap * curved)
        slide_d = cosine * slide_c - drive_d
        bound_c = turn_c - slide_c * curved
        turning_c, turning_d = cosine * turn_d - bound_c, cosine * bound_c - turn_d
        turning = shifted(scaled(turning_c / square, c), turning_d / square, d)
        terms = (
            turning_c * dot(w, c) / square,
            turning_d * dot(w, d) / square,
            slide_d * turn_d,
            -slide_c * turn_c,
        )
        inside = line.half - abs(length)
        if isinstance(curve, Line):
            inside = min(inside, curve.half - abs(sideways))
        elif curve.bounded:
            inside = min(inside, curve.inside(first, foot, scaled(curve.size, normal)))
        else:
            inside = min(inside, curve.size * (math.sqrt(square) - CROSSING))
        moving = shifted(velocity, slide_d, d)
        return self._state(gap, dot(normal, w), normal, turning, (on_first, on_second), moving, terms, inside)
