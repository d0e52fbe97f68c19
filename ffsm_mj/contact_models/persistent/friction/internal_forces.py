"""Internal forces of redundant sticking points, which have no effect: whether they wedge, and what share of mu holds."""

from __future__ import annotations

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.contact_models.persistent.friction.cone_margin import cone_margin, largest_margin
from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem

_DEPENDENT = 1e-10
"""Eigenvalues of the Delassus matrix below this share of the largest are zero."""
_SHARES = 1e-9
"""Part of a force without effect below which a point has none."""
_REDUCTIONS, _REDUCED = 20, 1e-6
"""Greatest number of reductions of a share of the friction limit, and the least relative one."""


def internal_forces(problem: FrictionProblem, points: IntArray) -> FloatArray:
    """Orthonormal forces (n, t1, t2) of some points that move nothing, as columns, (3k, d)."""
    rows = (3 * points[:, None] + np.arange(3)).ravel()
    sizes, U = np.linalg.eigh(problem.G[np.ix_(rows, rows)])
    rank = int(np.count_nonzero(sizes > _DEPENDENT * sizes[-1]))
    return np.asarray(U[:, : len(rows) - rank])


def wedged(problem: FrictionProblem, sticks: IntArray, point: int) -> bool:
    """Whether a sticking point is wedged: forces inside all friction cones hold it and its partners without any load.

    Its forces, and the load at which it would slip, then depend on the past.

    Args:
        problem: The contact problem.
        sticks: All sticking points.
        point: The point, one of them.
    """
    group = partners(problem, sticks, point)
    if len(group) < 2:
        return False
    freedom = internal_forces(problem, group)
    # Of forces without effect the margin is zero, or as large as allowed.
    given = freedom[:, 0].reshape(-1, 3)
    return cone_margin(given, freedom, problem.mu[group]) > float(np.abs(given).max())


def partners(problem: FrictionProblem, points: IntArray, point: int) -> IntArray:
    """Those of some points that share a load with one of them, and that point."""
    freedom, count = internal_forces(problem, points), len(points)
    blocks = np.abs(freedom @ freedom.T).reshape(count, 3, count, 3).max(axis=(1, 3)) > _SHARES
    group = points == point
    for _ in range(count):
        group = group | blocks[group].any(axis=0)
    return np.asarray(points[group])


def friction_use(problem: FrictionProblem, forces: FloatArray, sticks: IntArray, mine: IntArray) -> float:
    """Share of the friction limit that some sticking points use: with mu times this they would still stick.

    It is the largest ratio of friction to mu times the normal force among the points, in the given shares of the load, that
    of equal springs. Where these leave a friction cone, it is the least such ratio that any shares of the load have.

    Args:
        problem: The contact problem.
        forces: Forces (n, t1, t2) of all points, N, (k, 3).
        sticks: All sticking points.
        mine: Some of them.

    Returns:
        The share, in [0, 1].
    """
    if _largest_ratio(forces[sticks], problem.mu[sticks]) <= 1.0:
        return _largest_ratio(forces[mine], problem.mu[mine])
    group = partners(problem, sticks, int(mine[0]))
    freedom, mu = internal_forces(problem, group), problem.mu[group]
    least = 1.0
    # Dinkelbach's method: forces well inside the cones of a friction coefficient need a smaller one.
    for _ in range(_REDUCTIONS):
        ratio = _largest_ratio(largest_margin(forces[group], freedom, least * mu)[1], mu)
        if ratio >= least * (1.0 - _REDUCED):
            break
        least = ratio
    return least


def _largest_ratio(forces: FloatArray, mu: FloatArray) -> float:
    """Largest ratio of friction to its limit; infinite where a normal force pulls."""
    friction, limit = np.hypot(forces[:, 1], forces[:, 2]), mu * forces[:, 0]
    idle = np.where(friction > 0.0, np.inf, 0.0)
    return float(np.divide(friction, limit, out=idle, where=limit > 0.0).max())
