"""Thrusters in a recording: a plume while one fires, and its state on a timeline."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.drawing import Frames
from ffsm_mj.model.system import System

_LENGTH_M = 0.9


def plume_vectors(
    system: System, actuator: int, frames: Frames, efforts: FloatArray, full: float
) -> tuple[FloatArray, FloatArray]:
    """Origins and exhaust vectors of a thruster in world axes, (n, 3) each; zero vectors while it is off.

    A thruster at a site pushes along its gear in the site's frame; a motor on a slide of the base along the slide's axis,
    which stays fixed in the world.

    Args:
        system: The model.
        actuator: Id of the actuator.
        frames: Poses of the bodies.
        efforts: Applied forces, (n,), N.
        full: Force that is drawn at full length, N.
    """
    model = system.mj
    share = -_LENGTH_M * efforts[:, None] / full
    target = int(model.actuator_trnid[actuator, 0])
    if model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT:
        body = int(model.jnt_bodyid[target])
        return frames.positions[:, body], share * model.jnt_axis[target]
    body = int(model.site_bodyid[target])
    push = model.actuator_gear[actuator, :3] / np.linalg.norm(model.actuator_gear[actuator, :3])
    local = np.zeros(3)
    mujoco.mju_rotVecQuat(local, push, model.site_quat[target])
    origins = frames.positions[:, body] + _rotated(frames.quaternions[:, body], model.site_pos[target])
    return origins, share * _rotated(frames.quaternions[:, body], local)


def _rotated(quaternions: FloatArray, vector: FloatArray) -> FloatArray:
    """One vector turned by many quaternions (wxyz), (n, 3)."""
    w, v = quaternions[:, :1], quaternions[:, 1:]
    turn = 2.0 * np.cross(v, vector)
    return np.asarray(vector + w * turn + np.cross(v, turn))


class Switching:
    """Follows which way each thruster fires, through all rows."""

    def __init__(self, time: int, columns: dict[str, int]) -> None:
        """Start with everything off; column of the time, and those of the applied forces by name."""
        self._time, self._columns = time, columns
        self._last = dict.fromkeys(columns, 0)

    def changes(self, rows: FloatArray) -> list[tuple[str, FloatArray, list[str]]]:
        """(Name, times, states) of every thruster that switched in a block."""
        found: list[tuple[str, FloatArray, list[str]]] = []
        for name, column in self._columns.items():
            signs: Any = np.sign(rows[:, column]).astype(int)
            switched = np.flatnonzero(np.diff(signs, prepend=self._last[name]))
            if len(switched):
                states = [{1: "fires +", 0: "off", -1: "fires -"}[int(sign)] for sign in signs[switched]]
                found.append((name, rows[switched, self._time], states))
                self._last[name] = int(signs[-1])
        return found
