"""A further grasp as a latch between two bodies: its pose at the closing, and the latch that these numbers give."""

from __future__ import annotations

from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.loops.latch import LatchedBodies, axes_about, stopped_along_axes
from ffsm_mj.model.grasp import Grasp
from ffsm_mj.model.system import System


class ClosingPose(NamedTuple):
    """Pose of the object's body in the frame of the link at the closing of a grasp.

    Numbers for the record of the closing: a log replay makes the same latch of them, bit by bit.

    Attributes:
        position_m: Position of the body of the object's site in the frame of the body of the robot's site, m.
        quaternion: Its orientation there, (w, x, y, z).
    """

    position_m: tuple[float, ...]
    quaternion: tuple[float, ...]


def closing_pose(system: System, data: Any, grasp: Grasp) -> ClosingPose:
    """Relative pose of the bodies of a grasp at the state in ``data`` of the logged system, kinematics current."""
    link, body = _bodies(system, grasp)
    position = data.xmat[link].reshape(3, 3).T @ (data.xpos[body] - data.xpos[link])
    back, quaternion = np.empty(4), np.empty(4)
    mujoco.mju_negQuat(back, data.xquat[link])
    mujoco.mju_mulQuat(quaternion, back, data.xquat[body])
    mujoco.mju_normalize4(quaternion)
    return ClosingPose(tuple(position.tolist()), tuple(quaternion.tolist()))


def loop_latch(system: System, grasp: Grasp, pose: ClosingPose) -> LatchedBodies:
    """Latch of a grasp between bodies of the logged system, with what its joint leaves free.

    Where the frames of the two sites are not aligned at the closing, they stay as they are, and the axis is the robot's. For
    kinds with freedom any later pose of a closed grasp gives the same latch, up to drift.

    Args:
        system: The logged system.
        grasp: The grasp.
        pose: Pose at the closing.
    """
    model = system.mj
    robot, held = system.index("site", grasp.robot_site), system.index("site", grasp.object_site)
    axes = _matrix(model.site_quat[robot]) @ axes_about(grasp.joint.axis)
    stopped = stopped_along_axes(grasp.joint.kind)
    return LatchedBodies.at_pose(_bodies(system, grasp), np.array(model.site_pos[held]), axes, stopped, *pose)


def _bodies(system: System, grasp: Grasp) -> tuple[int, int]:
    """Ids of the bodies of the robot's site and the object's."""
    sites = (system.index("site", each) for each in (grasp.robot_site, grasp.object_site))
    link, body = (int(system.mj.site_bodyid[site]) for site in sites)
    return link, body


def _matrix(quaternion: FloatArray) -> FloatArray:
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)
