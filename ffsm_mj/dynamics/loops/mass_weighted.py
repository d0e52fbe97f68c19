"""Bilateral rows in mass-weighted coordinates at one state: rank, plastic impulse, other rows less these.

With M = L L^T and A = B L^-T = U diag(s) V^T, singular values below a share of the largest are zero: rows that depend on
others get impulses of least norm, and the motion is unique.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.tolerances import RANK


@dataclass(frozen=True)
class PlasticClosing:
    """Plastic impulse on bilateral rows.

    Attributes:
        impulses: Impulse along each row, of least norm, N s, (n,).
        change: Change of the generalised velocity, (nv,).
        loss_J: Kinetic energy lost.
        rank: Number of independent rows.
        least_ratio: Smallest singular value that counts over the largest: a small one says that the mechanism is nearly
            singular.
    """

    impulses: FloatArray
    change: FloatArray
    loss_J: float
    rank: int
    least_ratio: float


class MassWeightedRows:
    """Bilateral rows at one state.

    Attributes:
        rank: Number of independent rows.
    """

    def __init__(self, M: FloatArray, rows: FloatArray, rank: float = RANK) -> None:
        """Factorise the rows.

        Args:
            M: Mass matrix, (nv, nv).
            rows: Rows B, (n, nv).
            rank: Share of the largest singular value below which others are zero.
        """
        self.rows, self._L, self._rank = rows, np.linalg.cholesky(M), rank
        left, sizes, right = np.linalg.svd(np.linalg.solve(self._L, rows.T).T, full_matrices=False)
        self.rank = int(np.count_nonzero(sizes > rank * sizes.max(initial=0.0)))
        self._left, self._sizes, self._right = left[:, : self.rank], sizes[: self.rank], right[: self.rank]
        self._others = left[:, self.rank :]

    @property
    def least_ratio(self) -> float:
        """Smallest singular value that counts over the largest; 1 if nothing can move along the rows."""
        return float(self._sizes[-1] / self._sizes[0]) if self.rank else 1.0

    def independent(self) -> tuple[FloatArray, FloatArray]:
        """Combinations T of the rows with T B M^-1 B^T T^T = 1, (r, n), and orthonormal ones that vanish, (n - r, n)."""
        return (self._left / self._sizes).T, self._others.T

    def plastic(self, qvel: FloatArray) -> PlasticClosing:
        """Plastic impulse that stops the velocities of all rows."""
        taken = (self._left.T @ (self.rows @ qvel)) / self._sizes
        impulses, loss = -self._left @ (taken / self._sizes), 0.5 * float(taken @ taken)
        change: FloatArray = -np.linalg.solve(self._L.T, self._right.T @ taken)
        return PlasticClosing(impulses, change, loss, self.rank, self.least_ratio)

    def change(self, speeds: FloatArray) -> FloatArray:
        """Least change of velocities, or accelerations, in the metric of M that takes some speeds from the rows, (nv,).

        Args:
            speeds: What to take from each row, (n,); combinations of rows that vanish lose nothing.
        """
        return np.asarray(-np.linalg.solve(self._L.T, self._right.T @ ((self._left.T @ speeds) / self._sizes)))

    def projected(self, directions: FloatArray) -> FloatArray:
        """Other rows J less what these hold, J (1 - M^-1 B^T (B M^-1 B^T)^+ B), (m, nv).

        With them and the same M, impacts are those of the system in which these rows are held: M^-1 times their transpose is
        Mc^-1 J^T, and they have the rates of J wherever the held rows do not move. Rows that are held are zero.
        """
        A = np.linalg.solve(self._L, directions.T).T
        left = without_rounding(A - (A @ self._right.T) @ self._right, np.linalg.norm(A, axis=1), self._rank)
        return np.asarray(left @ self._L.T)


def without_rounding(rows: FloatArray, terms: FloatArray, rank: float = RANK) -> FloatArray:
    """Rows in which larger ones cancel, with those that are only rounding of these set to zero, (m, n).

    Rows of contacts contain normals and poses, known to about ``RANK``: a row below this share of what cancels in it says
    nothing about the motion, while an impulse along it would be 1e10 times too large. No admissible motion changes the gap
    of such a contact, and it takes no part in impacts.

    Args:
        rows: The rows, (m, n).
        terms: Norms of what cancels in each of them, (m,).
        rank: Share of these to which the rows are known.
    """
    cancelled = np.linalg.norm(rows, axis=1) <= rank * terms
    return np.where(cancelled[:, None], 0.0, rows) if cancelled.any() else rows
