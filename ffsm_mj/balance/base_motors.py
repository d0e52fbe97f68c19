"""Impulse and work of external actuators other than thrusters: base joint motors, tendons, sites with a reference site.

Their wrench on the robot follows from the generalised forces on its base joints.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.midpoint import hermite_midpoint
from ffsm_mj.balance.simpson import simpson
from ffsm_mj.dynamics.rigid_body import base_jacobian, base_wrench
from ffsm_mj.model.system import System


class BaseMotors:
    """Integrates impulse and work over each (sub-)step by Simpson's rule with a cubic Hermite midpoint."""

    def __init__(
        self,
        system: System,
        data: Any,
        chosen: npt.NDArray[np.bool_],
        elsewhere: npt.NDArray[np.bool_],
        work: FloatArray,
        impulse: FloatArray,
    ) -> None:
        """Bind to the system.

        Args:
            system: Robot and objects.
            data: Their state.
            chosen: Mask of the actuators to account for, (nu,).
            elsewhere: Mask of the actuators whose work is accounted for elsewhere, (nu,).
            work: Receives the work, J, (1,).
            impulse: Receives the impulse on the robot (P, L about the world origin), (6,).
        """
        self._robot, self._model, self._data = system.robot, system.mj, data
        self._scratch, self._chosen, self._worked = mujoco.MjData(system.mj), chosen, 1.0 - elsewhere
        self._work, self._impulse = work, impulse
        self._pushing = False

    def open(self) -> None:
        """Begin a (sub-)step with the state and the efforts in ``data``."""
        data, held = self._data, np.where(self._chosen, self._data.ctrl, 0.0)
        self._pushing = bool(held.any())
        if self._pushing:
            self._qpos, self._qvel, self._scratch.ctrl[:] = data.qpos.copy(), data.qvel.copy(), held

    def close(self, duration_s: float) -> None:
        """End the step at the state in ``data``."""
        if not self._pushing:
            return
        data = self._data
        q_mid, v_mid = hermite_midpoint(self._model, self._qpos, self._qvel, data.qpos, data.qvel, duration_s)
        start, middle, end = (
            self._rates(qpos, qvel) for qpos, qvel in ((self._qpos, self._qvel), (q_mid, v_mid), (data.qpos, data.qvel))
        )
        done = simpson(start, middle, end, duration_s)
        self._impulse += done[:6]
        self._work += done[6]

    def _rates(self, qpos: FloatArray, qvel: FloatArray) -> FloatArray:
        """Wrench on the robot about the world origin, and power, at a state, (7,)."""
        model, scratch, robot = self._model, self._scratch, self._robot
        scratch.qpos[:], scratch.qvel[:] = qpos, qvel
        mujoco.mj_fwdPosition(model, scratch)
        mujoco.mj_fwdVelocity(model, scratch)
        mujoco.mj_fwdActuation(model, scratch)
        wrench = base_wrench(base_jacobian(model, scratch, robot), scratch.qfrc_actuator[robot.base_dofs])
        return np.append(wrench, (scratch.actuator_force * scratch.actuator_velocity) @ self._worked)
