"""Shares of a load among sticking points inside their friction cones: of all that have the same effect, the least norm.

    minimise |lam|^2   subject to   U^T lam = U^T given,   |lam_t,i| <= mu_i lam_n,i for every point i

The columns of U span all forces that have an effect.
"""

from __future__ import annotations

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.contact_models.impact.least_norm import least_norm_in, of_points, on_cones
from ffsm_mj.contact_models.persistent.friction.cone_depth import depth
from ffsm_mj.contact_models.persistent.friction.cone_margin import largest_margin
from ffsm_mj.contact_models.persistent.friction.internal_forces import internal_forces
from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem

_OUTSIDE = 1e-9
"""Forces are outside a cone if they are so by this share of the largest force.

The cones are larger by as much: otherwise they leave no room where points are about to slip, and shares depend on rounding.
"""


def shares_in_cones(problem: FrictionProblem, forces: FloatArray, sticks: IntArray) -> FloatArray:
    """Forces with the shares of sticking points inside the cones, if those given are not.

    Args:
        problem: The contact problem.
        forces: Forces (n, t1, t2) of all points, N, (k, 3).
        sticks: Indices of the sticking points.

    Returns:
        Forces of the same effect, N, (k, 3): those given if they are inside the cones, or if no others are.
    """
    given, mu = forces[sticks], problem.mu[sticks]
    if not len(sticks) or depth(given, mu) >= -_OUTSIDE * float(np.abs(given).max()):
        return forces
    freedom = internal_forces(problem, sticks)
    if not freedom.shape[1]:
        return forces
    shared = forces.copy()
    shared[sticks] = least_in_cones(given, freedom, mu)
    return shared


def least_in_cones(given: FloatArray, freedom: FloatArray, mu: FloatArray) -> FloatArray:
    """Forces of least norm inside the friction cones with the effect of given ones, N, (k, 3).

    Where the cones leave no room, as when points are about to slip, they are those of the largest margin.

    Args:
        given: Forces (n, t1, t2), N, (k, 3).
        freedom: Orthonormal forces without effect, as columns, (3k, d).
        mu: Coefficients of friction, (k,).
    """
    unit = float(np.abs(given).max())
    # Without the forces that have no effect the given ones are those of least norm.
    x = given.ravel() / unit
    x = x - freedom @ (freedom.T @ x)
    moved = np.zeros((len(mu), 3))
    moved[:, 0] = np.where(mu > 0.0, _OUTSIDE / np.where(mu > 0.0, mu, 1.0), 0.0)
    U = np.linalg.svd(freedom, full_matrices=True)[0][:, freedom.shape[1] :]
    found = least_norm_in(lambda lam: of_points(*on_cones(lam.reshape(-1, 3), mu, moved)), U, U.T @ x)
    if found is not None:
        return unit * found.reshape(-1, 3)
    return largest_margin(given, freedom, mu)[1]
