"""Motion of a frame on a floating body's tree, with its derivatives by the error state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_controllers.estimators.frames import Frame
from ffsm_controllers.estimators.mekf.layout import FloatingBody
from ffsm_mj.controller_protocol import FloatArray, skew


class FrameMotion(NamedTuple):
    """Pose and twist of a frame in world axes, and what they change by per error of the estimate.

    Attributes:
        origin: Its origin, m, (3,).
        axes: Its axes as columns, (3, 3).
        velocity: Velocity of its origin, m/s, (3,).
        turning: Its angular velocity, rad/s, (3,).
        d_origin: Derivative of the origin, (3, size + n): by the error state, then by n joint coordinates.
        d_axes: Derivative of its rotation, a rotation vector in world axes, likewise.
        d_velocity: Derivative of the velocity, likewise, but zero for joints.
        d_turning: Derivative of the angular velocity, likewise.
    """

    origin: FloatArray
    axes: FloatArray
    velocity: FloatArray
    turning: FloatArray
    d_origin: FloatArray
    d_axes: FloatArray
    d_velocity: FloatArray
    d_turning: FloatArray


def frame_motion(
    model: Any, data: Any, frame: Frame, body: FloatingBody | None, size: int, dofs: Sequence[int] = ()
) -> FrameMotion:
    """Motion of a frame; positions and velocities of bodies in ``data`` are current.

    Args:
        model: MuJoCo model.
        data: Its data.
        frame: The frame.
        body: Floating body whose tree it is on; None: it has no error.
        size: Components of the error state.
        dofs: Degrees of freedom of joints whose coordinates have errors, (n,).
    """
    origin, axes = frame.pose(data)
    velocity, turning = frame.twist(model, data)
    d_origin, d_axes, d_velocity, d_turning = np.zeros((4, 3, size + len(dofs)))
    if body is not None:
        root = data.xmat[body.tree.root].reshape(3, 3)
        arm = skew(origin - data.xpos[body.tree.root])
        d_origin[:, body.position] = np.eye(3)
        d_origin[:, body.attitude] = -arm @ root
        d_axes[:, body.attitude] = root
        d_velocity[:, body.velocity] = np.eye(3)
        d_velocity[:, body.attitude] = -skew(velocity - data.qvel[body.dofs][:3]) @ root
        d_velocity[:, body.rate] = -arm @ root
        d_turning[:, body.attitude] = -skew(turning) @ root
        d_turning[:, body.rate] = root
    if len(dofs) and frame.body:
        jacobians = np.empty((2, 3, model.nv))
        mujoco.mj_jac(model, data, *jacobians, origin, frame.body)
        d_origin[:, size:], d_axes[:, size:] = jacobians[:, :, dofs]
    return FrameMotion(origin, axes, velocity, turning, d_origin, d_axes, d_velocity, d_turning)
