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
        self._place: tuple[bytes, bytes] | None = None
        self._load: tuple[bytes, bytes] | None = None
        self._state: tuple[object, object] | None = None

    def place(self) -> object:
        """Token of the current positions and velocities: the same object while they are the same bit by bit."""
        now = self._qpos.tobytes(), self._qvel.tobytes()
        if now != self._place:
            self._place = now
        return self._place

    def load(self, pushes: FloatArray) -> object:
        """The same of the current efforts and of applied forces, (nv,)."""
        now = self._ctrl.tobytes(), pushes.tobytes()
        if now != self._load:
            self._load = now
        return self._load

    def state(self, pushes: FloatArray) -> tuple[object, object]:
        """The same of both together: place and load."""
        place, load, last = self.place(), self.load(pushes), self._state
        if last is None or last[0] is not place or last[1] is not load:
            last = self._state = place, load
        return last

    def force(self, pushes: FloatArray) -> FloatArray:
        """Generalised forces less the bias, including applied forces ``pushes``, (nv,); positions and velocities current."""
        if self._own_ctrl is not None:
            self._own_ctrl[:] = self._ctrl
        mujoco.mj_fwdActuation(self.motion.model, self.motion.data)
        force: FloatArray = self._passive - self._bias
        force += self._actuator
        force += pushes
        return force
