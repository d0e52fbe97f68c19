"""The point of a circle that is nearest to a line, followed from one state to the next."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ffsm_mj.contact.features.body_motion import BodyMotion, Vector, cross, dot, minus, shifted, unit
from ffsm_mj.contact.features.cores import Circle
from ffsm_mj.state import Stateful
from ffsm_mj.tolerances import CROSSING, NEWTON_STEP

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
