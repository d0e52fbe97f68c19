"""Two tangents of a contact, a function of its normal alone, so that a run repeats bit for bit."""

from __future__ import annotations

import math

import numpy as np

from ffsm_mj.arrays import FloatArray


def tangents(normal: FloatArray) -> FloatArray:
    """Unit vectors t1, t2 with (n, t1, t2) right-handed and orthonormal, (2, 3).

    The first is built from the coordinate axis furthest from the normal; in a planar scene it is exactly the axis
    perpendicular to the plane.

    Args:
        normal: Unit vector, (3,).
    """
    x, y, z = normal.tolist()  # plain floats: of three numbers, these are faster than arrays
    sizes = (abs(x), abs(y), abs(z))
    a, b, c = ((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0))[sizes.index(min(sizes))]
    length = math.sqrt(a * a + b * b + c * c)
    a, b, c = a / length, b / length, c / length
    return np.array(((a, b, c), (y * c - z * b, z * a - x * c, x * b - y * a)))
