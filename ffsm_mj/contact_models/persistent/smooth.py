"""Smooth forces on a motion: all forces except those of persistent contacts."""

from __future__ import annotations

from typing import Any

import mujoco

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.motion import Motion


class Smooth:
    """State and smooth forces of a motion; views of MuJoCo's arrays are created once, as their addresses do not change.

    The efforts are read from the data of the logged system: a motion with another model copies them only when a step begins,
    and its forces are needed before that.

    Attributes:
        motion: The motion.
    """

    def __init__(self, motion: Motion, seen: Any) -> None:
        """Create the views; ``seen`` is the data of the logged system."""
        self.motion, data = motion, motion.data
        self._qpos, self._qvel, self._ctrl = data.qpos, data.qvel, seen.ctrl
        self._own_ctrl = data.ctrl if data is not seen else None
        self._passive, self._bias, self._actuator = data.qfrc_passive, data.qfrc_bias, data.qfrc_actuator

    def state(self) -> tuple[bytes, bytes]:
        """Current positions and velocities as bytes, for exact comparison."""
        return self._qpos.tobytes(), self._qvel.tobytes()

    def efforts(self) -> bytes:
        """Current efforts as bytes, for exact comparison."""
        efforts: bytes = self._ctrl.tobytes()
        return efforts

    def force(self, pushes: FloatArray) -> FloatArray:
        """Generalised forces less the bias, including applied forces ``pushes``, (nv,); positions and velocities current."""
        if self._own_ctrl is not None:
            self._own_ctrl[:] = self._ctrl
        mujoco.mj_fwdActuation(self.motion.model, self.motion.data)
        force: FloatArray = self._passive - self._bias
        force += self._actuator
        force += pushes
        return force
