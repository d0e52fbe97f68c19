"""Corners of the bounding boxes of geoms, at any poses of their bodies."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray

_SIGNS = np.array(list(product((-1.0, 1.0), repeat=3)))


def box_corners(model: Any, geoms: Iterable[int], positions: FloatArray, quaternions: FloatArray) -> FloatArray:
    """Corners of the bounding boxes of some geoms in world axes, (8 * number of geoms, 3), m.

    Args:
        model: MuJoCo model.
        geoms: Ids of the geoms.
        positions: World positions of all bodies, (nbody, 3), m.
        quaternions: World orientations of all bodies, wxyz, (nbody, 4).
    """
    rotation, corners = np.empty(9), [np.empty((0, 3))]
    for geom in geoms:
        body, around = int(model.geom_bodyid[geom]), model.geom_aabb[geom]
        mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
        local = (around[:3] + _SIGNS * around[3:]) @ rotation.reshape(3, 3).T + model.geom_pos[geom]
        mujoco.mju_quat2Mat(rotation, quaternions[body])
        corners.append(local @ rotation.reshape(3, 3).T + positions[body])
    return np.vstack(corners)
