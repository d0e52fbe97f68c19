"""The joints of an object's base as they must be where its base has a given pose and motion: the way back of (17).

A free joint takes any of them. So do, within a plane or along a line, slides and then a hinge through the base's origin:
their coordinates are read off. Any others are found by Newton's method from where they were, so that no hinge jumps.
"""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.model.system import Tree

_ROUNDING = 1e-15
_MOST = 8
_TURN = 2.0 * math.pi


class Placing:
    """Writes coordinates, rates and accelerations of the base of one object.

    Attributes:
        twists: Twist of the base's frame by rate of its joints, where that never changes, (6, number of base dofs); None
            where it does.
    """

    def __init__(self, model: Any, data: Any, tree: Tree) -> None:
        """Bind to a system's model and data.

        Args:
            model: MuJoCo model of the system.
            data: Its data.
            tree: The object.
        """
        joints = [joint for joint in tree.joints if joint.body == tree.root]
        self._model, self._data, self._root, self._dofs = model, data, tree.root, tree.base_dofs
        self.free = len(joints) == 1 and joints[0].kind == "free"
        self._qpos = data.qpos[joints[0].qpos.start : joints[-1].qpos.stop]
        self._qvel = data.qvel[self._dofs]
        self._jacobian, self._rate = np.empty((6, model.nv)), np.empty((6, model.nv))
        self._step, self._turn, self._axis = np.zeros(model.nv), np.empty(3), np.empty(3)
        self.twists = None if self.free else self._constant_twists([joint.kind for joint in joints])
        self._rows: list[list[float]] = self.twists.T.tolist() if self.twists is not None else []
        self._origin = model.body_pos[tree.root].tolist()
        self._back, self._relative = model.body_quat[tree.root] * (1.0, -1.0, -1.0, -1.0), np.empty(4)
        self._zero = model.qpos0[joints[0].qpos.start : joints[-1].qpos.stop].tolist()
        self._axes = data.xmat[tree.root].reshape(3, 3)

    def _constant_twists(self, kinds: list[str]) -> FloatArray | None:
        """Orthonormal twists of slides and then at most one hinge through the origin; None of any other joints."""
        model, first = self._model, int(self._model.body_jntadr[self._root])
        slides = len(kinds) - kinds.count("hinge")
        if kinds != ["slide"] * slides + ["hinge"] * (len(kinds) - slides) or len(kinds) > slides + 1:
            return None
        turn, twists = np.empty(9), np.zeros((6, len(kinds)))
        mujoco.mju_quat2Mat(turn, model.body_quat[self._root])
        axes = model.jnt_axis[first : first + len(kinds)] @ turn.reshape(3, 3).T
        twists[:3, :slides], twists[3:, slides:] = axes[:slides].T, axes[slides:].T
        orthonormal = np.abs(twists.T @ twists - np.eye(len(kinds))).max() <= _ROUNDING
        return twists if orthonormal and not model.jnt_pos[first + slides : first + len(kinds)].any() else None

    def pose(self, position: FloatArray, quaternion: FloatArray) -> None:
        """Give the base a pose; all other coordinates are current, derived quantities need not be after.

        Args:
            position: Of its frame, world axes, m, (3,).
            quaternion: Of its frame, (4,).
        """
        if self.free:
            self._qpos[:3], self._qpos[3:] = position, quaternion
        elif self.twists is not None:
            self._read_off(position, quaternion, self._rows)
        else:
            self._search(position, quaternion)

    def _read_off(self, position: FloatArray, quaternion: FloatArray, twists: list[list[float]]) -> None:
        """Coordinates of slides and a hinge, from their own zero."""
        (x, y, z), (i, j, k) = position.tolist(), self._origin
        x, y, z = x - i, y - j, z - k
        own = [zero + a * x + b * y + c * z for zero, (a, b, c, *_) in zip(self._zero, twists, strict=True)]
        *_, a, b, c = twists[-1]
        if a or b or c:
            mujoco.mju_mulQuat(self._relative, quaternion, self._back)  # world axes
            w, x, y, z = self._relative.tolist()
            angle = self._zero[-1] + 2.0 * math.atan2(a * x + b * y + c * z, w)
            own[-1] = angle + _TURN * round((float(self._qpos[-1]) - angle) / _TURN)
        self._qpos[:] = own

    def _search(self, position: FloatArray, quaternion: FloatArray) -> None:
        """Newton's method."""
        model, data = self._model, self._data
        scale, left = 1.0 + float(np.abs(position).max()), math.inf
        for _ in range(_MOST):
            mujoco.mj_kinematics(model, data)
            mujoco.mju_subQuat(self._turn, quaternion, data.xquat[self._root])
            mujoco.mju_rotVecQuat(self._axis, self._turn, data.xquat[self._root])
            error = np.concatenate((position - data.xpos[self._root], self._axis))
            before, left = left, float(np.abs(error).max())
            if left <= _ROUNDING * scale or left > 0.5 * before:
                break
            mujoco.mj_comPos(model, data)
            self._step[self._dofs] = self._least(error)
            mujoco.mj_integratePos(model, data.qpos, self._step, 1.0)

    def rates(self, linear: FloatArray, angular: FloatArray) -> None:
        """Give the base a twist; positions are current.

        Args:
            linear: Velocity of its frame's origin, world axes, m/s, (3,).
            angular: Angular velocity, world axes, rad/s, (3,).
        """
        self._qvel[:] = self._own(linear, angular)

    def accelerations(self, linear: FloatArray, angular: FloatArray) -> None:
        """Give the base accelerations, as :meth:`rates`, in m/s^2 and rad/s^2; positions and velocities are current."""
        if not self.free:
            model, data = self._model, self._data
            mujoco.mj_jacDot(model, data, self._rate[:3], self._rate[3:], data.xpos[self._root], self._root)
            bias = self._rate @ data.qvel
            linear, angular = linear - bias[:3], angular - bias[3:]
        self._data.qacc[self._dofs] = self._own(linear, angular)

    def _own(self, linear: FloatArray, angular: FloatArray) -> FloatArray:
        """Rates of the base's joints for a twist."""
        if self.free:
            return np.concatenate((linear, angular.dot(self._axes)))
        return self._least(np.concatenate((linear, angular)))

    def _least(self, twist: FloatArray) -> FloatArray:
        """Rates of the base's joints nearest to a twist of its frame."""
        if self.twists is not None:
            return np.asarray(twist.dot(self.twists))
        mujoco.mj_jacBody(self._model, self._data, self._jacobian[:3], self._jacobian[3:], self._root)
        return np.asarray(np.linalg.lstsq(self._jacobian[:, self._dofs], twist, rcond=None)[0])
