"""Joint limits as unilateral constraints: one end of the range of a hinge or slide joint stops the joint like a contact.

The gap is q - lower or upper - q, its rate and second rate are plus or minus those of the joint, and the constraint acts
along the row of the joint: no point, no normal and no friction. All of it is exact. The interface is that of
:class:`~ffsm_mj.contact.pairs.ContactPair`; for a hinge its lengths are angles in rad, and its forces are torques.

Limits of tendons as unilateral constraints: one end of the range of a length stops it, as a joint limit stops a joint.

The gap is l - lower or upper - l, and its row is plus or minus the gradient of the length: constant for a fixed tendon, a
function of the configuration for a spatial one, whose second rate then has a part of its own. The tendon connects links of
one tree, so that its force exchanges no momentum.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.body_motion import Vector
from ffsm_mj.contact.features.gap_function import FeatureState
from ffsm_mj.contact.motion_bound import rate_per_root_energy
from ffsm_mj.contact.proximity import FAR_M, Proximity, SecondRate
from ffsm_mj.dynamics.loops.couplings import TendonRow
from ffsm_mj.dynamics.springs import tendon_rows
from ffsm_mj.model.system import tendon_bodies, tendon_unit
from ffsm_mj.tolerances import EPSILON, RATE

Side = Literal["lower", "upper"]

MOST_TRAVEL = 0.5
"""Travel in rad or m over which a coordinate has at most one extremum in a step: longer motions are bisected."""
_NOWHERE = np.zeros(3)
_NOWHERE.flags.writeable = False


class JointLimit:
    """One end of the range of a hinge or slide joint.

    Attributes:
        name: Name for messages, unique in a run.
        rule: The same: each limit is a rule of its own.
        joint: Full name of the joint.
        side: ``lower`` or ``upper``.
        unit: Unit of the coordinate: ``rad`` for a hinge, ``m`` for a slide.
        range: Values of the coordinate at both ends, rad or m.
        limit: Value of the coordinate at this end, rad or m.
        sign: Sign of the gap rate along the joint's rate: 1 at the lower end, -1 at the upper end.
        qpos: Index of its coordinate in the logged system.
        dof: Its degree of freedom in the logged system.
        restitution: Coefficient of restitution e.
        mu: Zero: a limit has no friction.
        body_a: Id of the body that the joint is mounted on.
        body_b: Id of the body that it moves.
        geom_ids: Empty: no geoms touch.
        geom_pairs: None, either.
        position_tolerance: Zero: the gap is exact.
        size: Travel in rad or m over which the gap has at most one extremum.
        moves: Whether its row depends on the configuration: that of a joint does not.
        is_limit: True: it is no pair of geoms.
    """

    MARGIN = 1.1
    """Safety factor: the rate within a step may exceed that at its ends."""
    is_limit: Literal[True] = True
    mu = 0.0
    moves = False
    geom_ids: frozenset[int] = frozenset()
    geom_pairs: tuple[frozenset[int], ...] = ()
    position_tolerance = 0.0

    def __init__(self, model: Any, joint: int, side: Side, restitution: float) -> None:
        """Take over the range of a joint of a model.

        Args:
            model: MuJoCo model of the logged system.
            joint: Id of a limited hinge or slide joint.
            side: Which end of its range.
            restitution: Coefficient of restitution, 0 to 1.
        """
        self.range = low, high = tuple(map(float, model.jnt_range[joint]))
        self.joint, self.side, self.restitution = str(model.joint(joint).name), side, restitution
        self.name = self.rule = f"{self.joint} {side} limit"
        self.unit = "rad" if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE else "m"
        self.limit, self.sign = (low, 1.0) if side == "lower" else (high, -1.0)
        self.dof = int(model.jnt_dofadr[joint])
        self.body_b = int(model.jnt_bodyid[joint])
        self.body_a = int(model.body_parentid[self.body_b])
        self.size = min(0.5 * (high - low), MOST_TRAVEL)
        self.feature = LimitFeature(self)
        self.qpos, self._id = int(model.jnt_qposadr[joint]), joint

    def __str__(self) -> str:
        """Joint and side, for messages."""
        return self.name

    def value(self, data: Any) -> float:
        """Coordinate of the joint, rad or m."""
        return float(data.qpos[self.qpos])

    def gap(self, model: Any, data: Any, limit: float = FAR_M) -> float:  # noqa: ARG002
        """Distance of the joint from this limit, rad or m, negative beyond it; ``limit`` if it is larger."""
        return min(self.sign * (self.value(data) - self.limit), limit)

    def rate(self, data: Any) -> float:
        """Rate of the gap, rad/s or m/s."""
        return self.sign * float(data.qvel[self.dof])

    def row(self, model: Any, data: Any, dofs: Sequence[int]) -> FloatArray:  # noqa: ARG002
        """Row of the rate of the gap in the coordinates of a motion, (nv,).

        Args:
            model: Model of the motion.
            data: Its data, positions current.
            dofs: Index in it of each degree of freedom of the logged system.
        """
        row = np.zeros(model.nv)
        row[dofs[self.dof]] = self.sign
        return row

    def bend(self, data: Any) -> float:  # noqa: ARG002
        """Second rate of the gap at zero generalised acceleration: zero."""
        return 0.0

    def closing_speed_bound(self, data: Any) -> float:
        """Bound on the closing rate for the velocities in ``data``, rad/s or m/s."""
        return self.MARGIN * abs(float(data.qvel[self.dof]))

    def speed_bound_per_root_energy(self, model: Any, data: Any) -> float:
        """Bound on the closing rate over sqrt(2 T) in any configuration; infinite if there is none."""
        return rate_per_root_energy(model, data, self._id)

    def proximity(self, model: Any, data: Any) -> Proximity:  # noqa: ARG002
        """Gap and rate at the state in ``data``; normal and point are the axis and the anchor of the joint."""
        value = self.value(data)
        near = Proximity(
            gap=self.sign * (value - self.limit),
            normal=self.sign * data.xaxis[self._id],
            points=data.xanchor[self._id][None].copy(),
            rates=np.zeros(1),
            rate_tolerance=0.0,
            rounding=EPSILON * (abs(value) + abs(self.limit)) + EPSILON,
        )
        return self.at_velocities(data, near)

    def proximities(self, model: Any, data: Any) -> tuple[Proximity, ...]:
        """The same as :meth:`proximity`; as of pairs that may have several patches."""
        return (self.proximity(model, data),)

    def apart_within(self, model: Any, data: Any, reach: float) -> tuple[JointLimit, ...]:  # noqa: ARG002
        """The limit; as of pairs that may have several pieces."""
        return (self,)

    def watched_gap(self, model: Any, data: Any, limit: float) -> float:
        """The same as :meth:`gap`."""
        return self.gap(model, data, limit)

    def watched_proximity(self, model: Any, data: Any) -> Proximity:
        """The same as :meth:`proximity`."""
        return self.proximity(model, data)

    def at_velocities(self, data: Any, near: Proximity) -> Proximity:
        """The proximity with the gap rate of the velocities in ``data``, after these changed at one instant."""
        rate = self.rate(data)
        return replace(near, rates=np.array([rate]), rate_tolerance=RATE * (1.0 + abs(rate)))

    def second_rate(self, model: Any, data: Any, near: Proximity, point: FloatArray) -> SecondRate:  # noqa: ARG002
        """Second rate of the gap; accelerations in ``data`` must be current."""
        # The acceleration of the joint is a difference of terms of the size of the other accelerations.
        return SecondRate(self.sign * float(data.qacc[self.dof]), float(np.abs(data.qacc).max()), _NOWHERE)

    def is_pressed(self, model: Any, data: Any, near: Proximity) -> bool:
        """Whether the joint, at rest at this limit, begins to move beyond it under the efforts in ``data``."""
        rate = self.second_rate(model, data, near, _NOWHERE)
        return near.rate <= near.rate_tolerance and rate.value < -rate.rounding


class LimitFeature:
    """The gap of a joint limit as a contact feature of persistent contact: unbounded, and without curvature.

    Attributes:
        name: The side of the limit.
    """

    def __init__(self, limit: JointLimit) -> None:
        """Bind to a limit."""
        self._limit, self.name = limit, f"{limit.side} limit"

    @property
    def radii(self) -> tuple[float, float]:
        """Zeros: there is no core."""
        return 0.0, 0.0

    def tilt(self, data: Any) -> Vector | None:  # noqa: ARG002
        """None: there is no rim."""
        return None

    def at(self, data: Any) -> FeatureState:
        """Evaluate at the state in ``data``; normal and points are zero, as no force acts in space."""
        limit = self._limit
        gap = limit.gap(None, data, math.inf)
        rate, bend, still = limit.rate(data), limit.bend(data), (0.0, 0.0, 0.0)
        return FeatureState(gap, rate, _NOWHERE, _NOWHERE, _NOWHERE, _NOWHERE, bend, abs(bend), math.inf, still)


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
        self.tendons = np.array([limit.tendon for limit in limits if isinstance(limit, TendonLimit)], dtype=np.intp)
        self.joints = [limit for limit in limits if not isinstance(limit, TendonLimit)]
        self._qpos = np.array([limit.qpos for limit in self.joints], dtype=np.intp)

    def at(self, data: Any) -> FloatArray:
        """Values at the state in ``data``, rad or m, (n,)."""
        of_joints: FloatArray = data.qpos[self._qpos]
        return np.concatenate((of_joints, data.ten_length[self.tendons])) if len(self.tendons) else of_joints
