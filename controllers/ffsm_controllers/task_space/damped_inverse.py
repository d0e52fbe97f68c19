"""The inverse of alpha M_c^-1 alpha^T and its like, kept small near singularities."""

from __future__ import annotations

import numpy as np

from ffsm_mj.arrays import FloatArray


def damped_inverse(matrix: FloatArray, largest: float) -> tuple[FloatArray, FloatArray]:
    """The inverse of a symmetric positive matrix, damped along principal directions in which it is above a bound.

    Along a direction with the eigenvalue a the inverse is 1/a down to a_0 = 1/largest, and below it (2 - a/a_0)/a_0: the
    same value and slope there, finite for a = 0. What is wanted along it is had to the share (2 - a/a_0) a/a_0. Applied to
    the mobility alpha M_c^-1 alpha^T in 1/kg and 1/(kg m^2) the inverse is the effective inertia of the site.

    Args:
        matrix: The matrix, (p, p).
        largest: Value of the inverse above which a direction is damped.

    Returns:
        The inverse (p, p), and the eigenvalues of the matrix, ascending, (p,).
    """
    values, directions = np.linalg.eigh(matrix)
    smallest = float(values[0])
    if smallest * largest >= 1.0:
        return (directions / values).dot(directions.T), values
    share = np.minimum(np.maximum(values, 0.0) * largest, 1.0)
    inverse = np.where(share < 1.0, (2.0 - share) * largest, 1.0 / np.maximum(values, 1.0 / largest))
    return (directions * inverse).dot(directions.T), values
