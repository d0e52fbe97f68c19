"""Inverse kinematics of an object's base joints: coordinates and rates for a given pose and twist of the base, (17).

A free joint takes any pose. Slides followed by a hinge through the base's origin take those of a plane or line, and have a
closed form. Other joints are solved by Newton's method from their last coordinates, so that hinge angles stay continuous.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray, numbers
from ffsm_mj.model.system import Joint, Tree

_ROUNDING = 1e-15
_MAX_ITERATIONS = 8
_TWO_PI = 2.0 * math.pi


@dataclass(frozen=True)
class PoseReader:
    """Closed form of the coordinates of slides, and of a hinge after them, as functions of a pose.

    Attributes:
        slides: For each slide, its coordinate at the world origin in m, and its axis in world axes, (number of slides, 4).
        axis: Axis of the hinge, world axes, (3,); None if there is no hinge.
        zero: Angle of the hinge where sine is 0 and cosine is 1, rad.
        sine: Coefficients of the sine of half the hinge angle as a linear function of the quaternion, (4,).
        cosine: Coefficients of its cosine, (4,).
    """

    slides: FloatArray
    axis: FloatArray | None
    zero: float
    sine: FloatArray
    cosine: FloatArray

    @classmethod
    def of(cls, model: Any, root: int, joints: list[Joint]) -> PoseReader | None:
        """Closed form for the joints of a base; None unless their axes are orthonormal and the hinge is at its origin."""
        kinds, first = [joint.kind for joint in joints], int(model.body_jntadr[root])
        slides = len(kinds) - kinds.count("hinge")
        if kinds != ["slide"] * slides + ["hinge"] * (len(kinds) - slides) or len(kinds) > slides + 1:
            return None
        turn, own = np.empty(9), model.body_quat[root]
        mujoco.mju_quat2Mat(turn, own)
        axes = model.jnt_axis[first : first + len(kinds)] @ turn.reshape(3, 3).T
        along, hinge = axes[:slides], axes[slides:]
        zeros = np.array([model.qpos0[joint.qpos.start] for joint in joints])
        unlike = [np.abs(one @ one.T - np.eye(len(one))).max(initial=0.0) for one in (along, hinge)]
        if max(unlike) > _ROUNDING or model.jnt_pos[first + slides : first + len(kinds)].any():
            return None
        rows = np.column_stack((zeros[:slides] - along @ model.body_pos[root], along))
        if not len(hinge):
            return cls(rows, None, 0.0, np.zeros(4), np.zeros(4))
        relative = np.empty((4, 4))  # of each unit quaternion the one that is left of it, in world axes
        for unit, left in zip(np.eye(4), relative, strict=True):
            mujoco.mju_mulQuat(left, unit, own * (1.0, -1.0, -1.0, -1.0))
        return cls(rows, hinge[0], float(zeros[-1]), relative[:, 1:] @ hinge[0], relative[:, 0].copy())


class BaseJointSolver:
    """Writes coordinates, rates and accelerations of the base joints of one object.

    Attributes:
        free: Whether its only joint is a free joint.
        reading: Closed form for its joints; None if there is none.
        base: Its coordinates, its rates, and the axes of its frame row by row: live arrays.
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
        self.reading = None if self.free else PoseReader.of(model, tree.root, joints)
        qpos = data.qpos[joints[0].qpos.start : joints[-1].qpos.stop]
        self.base: tuple[FloatArray, FloatArray, FloatArray] = qpos, data.qvel[self._dofs], data.xmat[tree.root]
        self._qpos, self._qvel, self._axes = map(numbers, self.base)
        self._qacc = numbers(data.qacc[self._dofs])
        self._jacobian, self._rate = np.empty((6, model.nv)), np.empty((6, model.nv))
        self._step, self._turn, self._axis = np.zeros(model.nv), np.empty(3), np.empty(3)
        if (read := self.reading) is not None:
            self._slides: list[list[float]] = read.slides.tolist()
            own = None if read.axis is None else (read.axis.tolist(), read.zero, read.sine.tolist(), read.cosine.tolist())
            self._hinge: tuple[list[float], float, list[float], list[float]] | None = own

    def pose(self, position: FloatArray, quaternion: FloatArray) -> None:
        """Write the coordinates for a pose of the base; other coordinates must be current, derived quantities may be stale.

        Args:
            position: Position of its frame, world axes, m, (3,).
            quaternion: Orientation of its frame, (4,).
        """
        if self.free:
            self._qpos[:3], self._qpos[3:] = position.data, quaternion.data
        elif self.reading is not None:
            self._write_coordinates(position, quaternion)
        else:
            self._solve(position, quaternion)

    def _write_coordinates(self, position: FloatArray, quaternion: FloatArray) -> None:
        """Write the coordinates of slides and a hinge, in closed form."""
        x, y, z = position.tolist()
        for i, (o, a, b, c) in enumerate(self._slides):
            self._qpos[i] = o + a * x + b * y + c * z
        if self._hinge is not None:
            _, zero, (a, b, c, d), (p, q, r, s) = self._hinge
            w, x, y, z = quaternion.tolist()
            angle = zero + 2.0 * math.atan2(a * w + b * x + c * y + d * z, p * w + q * x + r * y + s * z)
            # Keep the turn of the last angle: a hinge coordinate counts full turns, a quaternion does not.
            self._qpos[-1] = angle + _TWO_PI * round((self._qpos[-1] - angle) / _TWO_PI)

    def _solve(self, position: FloatArray, quaternion: FloatArray) -> None:
        """Solve for the coordinates by Newton's method."""
        model, data = self._model, self._data
        scale, left = 1.0 + float(np.abs(position).max()), math.inf
        for _ in range(_MAX_ITERATIONS):
            mujoco.mj_kinematics(model, data)
            mujoco.mju_subQuat(self._turn, quaternion, data.xquat[self._root])
            mujoco.mju_rotVecQuat(self._axis, self._turn, data.xquat[self._root])
            error = np.concatenate((self._axis, position - data.xpos[self._root]))
            before, left = left, float(np.abs(error).max())
            # Quadratic convergence has ended, at rounding or because the joints cannot take the pose.
            if left <= _ROUNDING * scale or left > 0.5 * before:
                break
            mujoco.mj_comPos(model, data)
            self._step[self._dofs] = self._nearest_rates(error)
            mujoco.mj_integratePos(model, data.qpos, self._step, 1.0)

    def rates(self, twist: FloatArray) -> None:
        """Write the rates for a twist of the base; positions must be current.

        Args:
            twist: Angular velocity in rad/s, then velocity of its frame's origin in m/s, world axes, (6,).
        """
        self._write(twist, self._qvel)

    def accelerations(self, twist: FloatArray) -> None:
        """Write the accelerations, as :meth:`rates`, in rad/s^2 and m/s^2; positions and velocities must be current."""
        if not self.free and self.reading is None:
            model, data = self._model, self._data
            mujoco.mj_jacDot(model, data, self._rate[3:], self._rate[:3], data.xpos[self._root], self._root)
            twist = twist - self._rate @ data.qvel
        self._write(twist, self._qacc)

    def _write(self, twist: FloatArray, own: memoryview[float]) -> None:
        """Write rates of the base joints for a twist of its frame."""
        if not self.free and self.reading is None:
            own[:] = self._nearest_rates(twist).data
            return
        p, q, r, x, y, z = twist.tolist()
        if self.free:
            a, b, c, d, e, f, g, h, i = self._axes
            own[0], own[1], own[2] = x, y, z
            own[3], own[4], own[5] = a * p + d * q + g * r, b * p + e * q + h * r, c * p + f * q + i * r
            return
        for k, (_, a, b, c) in enumerate(self._slides):
            own[k] = a * x + b * y + c * z
        if self._hinge is not None:
            a, b, c = self._hinge[0]
            own[-1] = a * p + b * q + c * r

    def _nearest_rates(self, twist: FloatArray) -> FloatArray:
        """Least-squares rates of the base joints for a twist of its frame, angular part first, (6,)."""
        mujoco.mj_jacBody(self._model, self._data, self._jacobian[3:], self._jacobian[:3], self._root)
        return np.asarray(np.linalg.lstsq(self._jacobian[:, self._dofs], twist, rcond=None)[0])
