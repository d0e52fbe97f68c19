"""Internal forces of redundant sticking points, which have no effect: whether they wedge, and what share of mu holds."""

from __future__ import annotations

import math

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.contact_models.persistent.friction.cone_margin import cone_margin, largest_margin
from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem

_DEPENDENT = 1e-10
"""Eigenvalues of the Delassus matrix below this share of the largest are zero."""
_SHARES = 1e-9
"""Part of a force without effect below which a point has none."""
FRICTION_ROUNDING = 1e-13
"""Friction below this share of the largest force is rounding."""
_REDUCTIONS, _REDUCED = 20, 1e-12
"""Greatest number of reductions of a share of the friction limit, and the least relative one."""
_LEAST_WEIGHT = 1e-3
"""Of a point in a margin to all friction cones, in units of the largest: some limit may be zero."""


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


def least_use(
    problem: FrictionProblem, forces: FloatArray, group: IntArray, estimate: FloatArray | None = None
) -> tuple[float, FloatArray]:
    """Least share of mu with which points that share a load would still stick, in [0, 1], and forces that need no more.

    Args:
        problem: The contact problem.
        forces: Forces (n, t1, t2) of all points, N, (k, 3).
        group: Sticking points that share a load, see :func:`partners`.
        estimate: Such forces of these points at an earlier state, N, (m, 3): a first estimate.
    """
    given, freedom, mu = forces[group], internal_forces(problem, group), problem.mu[group]
    least, inside, weights = 1.0, given, np.ones(len(group))
    if estimate is not None:
        # The estimate, with the effect of the given forces.
        inside = given + (freedom @ (freedom.T @ (estimate - given).ravel())).reshape(-1, 3)
        least = min(1.0, max(limit_ratios(inside, mu)))
        weights = _weights(mu * inside[:, 0])
    # Dinkelbach's method: forces well inside the cones of a friction coefficient need a smaller one. Margins in units of
    # the limits last found make it converge faster than linearly (Crouzeix, Ferland and Schaible, JOTA 47, 1985).
    for _ in range(_REDUCTIONS):
        found = largest_margin(given, freedom, least * mu, weights)[1]
        ratio = max(limit_ratios(found, mu))
        if ratio >= least * (1.0 - _REDUCED):
            break
        least, inside, weights = ratio, found, _weights(mu * found[:, 0])
    return least, inside


def _weights(limits: FloatArray) -> FloatArray:
    """Units of the margins of some points, in proportion to their limits of friction, (k,)."""
    largest = float(limits.max())
    return np.maximum(limits / largest, _LEAST_WEIGHT) if largest > 0.0 else np.ones(len(limits))


def limit_ratios(forces: FloatArray, mu: FloatArray) -> list[float]:
    """Ratios of friction to its limit; infinite where a normal force pulls, zero where there is no friction but rounding."""
    rounding = FRICTION_ROUNDING * float(np.abs(forces).max(initial=0.0))
    ratios = []
    for (normal, *across), coefficient in zip(forces.tolist(), mu.tolist(), strict=True):
        friction, limit = math.hypot(*across), coefficient * normal
        ratios.append(0.0 if friction <= rounding else friction / limit if limit > 0.0 else math.inf)
    return ratios
