"""Internal forces of redundant sticking points, which have no effect: whether they wedge, and what share of mu holds.

Shares of a load among sticking points inside their friction cones are those of the least norm with the same effect:

    minimise |lam|^2   subject to   U^T lam = U^T given,   |lam_t,i| <= mu_i lam_n,i for every point i

The columns of U span all forces that have an effect.
"""

from __future__ import annotations

import math

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.contact_models.impact.friction.least_norm import least_norm_in, of_points, on_cones
from ffsm_mj.contact_models.persistent.friction.cones import cone_depth, largest_margin
from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem

_DEPENDENT = 1e-10
"""Eigenvalues of the Delassus matrix below this share of the largest are zero."""
_SHARES = 1e-9
"""Part of a force without effect below which a point has none."""
FRICTION_ROUNDING = 1e-13
"""Friction below this share of the largest force is rounding."""
_REDUCTIONS, _REDUCED = 20, 1e-12
"""Greatest number of reductions of a share of the friction limit, and the least relative one.

They converge faster than linearly: the tests need up to 9. Any of them is a share that suffices.
"""
_LEAST_WEIGHT = 1e-3
"""Of a point in a margin to all friction cones, in units of the largest: some limit may be zero."""
_OUTSIDE = 1e-9
"""Forces are outside a cone if they are so by this share of the largest force.

The cones are larger by as much: otherwise they leave no room where points are about to slip, and shares depend on rounding.
"""


def internal_forces(problem: FrictionProblem, points: IntArray) -> FloatArray:
    """Orthonormal forces (n, t1, t2) of some points that move nothing, as columns, (3k, d)."""
    rows = (3 * points[:, None] + np.arange(3)).ravel()
    sizes, U = np.linalg.eigh(problem.G[np.ix_(rows, rows)])
    # Directions in which a patch resists with less than this are left free (docs/friction.md, over an edge).
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
    return _use_of_internal(internal_forces(problem, group), problem.mu[group]) < 1.0


def partners(problem: FrictionProblem, points: IntArray, point: int) -> IntArray:
    """Those of some points that share a load with one of them, and that point."""
    freedom, count = internal_forces(problem, points), len(points)
    # The basis of these forces is arbitrary, the projector on them is not: it couples the points that share a load.
    blocks = np.abs(freedom @ freedom.T).reshape(count, 3, count, 3).max(axis=(1, 3)) > _SHARES
    # Points may share a load through others: the coupling is followed until the group is complete.
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
    group_forces, freedom, mu = forces[group], internal_forces(problem, group), problem.mu[group]
    # Where points are wedged, internal forces may grow until any load is small beside them. The use then falls towards that
    # of the internal forces alone, which no forces of finite size reach.
    least, inside = _use_of_internal(freedom, mu), group_forces
    if estimate is not None:
        # The estimate, with the effect of the given forces.
        near = group_forces + (freedom @ (freedom.T @ (estimate - group_forces).ravel())).reshape(-1, 3)
        if (ratio := max(limit_ratios(near, mu))) < least:
            least, inside = ratio, near
    return _least_ratio(freedom, mu, least, inside)


def _use_of_internal(freedom: FloatArray, mu: FloatArray) -> float:
    """Least share of mu with which internal forces alone, given as columns, stay inside the cones; 1 if they never do."""
    limits = np.einsum("i,ij->j", mu, freedom[::3])
    square = float(limits @ limits)
    # Forces inside the cones have a sum of limits mu n > 0: one of 1 gives the problem a bounded solution.
    if square <= _SHARES**2 * float(mu @ mu):
        return 1.0
    # The remaining freedom leaves that sum as it is.
    other = np.linalg.svd(limits[None], full_matrices=True)[2][1:]
    return _least_ratio(freedom @ other.T, mu, 1.0, (freedom @ (limits / square)).reshape(-1, 3))[0]


def _least_ratio(freedom: FloatArray, mu: FloatArray, least: float, inside: FloatArray) -> tuple[float, FloatArray]:
    """Least share of mu, at most a given one, whose cones contain forces of the same effect, and such forces, (m, 3).

    Dinkelbach's method: forces well inside the cones of a friction coefficient need a smaller one. Margins in units of the
    limits last found make it converge faster than linearly (Crouzeix, Ferland and Schaible, JOTA 47, 1985).

    Args:
        freedom: Orthonormal forces without effect, as columns, (3m, d).
        mu: Coefficients of friction, (m,).
        least: A share that suffices, or that is not to be exceeded.
        inside: Forces of the effect, N, (m, 3); those that need the share, where it is known to suffice.
    """
    start, weights = inside, _weights(mu * inside[:, 0])
    for _ in range(_REDUCTIONS):
        inside_cones = largest_margin(start, freedom, least * mu, weights)[1]
        ratio = max(limit_ratios(inside_cones, mu))
        # Without progress the margin of the reduced cones is rounding: the share is the least one.
        if ratio >= least * (1.0 - _REDUCED):
            break
        least, inside, weights = ratio, inside_cones, _weights(mu * inside_cones[:, 0])
    return least, inside


def _weights(limits: FloatArray) -> FloatArray:
    """Units of the margins of some points, in proportion to their limits of friction, (k,)."""
    largest = float(limits.max())
    return np.maximum(limits / largest, _LEAST_WEIGHT) if largest > 0.0 else np.ones(len(limits))


def limit_ratios(forces: FloatArray, mu: FloatArray) -> list[float]:
    """Ratios of friction to its limit; infinite where a normal force pulls, zero where there is no friction but rounding.

    Its compiled twin is ``largest_ratio`` in ``_core/contacts.pyx``.
    """
    rounding = FRICTION_ROUNDING * float(np.abs(forces).max(initial=0.0))
    ratios = []
    for (normal, *across), coefficient in zip(forces.tolist(), mu.tolist(), strict=True):
        friction, limit = math.hypot(*across), coefficient * normal
        ratios.append(0.0 if friction <= rounding else friction / limit if limit > 0.0 else math.inf)
    return ratios


def shares_in_cones(problem: FrictionProblem, forces: FloatArray, sticks: IntArray) -> FloatArray:
    """Forces with the shares of sticking points inside the cones, if those given are not.

    Args:
        problem: The contact problem.
        forces: Forces (n, t1, t2) of all points, N, (k, 3).
        sticks: Indices of the sticking points.

    Returns:
        Forces of the same effect, N, (k, 3): those given if they are inside the cones, or if no others are.
    """
    sticking, mu = forces[sticks], problem.mu[sticks]
    if not len(sticks) or cone_depth(sticking, mu) >= -_OUTSIDE * float(np.abs(sticking).max()):
        return forces
    freedom = internal_forces(problem, sticks)
    # Unique forces cannot be shared otherwise; they may be outside by the excess up to which points stick.
    if not freedom.shape[1]:
        return forces
    shared = forces.copy()
    shared[sticks] = least_in_cones(sticking, freedom, mu)
    return shared


def least_in_cones(forces: FloatArray, freedom: FloatArray, mu: FloatArray) -> FloatArray:
    """Forces of least norm inside the friction cones with the effect of given ones, N, (k, 3).

    Where the cones leave no room, as when points are about to slip, they are those of the largest margin.

    Args:
        forces: Forces (n, t1, t2), N, (k, 3).
        freedom: Orthonormal forces without effect, as columns, (3k, d).
        mu: Coefficients of friction, (k,).
    """
    unit = float(np.abs(forces).max())
    # Without the forces that have no effect the given ones are those of least norm.
    x = forces.ravel() / unit
    x = x - freedom @ (freedom.T @ x)
    moved = np.zeros((len(mu), 3))
    # A tip moved by this along the axis gives every point a limit of friction larger by _OUTSIDE.
    moved[:, 0] = np.where(mu > 0.0, _OUTSIDE / np.where(mu > 0.0, mu, 1.0), 0.0)
    # Forces have an effect only along the complement of those without one.
    U = np.linalg.svd(freedom, full_matrices=True)[0][:, freedom.shape[1] :]
    least = least_norm_in(lambda lam: of_points(*on_cones(lam.reshape(-1, 3), mu, moved)), U, U.T @ x)
    if least is not None:
        return unit * least.reshape(-1, 3)
    return largest_margin(forces, freedom, mu)[1]
