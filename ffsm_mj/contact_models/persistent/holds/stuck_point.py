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
        normal = at.normal
        arm = i, j, k = shifted(at.arm, at.beyond(), normal)
        rows[:] = (0.0, k, -j, 1.0, 0.0, 0.0), (-k, 0.0, i, 0.0, 1.0, 0.0), (j, -i, 0.0, 0.0, 0.0, 1.0)
        velocity = shifted(twist.velocity, 1.0, cross(omega, arm))
        turned = cross(omega, at.contact_rate(twist, dot(normal, velocity)))
        passing = shifted(shifted(twist.acceleration, 1.0, cross(twist.alpha, arm)), 1.0, turned)
        bias[:] = shifted(passing, dot(at.turning, velocity), normal)

    def forces_at(self, points: Sequence[Vector], forces: FloatArray) -> list[Vector]:  # noqa: ARG002
        """See :class:`~.hold.Hold`."""
        x, y, z = forces.tolist()
        return [(x, y, z)]
