"""Computed torque on the task's output: feedback linearisation in operational space.

u = alpha^T Lambda (ydd_d - Kd ed - Kp e - drift) + (1 - alpha^T Lambda B) u_0 with Lambda the inverse of
alpha M_c^-1 alpha^T, so that edd = -Kd ed - Kp e whatever base and momentum do, and u_0 = -D qd, which the output does not
feel. That needs alpha of full rank: near a dynamic singularity (Papadopoulos & Dubowsky 1993) Lambda is damped, see
:func:`~ffsm_controllers.task_space.singularity.damped_inverse`, and the output does not follow along that direction.

Source: Khatib 1987, A unified approach for motion and force control of robot manipulators, IEEE J. Robot. Autom. 3(1),
on the reduced dynamics of the free-floating robot.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from ffsm_controllers.task_space.config import AttitudeAccelerations, DampedConfig, PositionAccelerations
from ffsm_controllers.task_space.damping import joint_damping
from ffsm_controllers.task_space.singularity import damped_inverse
from ffsm_controllers.task_space.task_law import TaskLaw
from ffsm_mj.controller_protocol import ControllerContext, Damping, FloatArray


class TaskCtConfig(DampedConfig):
    """Computed torque: the error of the tip obeys edd = -kd ed - kp e."""

    kind: Literal["task_ct"]
    position: PositionAccelerations
    """Gains of the position."""
    attitude: AttitudeAccelerations | None = None
    """Gains of the attitude; left out: it is not controlled."""


class TaskCt(TaskLaw):
    """Computed torque in operational space."""

    Config = TaskCtConfig

    def __init__(self, config: TaskCtConfig, context: ControllerContext) -> None:
        """Resolve joints and gains.

        Raises:
            ScenarioFaults: No task, an unknown joint, or fewer joints than components of the output.
        """
        super().__init__(config, context, config.attitude, inverts=True)
        turns = config.attitude
        self._kp = self.weighted(config.position.kp_1_s2, turns.kp_1_s2 if turns else 0.0)
        self._kd = self.weighted(config.position.kd_1_s, turns.kd_1_s if turns else 0.0)
        self._largest, self._damping = config.singular_mass_kg, config.joint_damping_N_m_s_rad
        self.watch(self._largest)

    def effort(self, data: Any) -> FloatArray:  # noqa: ARG002
        """U of the law, (n,)."""
        model = self.model
        inertia = self.damped(model.B.dot(model.alpha.T), self._largest)
        wanted = model.target_accelerations - self._kd * model.ed - self._kp * model.e - model.drift
        damped = -self._damping * model.qd
        return np.asarray(damped + inertia.dot(wanted - model.B.dot(damped)).dot(model.alpha))

    def damping_at(self, data: Any) -> Damping:
        """The one that comes nearest to instability: of position, attitude, or what the output does not feel."""
        model = self.model
        model.update(data)
        inertia, _ = damped_inverse(model.B.dot(model.alpha.T), self._largest)
        pushes = inertia.dot(model.alpha).T
        unseen = joint_damping(model, self._damping, np.eye(len(model.qd)) - pushes.dot(model.B))
        return self.least_stable(pushes, self._kd, ("position.kd_1_s", "attitude.kd_1_s"), unseen)
