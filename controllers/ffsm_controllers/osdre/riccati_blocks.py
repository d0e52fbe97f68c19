"""Newton-Kleinman steps for the Riccati equation of p outputs, with p x p blocks.

As in :mod:`~ffsm_controllers.osdre.riccati_planar`: a Lyapunov equation with blocks F = A21 - S P2^T, G = A22 - S P3 has
X2 = (T - W1 / 2) F^-1 with an antisymmetric T, and what is left for T and the symmetric X3 is one linear system of p^2
unknowns, where the whole equation has (2 p)^2.
"""

from __future__ import annotations

import numpy as np

from ffsm_mj.arrays import FloatArray

_ITERATIONS = 12
# Steps this small, relative, leave an error of the order of rounding after them.
_LAST_CHANGE = 1e-8


class BlockNewton:
    """Solver for one state weight."""

    def __init__(self, Q: FloatArray) -> None:
        """Take the weight apart, (2 p, 2 p), and make bases of antisymmetric and symmetric blocks."""
        p = self._p = len(Q) // 2
        self._Q1, self._Q12, self._Q3 = Q[:p, :p], Q[:p, p:], Q[p:, p:]
        self._upper, self._above = np.triu_indices(p), np.triu_indices(p, 1)
        self._T = np.zeros((len(self._above[0]), p, p))
        self._E = np.zeros((len(self._upper[0]), p, p))
        for T, i, j in zip(self._T, *self._above, strict=True):
            T[i, j], T[j, i] = 1.0, -1.0
        for E, i, j in zip(self._E, *self._upper, strict=True):
            E[i, j] = E[j, i] = 1.0

    def solve(self, A21: FloatArray, A22: FloatArray, S: FloatArray, start: FloatArray) -> FloatArray | None:
        """Iterate from [P2^T, P3] (p, 2 p) until steps are rounding.

        Returns:
            K, (2 p, 2 p), not yet verified; None where the iteration breaks down.
        """
        p = self._p
        P2, P3 = start[:, :p].T, start[:, p:]
        try:
            for _ in range(_ITERATIONS):
                X2, X3 = self._step(A21, A22, S, P2, P3)
                change = np.abs(X2 - P2).max() + np.abs(X3 - P3).max()
                P2, P3 = X2, X3
                if not change > _LAST_CHANGE * (np.abs(X2).max() + np.abs(X3).max()):
                    break
        except np.linalg.LinAlgError:
            return None
        P1 = -(A21.T.dot(P3) + P2.dot(A22) + self._Q12 - P2.dot(S).dot(P3))
        K = np.empty((2 * p, 2 * p))
        K[:p, :p], K[:p, p:], K[p:, :p], K[p:, p:] = 0.5 * (P1 + P1.T), P2, P2.T, P3
        return K if np.isfinite(K).all() else None

    def _step(
        self, A21: FloatArray, A22: FloatArray, S: FloatArray, P2: FloatArray, P3: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """One Newton-Kleinman step."""
        M, N = S.dot(P2.T), S.dot(P3)
        F, G = A21 - M, A22 - N
        inverse = np.linalg.inv(F)
        U = -0.5 * (self._Q1 + P2.dot(M)).dot(inverse)
        V = self._T @ inverse
        # Rows: the symmetric equation for X3, and the symmetry of X1. Columns: the entries of T, then of X3.
        rates = np.concatenate((V, self._E @ G))
        rates += rates.transpose(0, 2, 1)
        turns = np.concatenate((V @ G, F.T @ self._E))
        turns -= turns.transpose(0, 2, 1)
        known = self._Q3 + P3.dot(N) + U + U.T
        turn = self._Q12 + P2.dot(N) + U.dot(G)
        system = np.concatenate((rates[:, *self._upper], turns[:, *self._above]), axis=1).T
        right = np.concatenate((known[self._upper], (turn - turn.T)[self._above]))
        x = np.linalg.solve(system, -right)
        count = len(self._T)
        return U + np.tensordot(x[:count], V, 1), np.tensordot(x[count:], self._E, 1)
