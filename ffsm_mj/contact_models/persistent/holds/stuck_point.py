"""A single point over a face that sticks: a ball that rolls, or a corner."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.body_motion import Vector, cross, dot, shifted
from ffsm_mj.contact.features.point_line_gaps import PointOnFace
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

    def begin(self, points: FloatArray) -> bool:  # noqa: ARG002
        """See :class:`~.hold.Hold`: nothing depends on the step."""
        return True

    def write(self, twist: PairTwist, rows: FloatArray, bias: FloatArray) -> None:
        """See :class:`~.hold.Hold`.

        The contact point is between both surfaces and moves over them, see ``rows.py``. Along the normal n the gap is held,
        whose second rate contains n' times the relative velocity.
        """
        at, omega = self._at, twist.omega
        at.move_to(twist)
        normal, level, (omega_p, velocity_p) = at.normal, at.beyond(), at.own_motion(twist)
        arm = i, j, k = shifted(at.arm, level, normal)
        rows[:] = (0.0, k, -j, 1.0, 0.0, 0.0), (-k, 0.0, i, 0.0, 1.0, 0.0), (j, -i, 0.0, 0.0, 0.0, 1.0)
        velocity = shifted(twist.velocity, 1.0, cross(omega, arm))
        point_rate = shifted(shifted(velocity_p, 1.0, cross(omega_p, at.arm)), level, at.turning)
        point_rate = shifted(point_rate, -0.5 * self._sign * dot(normal, velocity), normal)
        passing = shifted(shifted(twist.acceleration, 1.0, cross(twist.alpha, arm)), 1.0, cross(omega, point_rate))
        bias[:] = shifted(passing, dot(at.turning, velocity), normal)

    def forces_at(self, points: Sequence[Vector], forces: FloatArray) -> list[Vector]:  # noqa: ARG002
        """See :class:`~.hold.Hold`."""
        x, y, z = forces.tolist()
        return [(x, y, z)]
