"""Rotation of the base, as the driven joints cause it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.controller_protocol import FloatArray, Stateful, System
from ffsm_mj.task_model import JointModel

_TRIALS = 4


class BaseRotation(Stateful):
    """Rotation of the base about the world axes that its joints let it turn about, at the state of the last ``update``.

    Attributes:
        size: Number of these axes.
        W: Angular velocity per rate of the driven joints where there is no momentum, (size, n).
        B: Angular acceleration per effort, (size, n): W M_c^-1.
        drift: Angular acceleration where the driven joints are without effort, rad/s^2, (size,).
        rates: Angular velocity, rad/s, (size,).
        angle: Rotation vector from the attitude at the start, rad, (size,).
    """

    @dataclass
    class State:
        """Attitude at the start, a quaternion, and the angular velocity of the last update."""

        reference: FloatArray
        rates: FloatArray

    def __init__(self, system: System, joints: JointModel) -> None:
        """Bind to the base of the robot and the driven joints."""
        self._mj, self._joints, self._root = system.mj, joints, system.robot.root
        base = range(system.robot.base_dofs.start, system.robot.base_dofs.stop)
        self._jacobian, self._rate = np.empty((3, system.mj.nv)), np.empty((3, system.mj.nv))
        self._axes = self._turns(list(base))
        self.size = len(self._axes)
        self._reference, self._turn = np.array([1.0, 0.0, 0.0, 0.0]), np.empty(3)
        self.rates = np.full(self.size, math.nan)

    def _turns(self, base: list[int]) -> list[int]:
        """World axes that the base can turn about, found in a few configurations."""
        model, data = self._mj, mujoco.MjData(self._mj)
        turns = np.zeros(3)
        for k in range(1, _TRIALS + 1):
            mujoco.mj_integratePos(model, data.qpos, np.sin(k * math.e * np.arange(1.0, model.nv + 1.0)), 1.0)
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_jacBody(model, data, None, self._jacobian, self._root)
            turns = np.maximum(turns, np.abs(self._jacobian[:, base]).max(axis=1, initial=0.0))
        return [int(i) for i in np.flatnonzero(turns > 1e-9)]

    def start(self, data: Any) -> None:
        """Take the attitude as the reference."""
        self._reference = data.xquat[self._root].copy()

    def update(self, data: Any) -> None:
        """Work everything out at the state in ``data``, to which the joints' model has been brought."""
        model, joints, axes = self._mj, self._joints, self._axes
        mujoco.mj_jacBody(model, data, None, self._jacobian, self._root)
        mujoco.mj_jacDot(model, data, None, self._rate, data.xpos[self._root], self._root)
        J = self._jacobian[axes]
        self.B = J.dot(joints.mobility.T)
        self.W = self.B.dot(joints.M_c)
        self.rates = J.dot(data.qvel)
        self.drift = self._rate[axes].dot(data.qvel) + J.dot(joints.coasting)
        mujoco.mju_subQuat(self._turn, data.xquat[self._root], self._reference)
        mujoco.mju_rotVecQuat(self._turn, self._turn.copy(), self._reference)
        self.angle = self._turn[axes]
