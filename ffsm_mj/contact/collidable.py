"""Which geoms can collide by MuJoCo's own filters."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

Matrix = npt.NDArray[np.bool_]


def collidable(model: Any) -> Matrix:
    """Whether two geoms can collide, (ngeom, ngeom), symmetric: the filters of MuJoCo's collision detection.

    Geoms collide if a bit of ``contype`` of one is set in ``conaffinity`` of the other, unless they are on one rigid body,
    on bodies joined by a joint (``filterparent``), or on bodies of an ``exclude``. A ``pair`` of the MJCF overrides that.
    """
    weld = model.body_weldid[model.geom_bodyid]
    parent = model.body_weldid[model.body_parentid[weld]]
    bits = (model.geom_contype[:, None] & model.geom_conaffinity[None, :]) != 0
    found = (bits | bits.T) & (weld[:, None] != weld[None, :])
    if not model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT):
        # The world is no parent in this sense: a geom of the base may collide with the ground.
        moving = (weld[:, None] > 0) & (weld[None, :] > 0)
        joined = (weld[:, None] == parent[None, :]) | (parent[:, None] == weld[None, :])
        found &= ~(moving & joined)
    for signature in model.exclude_signature.tolist():
        one, other = (model.geom_bodyid == body for body in (signature >> 16, signature & 0xFFFF))
        both = one[:, None] & other[None, :]
        found &= ~(both | both.T)
    for a, b in zip(model.pair_geom1.tolist(), model.pair_geom2.tolist(), strict=True):
        found[a, b] = found[b, a] = weld[a] != weld[b]
    return np.asarray(found)
