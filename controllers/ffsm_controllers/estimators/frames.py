"""Frames that sensors measure: bodies, geoms, sites and cameras, by the body they are fixed to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.controller_protocol import FloatArray, skew

_BODY, _XBODY = int(mujoco.mjtObj.mjOBJ_BODY), int(mujoco.mjtObj.mjOBJ_XBODY)
_FIXED = {
    int(mujoco.mjtObj.mjOBJ_GEOM): "geom",
    int(mujoco.mjtObj.mjOBJ_SITE): "site",
    int(mujoco.mjtObj.mjOBJ_CAMERA): "cam",
}


@dataclass(frozen=True)
class Frame:
    """A frame fixed to a body.

    Attributes:
        body: Id of the body; 0: the world.
        offset: Its origin in the body's frame, m, (3,).
        axes: Its axes in the body's frame, as columns, (3, 3).
    """

    body: int
    offset: FloatArray
    axes: FloatArray

    def pose(self, data: Any) -> tuple[FloatArray, FloatArray]:
        """Origin in m, (3,), and axes as columns, (3, 3), in world axes; kinematics in ``data`` are current."""
        axes = data.xmat[self.body].reshape(3, 3)
        return data.xpos[self.body] + axes @ self.offset, axes @ self.axes

    def twist(self, model: Any, data: Any) -> tuple[FloatArray, FloatArray]:
        """Velocity of the origin in m/s, and angular velocity in rad/s, world axes; ``cvel`` in ``data`` is current."""
        if not self.body:
            return np.zeros(3), np.zeros(3)
        relative = np.zeros(6)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, self.body, relative, 0)
        lever = data.xmat[self.body].reshape(3, 3) @ self.offset
        return relative[3:] + skew(relative[:3]) @ lever, relative[:3]


def frame_of(model: Any, kind: int, number: int) -> Frame:
    """Frame of an element by its type and id; of the world for an element of no type."""
    if kind == _XBODY:
        return Frame(number, np.zeros(3), np.eye(3))
    if kind == _BODY:
        return Frame(number, model.body_ipos[number].copy(), axes_of(model.body_iquat[number]))
    name = _FIXED.get(kind)
    if name is None:
        return Frame(0, np.zeros(3), np.eye(3))
    body = int(getattr(model, f"{name}_bodyid")[number])
    return Frame(body, getattr(model, f"{name}_pos")[number].copy(), axes_of(getattr(model, f"{name}_quat")[number]))


def root_frame(model: Any, frame: Frame) -> int | None:
    """Joint of the body that a frame is fixed to, if that is a free joint; None otherwise."""
    body, joint = frame.body, int(model.body_jntadr[frame.body])
    free = body > 0 and model.body_jntnum[body] == 1 and model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE
    return joint if free else None


def axes_of(quaternion: FloatArray) -> FloatArray:
    """Axes of a frame as columns, (3, 3), from its quaternion, (4,), of any length."""
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quaternion / np.linalg.norm(quaternion))
    return matrix.reshape(3, 3)
