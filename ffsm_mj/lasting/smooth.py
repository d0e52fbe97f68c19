"""What acts on a motion besides the contacts that last."""

from __future__ import annotations

import mujoco

from ffsm_mj.arrays import FloatArray
from ffsm_mj.motion.motion import Motion


class Smooth:
    """State and forces of a motion; MuJoCo's arrays stay where they are, and are looked up once.

    Attributes:
        motion: What moves.
    """

    def __init__(self, motion: Motion) -> None:
        """Find the arrays."""
        self.motion, data = motion, motion.data
        self._qpos, self._qvel, self._ctrl = data.qpos, data.qvel, data.ctrl
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
        mujoco.mj_fwdActuation(self.motion.model, self.motion.data)
        force: FloatArray = self._passive - self._bias
        force += self._actuator
        force += pushes
        return force
