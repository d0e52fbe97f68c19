"""Impulse and work of what pushes the robot from outside over a step: thrusters at sites, motors of base joints."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.books.midpoint import hermite_midpoint
from ffsm_mj.books.simpson import simpson
from ffsm_mj.model.dynamics import base_jacobian, base_wrench
from ffsm_mj.model.system import System


class ExternalWork:
    """Integrates over each (sub-)step by Simpson's rule with a cubic Hermite midpoint; a trapezoid would leak."""

    def __init__(self, system: System, data: Any, on_joint: FloatArray) -> None:
        """Bind to what moves.

        Args:
            system: Robot and objects.
            data: Their state.
            on_joint: 1 where an actuator drives a joint, 0 elsewhere, (nu,).
        """
        self._robot, self._model, self._data = system.robot, system.mj, data
        self._scratch, self._at_site = mujoco.MjData(system.mj), 1.0 - on_joint

    def open(self) -> None:
        """Remember the state and the efforts at the start of a (sub-)step."""
        data = self._data
        self._qpos, self._qvel, self._ctrl = data.qpos.copy(), data.qvel.copy(), data.ctrl.copy()

    def close(self, duration_s: float) -> tuple[FloatArray, float]:
        """Since ``open``: impulse on the robot (P, L about the origin), (6,), and work of site actuators, J."""
        data = self._data
        q_mid, v_mid = hermite_midpoint(self._model, self._qpos, self._qvel, data.qpos, data.qvel, duration_s)
        self._scratch.ctrl[:] = self._ctrl
        start, middle, end = (
            self._rates(qpos, qvel) for qpos, qvel in ((self._qpos, self._qvel), (q_mid, v_mid), (data.qpos, data.qvel))
        )
        total = simpson(start, middle, end, duration_s)
        return total[:6], float(total[6])

    def _rates(self, qpos: FloatArray, qvel: FloatArray) -> FloatArray:
        """Wrench about the origin, and power of site actuators, at a state, (7,)."""
        model, scratch, robot = self._model, self._scratch, self._robot
        scratch.qpos[:], scratch.qvel[:] = qpos, qvel
        mujoco.mj_fwdPosition(model, scratch)
        mujoco.mj_fwdVelocity(model, scratch)
        mujoco.mj_fwdActuation(model, scratch)
        wrench = base_wrench(base_jacobian(model, scratch, robot), scratch.qfrc_actuator[robot.base_dofs])
        return np.append(wrench, (scratch.actuator_force * scratch.actuator_velocity) @ self._at_site)
