"""What acts on a motion besides the contacts that last."""

from __future__ import annotations

from typing import Any

import mujoco

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.motion import Motion


class Smooth:
    """State and forces of a motion; MuJoCo's arrays stay where they are, and are looked up once.

    The efforts are those in the system's data: another model takes them over as a step begins, and is asked before.

    Attributes:
        motion: What moves.
    """

    def __init__(self, motion: Motion, seen: Any) -> None:
        """Find the arrays; ``seen`` is the data of the system that is logged."""
        self.motion, data = motion, motion.data
        self._qpos, self._qvel, self._ctrl = data.qpos, data.qvel, seen.ctrl
        self._own_ctrl = data.ctrl if data is not seen else None
        self._passive, self._bias, self._actuator = data.qfrc_passive, data.qfrc_bias, data.qfrc_actuator

    def state(self) -> tuple[bytes, bytes]:
        """Positions and velocities now, bit by bit."""
        return self._qpos.tobytes(), self._qvel.tobytes()

    def efforts(self) -> bytes:
        """What is held of efforts now, bit by bit."""
        efforts: bytes = self._ctrl.tobytes()
        return efforts

    def force(self, pushes: FloatArray) -> FloatArray:
        """Generalised forces less the bias, with those of whoever else pushes, (nv,); positions and velocities current."""
        if self._own_ctrl is not None:
            self._own_ctrl[:] = self._ctrl
        mujoco.mj_fwdActuation(self.motion.model, self.motion.data)
        force: FloatArray = self._passive - self._bias
        force += self._actuator
        force += pushes
        return force
