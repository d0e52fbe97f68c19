"""A single point over a face that sticks: a ball that rolls, or a corner."""

from __future__ import annotations

from typing import Any

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.body_motion import cross, dot, shifted
from ffsm_mj.contact.features.point_line_gaps import PointOnFace
from ffsm_mj.contact_models.persistent.affine_motion import velocity_along
from ffsm_mj.contact_models.persistent.holds.face_point import FacePoint
from ffsm_mj.dynamics.body_twists import PairTwist


class StuckPoint:
    """The relative velocity of the material points at the contact point is held, in world axes.

    Attributes:
        count: See :class:`~.hold.Hold`.
    """

    count = 3

    def __init__(self, feature: PointOnFace, data: Any) -> None:
        """Store the point; ``data`` is that of the logged system."""
        self._at = FacePoint(feature, data, feature.point.centre)
        self._sign = -1.0 if feature.swapped else 1.0
        self._first_radius, self._radius = feature.radii

    def begin(self, points: FloatArray) -> bool:  # noqa: ARG002
        """See :class:`~.hold.Hold`: nothing depends on the step."""
        return True

    def write(self, twist: PairTwist, rows: FloatArray, bias: FloatArray) -> None:
        """See :class:`~.hold.Hold`.

        The contact point is between both surfaces and moves over them, see ``rows.py``; along the normal, the gap is held.
        """
        at, omega = self._at, twist.omega
        at.move_to(twist)
        normal, (omega_p, velocity_p) = at.normal, at.own_motion(twist)
        level = self._sign * (self._first_radius - 0.5 * (self._sign * at.height() + self._radius))
        arm = i, j, k = shifted(at.arm, level, normal)
        rows[:] = (0.0, k, -j, 1.0, 0.0, 0.0), (-k, 0.0, i, 0.0, 1.0, 0.0), (j, -i, 0.0, 0.0, 0.0, 1.0)
        constant, gradient = velocity_along(normal, twist)
        rate = constant + dot(gradient, at.arm)
        point_rate = shifted(shifted(velocity_p, 1.0, cross(omega_p, at.arm)), level, at.turning)
        point_rate = shifted(point_rate, -0.5 * self._sign * rate, normal)
        passing = shifted(shifted(twist.acceleration, 1.0, cross(twist.alpha, arm)), 1.0, cross(omega, point_rate))
        constant, gradient = at.second_rate(twist)
        bias[:] = shifted(passing, constant + dot(gradient, at.arm) - dot(normal, passing), normal)
