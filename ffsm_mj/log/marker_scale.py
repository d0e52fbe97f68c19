"""Scale of everything that viewers draw besides the bodies: arrows, marks, paths, plumes, targets."""

from __future__ import annotations

import mujoco
import numpy as np

from ffsm_mj.log.bounding_box import box_corners
from ffsm_mj.log.drawn_geoms import geoms_to_draw
from ffsm_mj.model.system import System

NOMINAL_M = 10.0
"""Size of a robot whose markers have their nominal size, m."""


def marker_scale(system: System) -> float:
    """Factor of the lengths of markers: the size of the robot over ``NOMINAL_M``.

    The size is the diagonal of the box around the robot's drawn geoms at the zero position of its model.
    """
    model = system.mj
    data = mujoco.MjData(model)
    data.qpos[:] = model.qpos0
    mujoco.mj_kinematics(model, data)
    geoms = [geom for geom in geoms_to_draw(model) if int(model.geom_bodyid[geom]) in system.robot.bodies]
    if not geoms:
        return float(model.stat.extent) / NOMINAL_M
    corners = box_corners(model, geoms, data.xpos, data.xquat)
    return float(np.linalg.norm(np.ptp(corners, axis=0))) / NOMINAL_M
