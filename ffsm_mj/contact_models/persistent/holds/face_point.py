"""A point of one body over a face of another at one state, in plain floats: where it is, and the second rate of its gap."""

from __future__ import annotations

from typing import Any

from ffsm_mj.contact.features.body_motion import Vector, cross, dot, minus, scaled, shifted, turned, turned_back
from ffsm_mj.contact.features.point_line_gaps import PointOnFace
from ffsm_mj.contact_models.persistent.affine_motion import Affine, acceleration_along, velocity_along
from ffsm_mj.dynamics.body_twists import PairTwist


class FacePoint:
    """A point that is fixed to a body over a face of another one.

    Attributes:
        normal: Normal of the face from body a to b, world axes.
        turning: Its rate, 1/s.
        point: The point, m.
        arm: Its position from the centre of b, m.
    """

    normal: Vector
    turning: Vector
    point: Vector
    arm: Vector

    def __init__(self, feature: PointOnFace, data: Any, place: Vector) -> None:
        """Store the point, in axes of its body, and take views of the arrays of ``data``, which MuJoCo does not move."""
        face, first, second = feature.face, feature.face.body.id, feature.point.body.id
        self._face, self._swapped, self._place = face, feature.swapped, place
        self._sign = -1.0 if feature.swapped else 1.0
        self._normal, (self._first_radius, self._radius) = scaled(self._sign, face.normal), feature.radii
        self._level = dot(self._normal, face.centre)
        self._face_origin, self._face_axes = data.xpos[first], data.xmat[first]
        self._origin, self._axes = data.xpos[second], data.xmat[second]

    def turned(self, local: Vector) -> Vector:
        """Transform a vector from axes of the body of the point to world axes, at the current state."""
        return turned(self._now, local)

    def move_to(self, twist: PairTwist) -> None:
        """Set the attributes for the current state."""
        self._now: list[float] = self._axes.tolist()
        self._face_now: list[float] = self._face_axes.tolist()
        self.normal = turned(self._face_now, self._normal)
        self.turning = cross(twist.b.omega if self._swapped else twist.a.omega, self.normal)
        self.point = shifted(self._origin.tolist(), 1.0, turned(self._now, self._place))
        self.arm = minus(self.point, twist.b.centre)

    def second_rate(self, twist: PairTwist) -> Affine:
        """Second rate of the gap at zero joint accelerations, as a function of the arm of the point.

        It contains 2 n' times the relative velocity, as the normal is fixed to the face.
        """
        constant, (x, y, z) = acceleration_along(self.normal, twist, *twist.at_centre_of_b(self._swapped))
        bend, (u, v, w) = velocity_along(self.turning, twist)
        return constant + bend, (x + u, y + v, z + w)

    def inside(self) -> float:
        """Distance by which the point is inside the bounds of the face, m."""
        return self._face.inside(turned_back(self._face_now, minus(self.point, self._face_origin.tolist())))

    def gap(self) -> float:
        """Gap, m."""
        return self._height() - self._radius

    def beyond(self) -> float:
        """How far the contact point, midway between both surfaces, is from the point along the normal, m."""
        return self._sign * (self._first_radius - 0.5 * (self._height() + self._radius))

    def contact_point(self) -> Vector:
        """The contact point, m."""
        return shifted(self.point, self.beyond(), self.normal)

    def contact_rate(self, twist: PairTwist, gap_rate: float) -> Vector:
        """Velocity of the contact point, which moves over both surfaces, m/s."""
        omega, velocity = twist.at_centre_of_b(self._swapped)
        moved = shifted(shifted(velocity, 1.0, cross(omega, self.arm)), self.beyond(), self.turning)
        return shifted(moved, -0.5 * self._sign * gap_rate, self.normal)

    def _height(self) -> float:
        """Height of the point over the plane of the face, m."""
        return self._sign * (dot(self.normal, minus(self.point, self._face_origin.tolist())) - self._level)
