"""Transposed Jacobian: a spring and a damper at the tip, whose wrench the generalised Jacobian takes to the joints.

u = alpha^T (-Kp e - Kd ed) - D qd. There is no inverse, so nothing grows near a dynamic singularity: there the arm merely
stops short. Without momentum and with a fixed target the energy T + e^T Kp e / 2 falls at the rate ed^T Kd ed + qd^T D qd;
with momentum the error stays bounded, but need not vanish. A redundant arm needs D > 0 to come to rest. Nothing of the
dynamics is compensated, so a moving target is followed with a lag.

Source: Papadopoulos & Dubowsky 1991, On the nature of control algorithms for free-floating space manipulators, IEEE Trans.
Robot. Autom. 7(6); Nanos & Papadopoulos 2017, Front. Robot. AI 4:26.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from ffsm_controllers.pd import Gain
from ffsm_controllers.task_space.config import AttitudeTarget, TaskLawConfig
from ffsm_controllers.task_space.damping import joint_damping
from ffsm_controllers.task_space.task_law import TaskLaw
from ffsm_mj.controller_protocol import ControllerContext, Damping, FloatArray, StrictModel


class PositionWrench(StrictModel):
    """Spring and damper on the position of the tip."""

    kp_N_m: Gain
    """Force per distance, N/m."""
    kd_N_s_m: Gain
    """Force per velocity, N s/m."""


class AttitudeWrench(AttitudeTarget):
    """Spring and damper on the attitude of the tip."""

    kp_N_m_rad: Gain
    """Torque per angle, N m/rad."""
    kd_N_m_s_rad: Gain
    """Torque per angular velocity, N m s/rad."""


class TaskTjConfig(TaskLawConfig):
    """Transposed Jacobian: spring and damper at the tip."""

    kind: Literal["task_tj"]
    position: PositionWrench
    """Spring and damper on the position."""
    attitude: AttitudeWrench | None = None
    """Spring and damper on the attitude; left out: it is not controlled."""
    joint_damping_N_m_s_rad: Gain = 0.0
    """Damping of each joint, N m s/rad."""


class TaskTj(TaskLaw):
    """Transposed Jacobian."""

    Config = TaskTjConfig

    def __init__(self, config: TaskTjConfig, context: ControllerContext) -> None:
        """Resolve joints and gains.

        Raises:
            ScenarioFaults: No task, an unknown joint, or fewer joints than components of the output.
        """
        super().__init__(config, context, config.attitude, inverts=False)
        turns = config.attitude
        self._kp = self.weighted(config.position.kp_N_m, turns.kp_N_m_rad if turns else 0.0)
        self._kd = self.weighted(config.position.kd_N_s_m, turns.kd_N_m_s_rad if turns else 0.0)
        self._damping = config.joint_damping_N_m_s_rad

    def effort(self, data: Any) -> FloatArray:  # noqa: ARG002
        """U of the law, (n,)."""
        model = self.model
        wrench = -self._kp * model.e - self._kd * model.ed
        return np.asarray(wrench.dot(model.alpha) - self._damping * model.qd)

    def damping_at(self, data: Any) -> Damping:
        """The one that comes nearest to instability: of position, attitude or joints."""
        model = self.model
        model.update(data)
        unseen = joint_damping(model, self._damping, np.eye(len(model.qd)))
        return self.least_stable(model.alpha.T, self._kd, ("position.kd_N_s_m", "attitude.kd_N_m_s_rad"), unseen)
