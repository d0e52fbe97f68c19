"""Shares of a load among sticking points inside their friction cones: of all that have the same effect, the least norm.

    minimise |lam|^2   subject to   U^T lam = U^T given,   |lam_t,i| <= mu_i lam_n,i for every point i

The columns of U span all forces that have an effect. The dual problem is smooth and has few unknowns y: lam is the
projection of U y onto the cones, and y follows from U^T lam = U^T given by Newton's method with a line search (Qi & Sun, *A
nonsmooth version of Newton's method*, 1993).
"""

from __future__ import annotations

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.contact_models.persistent.friction.cone_depth import depth
from ffsm_mj.contact_models.persistent.friction.cone_margin import largest_margin
from ffsm_mj.contact_models.persistent.friction.internal_forces import internal_forces
from ffsm_mj.contact_models.persistent.friction.linear_systems import solved
from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem

_OUTSIDE = 1e-9
"""Forces are outside a cone if they are so by this share of the largest force.

The cones are larger by as much: otherwise they leave no room where points are about to slip, and shares depend on rounding.
"""
_ACCURACY, _ROUNDING = 1e-13, 1e-15
"""Residual of the effect at which iterations end, as a share of the largest force, and its rounding as a share of the
largest unknown, which is large where the cones leave little room."""
_SOLVED = 1e-10
"""Residual at which the answer is accepted."""
_ITERATIONS, _HALVINGS = 200, 30
_REACH = 10.0
"""Largest step in units of the largest unknown: where some points carry no force the derivative is singular, and the step
without a bound so long that the dual function is rounding there."""
_DAMPING = 1e-10
"""Part of the identity in the derivative, which is singular where few points carry force, over the residual."""


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
    effect = U.T @ x
    y = effect.copy()
    for _ in range(_ITERATIONS):
        lam, slope = _projected((U @ y).reshape(-1, 3), mu, moved)
        miss = effect - U.T @ lam.ravel()
        if float(np.abs(miss).max()) <= max(_ACCURACY, _ROUNDING * float(np.abs(y).max())):
            break
        derivative = np.einsum("kia,kij,kjb->ab", U.reshape(-1, 3, len(y)), slope, U.reshape(-1, 3, len(y)))
        step = solved(derivative + _DAMPING * float(np.abs(miss).max()) * np.eye(len(y)), miss)
        reach = _REACH * (1.0 + float(np.abs(y).max())) / max(float(np.abs(step).max()), np.finfo(float).tiny)
        y = _searched(U, y, step * min(1.0, reach), effect, mu, moved)
    if float(np.abs(miss).max()) <= _SOLVED:
        return unit * lam
    return largest_margin(given, freedom, mu)[1]


def _searched(
    U: FloatArray, y: FloatArray, step: FloatArray, effect: FloatArray, mu: FloatArray, moved: FloatArray
) -> FloatArray:
    """The y along a step at which the dual function, which is convex, has decreased enough."""

    def value(y: FloatArray) -> float:
        lam = _projected((U @ y).reshape(-1, 3), mu, moved)[0]
        return 0.5 * float(np.sum(lam * lam)) - float(effect @ y)

    lam = _projected((U @ y).reshape(-1, 3), mu, moved)[0]
    here, slope = value(y), float((U.T @ lam.ravel() - effect) @ step)
    share = 1.0
    for _ in range(_HALVINGS):
        # To rounding of the value any step near the solution is good.
        if value(y + share * step) <= here + 1e-4 * share * slope + 1e-15 * (1.0 + abs(here)):
            break
        share *= 0.5
    return np.asarray(y + share * step)


def _projected(given: FloatArray, mu: FloatArray, moved: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Nearest forces inside cones with tips at ``-moved``, (k, 3), and their derivatives by the given ones, (k, 3, 3)."""
    forces = given + moved
    n, t = forces[:, 0], np.hypot(forces[:, 1], forces[:, 2])
    inside, tip = t <= mu * n, mu * t <= -n
    onto = (n + mu * t) / (1.0 + mu * mu)
    e = forces[:, 1:] / np.where(t > 0.0, t, 1.0)[:, None]
    side = np.column_stack((onto, (mu * onto)[:, None] * e))
    lam = np.where(inside[:, None], forces, np.where(tip[:, None], 0.0, side))
    ray = np.column_stack((np.ones(len(mu)), mu[:, None] * e)) / np.sqrt(1.0 + mu * mu)[:, None]
    across = np.column_stack((np.zeros(len(mu)), -e[:, 1], e[:, 0]))
    turn = mu * onto / np.where(t > 0.0, t, 1.0)
    slope = ray[:, :, None] * ray[:, None, :] + turn[:, None, None] * across[:, :, None] * across[:, None, :]
    slope = np.where(inside[:, None, None], np.eye(3), np.where(tip[:, None, None], 0.0, slope))
    return lam - moved, slope
