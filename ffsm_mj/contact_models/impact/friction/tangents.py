"""Two tangents of a contact, from its normal alone: a run repeats to the last bit."""

from __future__ import annotations

import numpy as np

from ffsm_mj.arrays import FloatArray


def tangents(normal: FloatArray) -> FloatArray:
    """Unit vectors t1, t2 with (n, t1, t2) right-handed and orthonormal, (2, 3).

    In a planar scene one of them is the axis that the plane leaves out, exactly: the axis furthest from the normal is taken.

    Args:
        normal: Unit vector, (3,).
    """
    n = np.asarray(normal, dtype=np.float64)
    across = np.zeros(3)
    across[np.argmin(np.abs(n))] = 1.0
    first = np.cross(across, n)
    first /= np.linalg.norm(first)
    return np.stack((first, np.cross(n, first)))
