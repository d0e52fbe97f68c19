"""Several contacts with friction pyramids instead of cones: Lemke's method on the problem of Stewart and Trinkle (1996).

The friction impulse of a contact is a sum of beta_j >= 0 along nd directions d_j. With the normal impulse nu above the least
one, the slip speed sigma, the normals and directions B, and the matrix E that assigns directions to contacts,

    0 <= (nu, beta, sigma)  _|_  (B^T u, with sigma added along each direction;  mu (least + nu) - E^T beta) >= 0.

The lexicographic ratio test prevents cycling in degenerate problems, such as symmetric scenes.
"""

from __future__ import annotations

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray

_PIVOTS_PER_ROW = 20
_ZERO = 1e-11
"""Entries of a column below this are rounding, not pivots: entries are of the order of 1, after hundreds of pivots."""


def pyramid_impulses(
    G: FloatArray, u: FloatArray, mu: FloatArray, least: FloatArray, speed: float, facets: int, first: FloatArray
) -> FloatArray:
    """Impulses (k, 3) with friction inside pyramids; the last iterate if the method ends without a solution.

    Args:
        G: A A^T, (3k, 3k).
        u: Velocities before, (3k,).
        mu: Coefficients of friction, (k,).
        least: Least normal impulses, (k,).
        speed: Largest contact speed before.
        facets: Directions of friction per contact.
        first: Angle of the first direction of each contact, (k,).
    """
    count = len(mu)
    # In units of the speed and of G_nn^(1/2) of each contact, entries are of the order of one.
    unit = 1.0 / np.sqrt(np.abs(np.diag(G)[::3]))
    normals, directions = np.zeros((3 * count, count)), np.zeros((3 * count, count * facets))
    for i in range(count):
        angles = first[i] + 2.0 * np.pi / facets * np.arange(facets)
        normals[3 * i, i] = unit[i]
        block = directions[3 * i : 3 * i + 3, i * facets : (i + 1) * facets]
        block[1], block[2] = unit[i] * np.cos(angles), unit[i] * np.sin(angles)
    B = np.hstack((normals, directions))
    given = np.zeros(3 * count)
    given[::3] = least
    E = np.repeat(np.eye(count), facets, axis=0)
    M = np.block(
        [
            [B.T @ G @ B, np.vstack((np.zeros((count, count)), E))],
            [np.diag(mu), -E.T, np.zeros((count, count))],
        ]
    )
    q = np.concatenate((B.T @ (u + G @ given) / speed, mu * least / (unit * speed)))
    z = lemke(M, q)
    impulses: FloatArray = given + speed * (B @ z[: count * (1 + facets)])
    return impulses.reshape(-1, 3)


def lemke(M: FloatArray, q: FloatArray) -> FloatArray:
    """Solve M z + q >= 0, z >= 0, complementary, for z; the last iterate on a ray or after too many pivots.

    The tableau holds w - M z - z0 = q; its first columns are the inverse of the basis, which the ratio test needs.
    """
    size = len(q)
    if q.min() >= 0.0:
        return np.zeros(size)
    tableau = np.hstack((np.eye(size), -M, -np.ones((size, 1)), q[:, None]))
    basis = np.arange(size)
    artificial = 2 * size
    entering, leaving_row = (
        artificial,
        size - 1 - int(np.argmin(q[::-1])),
    )  # of equal ones, the last is lexicographically least
    for _ in range(_PIVOTS_PER_ROW * size):
        left = int(basis[leaving_row])
        _pivot(tableau, leaving_row, entering)
        basis[leaving_row] = entering
        if left == artificial:
            break
        entering = left + size if left < size else left - size
        row = _leaving(tableau, entering, basis == artificial)
        if row is None:
            break
        leaving_row = row
    z = np.zeros(2 * size + 1)
    z[basis] = np.maximum(tableau[:, -1], 0.0)
    return z[size : 2 * size]


def _pivot(tableau: FloatArray, row: int, column: int) -> None:
    tableau[row] /= tableau[row, column]
    others = tableau[:, column].copy()
    others[row] = 0.0
    tableau -= np.outer(others, tableau[row])


def _leaving(tableau: FloatArray, column: int, artificial: BoolArray) -> int | None:
    """Row of the lexicographically least ratio, or None on a ray; the artificial variable leaves as soon as possible."""
    entries = tableau[:, column]
    rows = np.flatnonzero(entries > _ZERO)
    if not len(rows):
        return None
    size = len(tableau)
    ratios = tableau[rows, -1] / entries[rows]
    rows = rows[ratios <= ratios.min() + _ZERO * max(1.0, abs(float(ratios.min())))]
    if artificial[rows].any():
        return int(rows[artificial[rows]][0])
    for other in range(size):
        if len(rows) == 1:
            break
        ratios = tableau[rows, other] / entries[rows]
        rows = rows[ratios <= ratios.min() + _ZERO * max(1.0, abs(float(ratios.min())))]
    return int(rows[0])
