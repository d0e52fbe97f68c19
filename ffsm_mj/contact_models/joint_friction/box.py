"""Accelerations under forces that are bounded: dry friction of coordinates at rest, and unilateral constraints.

Of all accelerations, those under dry friction minimise

    (a - a_f)^T M (a - a_f) / 2 + sum_i f_i |A_i a + g_i|

subject to bilateral rows that hold and unilateral ones that do not close. The problem is strictly convex: the accelerations
are unique, also where the forces are not, as of two coupled joints. In mass-weighted coordinates, with rows W of which the
bilateral ones have been taken out, its dual is a bounded least-squares problem,

    minimise |w + W^T tau|   subject to   low <= tau <= high,   W w = accelerations of the rows without these forces

which an active-set method solves exactly (Stark & Parker, *Bounded-variable least-squares*, 1995).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.tolerances import RANK

_COMPLIANCE = 1e-10
"""Compliance of each row as a share of its inverse mass if nothing else were held.

Without it rows that depend on each other, as those of joints that a coupling joins, have no unique forces, and pivoting on
them may not end. It decides which rows are at a bound alone; the forces of the others are then those without compliance.
"""
_AT_BOUND = 1e-9
"""A force this close to its bound, as a share of it, is at the bound."""
_MOVES = 1e-8
"""A row at its bound moves if it accelerates by more than this share of what its own force and all others do to it.

Above the effect of the compliance. A row that would move, but slower, is held with a force beyond its bound by as much: it
leaves its bound within a step, where the event is located.
"""


class BoundedForces(NamedTuple):
    """Solution for some rows.

    Attributes:
        forces: Forces along the rows, (n,).
        accelerations: Accelerations of the rows, (n,); zero to rounding where a row is held.
        moves: Direction in which each row accelerates, with its force at the opposite bound, -1 or 1; 0 if it is held, (n,).
    """

    forces: FloatArray
    accelerations: FloatArray
    moves: FloatArray


def bounded_forces(W: FloatArray, b: FloatArray, low: FloatArray, high: FloatArray, masses: FloatArray) -> BoundedForces:
    """Forces that keep rows from accelerating as far as their bounds allow.

    Args:
        W: Rows in mass-weighted coordinates, less what bilateral rows hold, (n, nv): W W^T are accelerations per force.
        b: Accelerations of the rows without these forces, (n,).
        low: Least forces, (n,); negative or zero.
        high: Greatest forces, (n,); positive, and infinite for a unilateral row.
        masses: Accelerations of each row per force along it if no row were held, (n,): the scale of the compliance.
    """
    G = W @ W.T
    own = np.diag(G)
    # Rows that bilateral ones hold: no force moves them, and they carry none.
    free = own > RANK * masses
    forces = np.zeros(len(b))
    if free.any():
        forces[free] = _bounded(W[free], b[free], low[free], high[free], np.sqrt(masses[free]))
    accelerations = b + G @ forces
    terms = np.abs(b) + own * np.abs(forces)
    at_low = np.isfinite(low) & (forces <= (1.0 - _AT_BOUND) * low)
    at_high = np.isfinite(high) & (forces >= (1.0 - _AT_BOUND) * high)
    moves = np.where(at_high & (accelerations < -_MOVES * terms), -1.0, 0.0)
    moves = np.where(at_low & (accelerations > _MOVES * terms), 1.0, moves)
    moves[~free] = 0.0
    # Those that move have their bound itself, the others what holds them without compliance: the least change.
    forces = np.where(moves < 0.0, high, np.where(moves > 0.0, low, forces))
    held = free & (moves == 0.0)
    if held.any():
        left = b[held] + G[held] @ forces
        forces[held] -= np.linalg.lstsq(G[np.ix_(held, held)], left, rcond=RANK)[0]
    return BoundedForces(forces, b + G @ forces, moves)


def _bounded(W: FloatArray, b: FloatArray, low: FloatArray, high: FloatArray, sizes: FloatArray) -> FloatArray:
    """Forces within their bounds that minimise the mass-weighted acceleration, with compliance, (n,)."""
    if len(b) == 1:
        return np.clip(-b / float(W[0] @ W[0]), low, high)
    from scipy.optimize import lsq_linear  # takes a second to import: only decisions between several rows pay

    scale = float(np.abs(b / sizes).max())
    if scale == 0.0:
        return np.zeros(len(b))
    rows = W / sizes[:, None]
    w = np.linalg.lstsq(rows, b / sizes / scale, rcond=None)[0]
    compliant = np.vstack((rows.T, np.sqrt(_COMPLIANCE) * np.eye(len(b))))
    bounds = low * sizes / scale, high * sizes / scale
    found = lsq_linear(compliant, -np.append(w, np.zeros(len(b))), bounds, method="bvls", tol=1e-15)
    return np.asarray(found.x) / sizes * scale


def least_use(forces: FloatArray, idle: FloatArray, limits: FloatArray) -> FloatArray:
    """Of forces with the same effect those whose largest share of their limits is least, (n,): a linear programme.

    Args:
        forces: Some of these forces, (n,).
        idle: Forces without effect, (m, n).
        limits: Their limits, (n,).
    """
    from scipy.optimize import linprog  # takes time to import: only joints whose rows depend on each other pay

    shares, directions, ones = forces / limits, (idle / limits).T, np.ones((len(forces), 1))
    bounds = np.block([[directions, -ones], [-directions, -ones]])
    cost = np.append(np.zeros(len(idle)), 1.0)
    found = linprog(cost, A_ub=bounds, b_ub=np.concatenate((-shares, shares)), bounds=(None, None), method="highs")
    return forces + found.x[:-1] @ idle if found.status == 0 else forces
