"""Two tangents of a contact, a function of its normal alone, so that a run repeats bit for bit."""

from __future__ import annotations

import numpy as np

from ffsm_mj.arrays import FloatArray


def tangents(normal: FloatArray) -> FloatArray:
    """Unit vectors t1, t2 with (n, t1, t2) right-handed and orthonormal, (2, 3).

    The first is built from the coordinate axis furthest from the normal; in a planar scene it is exactly the axis
    perpendicular to the plane.

    Args:
        normal: Unit vector, (3,).
    """
    n = np.asarray(normal, dtype=np.float64)
    across = np.zeros(3)
    across[np.argmin(np.abs(n))] = 1.0
    first = np.cross(across, n)
    first /= np.linalg.norm(first)
    return np.stack((first, np.cross(n, first)))
