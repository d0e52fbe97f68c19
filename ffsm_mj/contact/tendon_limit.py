"""Limits of tendons as unilateral constraints: one end of the range of a length stops it, as a joint limit stops a joint.

The gap is l - lower or upper - l, and its row is plus or minus the gradient of the length: constant for a fixed tendon, a
function of the configuration for a spatial one, whose second rate then has a part of its own. The tendon connects links of
one tree, so that its force exchanges no momentum.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.joint_limit import MOST_TRAVEL, JointLimit, LimitFeature, Side
from ffsm_mj.contact.joint_rate_bound import rate_per_root_energy
from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.contact.second_rate import SecondRate
from ffsm_mj.dynamics.loops.couplings import TendonRow
from ffsm_mj.dynamics.tendon_springs import tendon_rows
from ffsm_mj.model.system import tendon_bodies, tendon_unit
from ffsm_mj.tolerances import EPSILON

_NOWHERE = np.zeros(3)
_NOWHERE.flags.writeable = False
_JOINT = int(mujoco.mjtWrap.mjWRAP_JOINT)


class TendonLimit(JointLimit):
    """One end of the range of a tendon.

    Attributes:
        joint: Full name of the tendon.
        unit: ``rad`` for a fixed tendon of hinges alone, else ``m``.
        moves: Whether its row depends on the configuration.
        tendon: Its id in the logged system.
    """

    def __init__(self, model: Any, tendon: int, side: Side, restitution: float) -> None:
        """Take over the range of a tendon of a model.

        Args:
            model: MuJoCo model of the logged system.
            tendon: Id of a limited tendon.
            side: Which end of its range.
            restitution: Coefficient of restitution, 0 to 1.
        """
        self.range = low, high = tuple(map(float, model.tendon_range[tendon]))
        self.joint, self.side, self.restitution = str(model.tendon(tendon).name), side, restitution
        self.name = self.rule = f"{self.joint} {side} limit"
        path = range(int(model.tendon_adr[tendon]), int(model.tendon_adr[tendon] + model.tendon_num[tendon]))
        self._parts = {int(model.wrap_objid[i]): float(model.wrap_prm[i]) for i in path if model.wrap_type[i] == _JOINT}
        self.moves = not self._parts
        self.unit = tendon_unit(model, tendon)
        self.limit, self.sign = (low, 1.0) if side == "lower" else (high, -1.0)
        bodies = tendon_bodies(model, tendon)
        self.body_a, self.body_b = bodies[0], bodies[-1]
        self.dof = int(model.body_dofadr[model.body_rootid[bodies[0]]])  # one of its tree
        self.size = min(0.5 * (high - low), MOST_TRAVEL)
        self.feature = LimitFeature(self)
        self._model, self.tendon = model, tendon
        self._of_length: TendonRow | None = None

    def value(self, data: Any) -> float:
        """Length of the tendon, rad or m."""
        return float(data.ten_length[self.tendon])

    def rate(self, data: Any) -> float:
        """Rate of the gap, rad/s or m/s."""
        # Not data.ten_velocity: an impact may have changed the rates since.
        return float(self.row(self._model, data) @ data.qvel)

    def row(self, model: Any, data: Any, dofs: Sequence[int] = ()) -> FloatArray:  # noqa: ARG002
        """Row of the rate of the gap in a model that has the tendon, positions current, (nv,)."""
        return self.sign * np.asarray(tendon_rows(model, data)[model.tendon(self.joint).id])

    def bend(self, data: Any) -> float:
        """Second rate of the gap at zero generalised acceleration."""
        return self.sign * self._row_of_length(data).row()[1] if self.moves else 0.0

    def _row_of_length(self, data: Any) -> TendonRow:
        if self._of_length is None or self._of_length.data is not data:
            self._of_length = TendonRow(self._model, data, self.joint)
        return self._of_length

    def closing_speed_bound(self, data: Any) -> float:
        """Bound on the closing rate for the velocities in ``data``, rad/s or m/s."""
        return self.MARGIN * abs(self.rate(data))

    def speed_bound_per_root_energy(self, model: Any, data: Any) -> float:
        """Bound on the closing rate over sqrt(2 T) in any configuration; infinite if there is none."""
        return sum(abs(part) * rate_per_root_energy(model, data, joint) for joint, part in self._parts.items()) or math.inf

    def proximity(self, model: Any, data: Any) -> Proximity:
        """Gap and rate at the state in ``data``; the point is the frame of the last body, and there is no normal."""
        value = self.value(data)
        size = float(np.abs(tendon_rows(model, data)[self.tendon]).sum())
        near = Proximity(
            gap=self.sign * (value - self.limit),
            normal=np.zeros(3),
            points=data.xpos[self.body_b][None].copy(),
            rates=np.zeros(1),
            rate_tolerance=0.0,
            rounding=EPSILON * (abs(value) + abs(self.limit) + size) + EPSILON,
        )
        return self.at_velocities(data, near)

    def second_rate(self, model: Any, data: Any, near: Proximity, point: FloatArray) -> SecondRate:  # noqa: ARG002
        """Second rate of the gap; accelerations in ``data`` must be current.

        Not by :meth:`bend`, of which the stages of a step make use: checks of forces ask for this one.
        """
        row, bend = self.row(model, data), 0.0
        if self.moves:
            bend = self.sign * self._row_of_length(data).bend_by_differences()
        size = float(np.abs(row).sum() * np.abs(data.qacc).max()) + abs(bend)
        return SecondRate(float(row @ data.qacc) + bend, size, _NOWHERE)


class LimitCoordinates:
    """Coordinates of limits: those of joints first, then lengths of tendons."""

    def __init__(self, limits: Sequence[JointLimit]) -> None:
        """Look up their places."""
        self.tendons = np.array([each.tendon for each in limits if isinstance(each, TendonLimit)], dtype=np.intp)
        self.joints = [each for each in limits if not isinstance(each, TendonLimit)]
        self._qpos = np.array([each.qpos for each in self.joints], dtype=np.intp)

    def at(self, data: Any) -> FloatArray:
        """Values at the state in ``data``, rad or m, (n,)."""
        of_joints: FloatArray = data.qpos[self._qpos]
        return np.concatenate((of_joints, data.ten_length[self.tendons])) if len(self.tendons) else of_joints
