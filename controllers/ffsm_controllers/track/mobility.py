"""Forces on a site for accelerations that are wanted, kept small near singularities."""

from __future__ import annotations

import numpy as np

from ffsm_mj.arrays import FloatArray


def effective_inertia(mobility: FloatArray, largest: float) -> tuple[FloatArray, FloatArray]:
    """The inverse of alpha M_c^-1 alpha^T, damped along principal directions in which it is above a bound.

    Along a direction of mobility a the inertia is 1/a down to a_0 = 1/largest, and below it (2 - a/a_0)/a_0: the same value
    and slope there, finite for a = 0. An acceleration that is wanted is had to the share (2 - a/a_0) a/a_0.

    Args:
        mobility: alpha M_c^-1 alpha^T, symmetric, (p, p), in 1/kg and 1/(kg m^2).
        largest: Inertia above which a direction is damped.

    Returns:
        The inertia (p, p), and the mobilities along the principal directions, ascending, (p,).
    """
    values, directions = np.linalg.eigh(mobility)
    smallest = float(values[0])
    if smallest * largest >= 1.0:
        return (directions / values).dot(directions.T), values
    share = np.minimum(np.maximum(values, 0.0) * largest, 1.0)
    inverse = np.where(share < 1.0, (2.0 - share) * largest, 1.0 / np.maximum(values, 1.0 / largest))
    return (directions * inverse).dot(directions.T), values
