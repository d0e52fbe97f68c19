"""The continuous algebraic Riccati equation (33): A^T K + K A + Q - K B R^-1 B^T K = 0.

For any number of outputs it is solved by doubling, from no start (:mod:`ffsm_mj._core.riccati_doubling`). For two
there are Newton-Kleinman steps in floats that use the structure of A and B, warm-started from the ticks before and verified
(:mod:`ffsm_mj._core.riccati_planar`); at the first tick of a phase, and where the verification fails, the stable
eigenvectors of the Hamiltonian, polished, take over, and where that is not good enough, doubling. Both are counted as
fallbacks.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ffsm_mj._core.riccati_doubling import Doubling
from ffsm_mj._core.riccati_planar import PlanarRiccati
from ffsm_mj.arrays import FloatArray

if TYPE_CHECKING:
    from ffsm_mj._core.riccati_planar import Blocks, Matrix, Pair, Weight

# What eigenvectors may leave near singular poses.
_TOLERATED_RESIDUAL = 1e-9


def planar_riccati(Q: FloatArray) -> PlanarRiccati:
    """The solver for two outputs and their weight Q, (4, 4)."""
    return PlanarRiccati((_flat(Q[:2, :2]), _flat(Q[:2, 2:]), _flat(Q[2:, 2:])), planar_robust)


def planar_robust(A21: Matrix, A22: Matrix, S: Pair, Q: Weight) -> tuple[Blocks, float]:
    """P2 and P3 of a planar equation without a start, and the relative residual.

    Raises:
        RiccatiError: There is no stabilising solution, or rounding hides it.
    """
    lower, upper, Q1, Q12, Q3 = (np.reshape(block, (2, 2)) for block in (A21, A22, *Q))
    weight = np.block([[Q1, Q12], [Q12.T, Q3]])
    A, wide = np.zeros((4, 4)), np.diag((0.0, 0.0, *S))
    A[:2, 2:], A[2:, :2], A[2:, 2:] = np.eye(2), lower, upper
    K = from_eigenvectors(A, wide, weight)
    if K is not None:
        residual = relative_residual(A, wide, weight, K)
        if residual <= _TOLERATED_RESIDUAL and _stabilises(A, wide, K):
            return (_flat(K[:2, 2:]), _flat(K[2:, 2:])), residual
    K_lower, residual = Doubling(weight).solve(lower, upper, np.diag(S))
    return (_flat(K_lower[:, :2].T), _flat(K_lower[:, 2:])), residual


def _stabilises(A: FloatArray, S: FloatArray, K: FloatArray) -> bool:
    return bool(np.all(np.isfinite(K)) and np.linalg.eigvals(A - S @ K).real.max() < 0.0)


def _flat(block: FloatArray) -> Matrix:
    a, b, c, d = np.ravel(block).tolist()
    return a, b, c, d


def relative_residual(A: FloatArray, S: FloatArray, Q: FloatArray, K: FloatArray) -> float:
    """Largest entry of the equation's left side over the largest entry of its terms."""
    linear, quadratic = A.T @ K, K @ S @ K
    scale = max(np.abs(linear).max(), np.abs(quadratic).max(), np.abs(Q).max())
    return float(np.abs(linear + linear.T + Q - quadratic).max() / scale)


def from_eigenvectors(A: FloatArray, S: FloatArray, Q: FloatArray) -> FloatArray | None:
    """K = X2 X1^-1 from the n stable eigenvectors [X1; X2] of the Hamiltonian, after a Newton step where that is better.

    Args:
        A: State matrix, (n, n).
        S: B R^-1 B^T, (n, n), symmetric positive semidefinite.
        Q: State weight, (n, n), symmetric positive semidefinite.

    Returns:
        K, (n, n), not verified; None where the stable eigenvectors are not n, or not regular.
    """
    n = len(A)
    hamiltonian = np.empty((2 * n, 2 * n))
    hamiltonian[:n, :n], hamiltonian[:n, n:] = A, -S
    hamiltonian[n:, :n], hamiltonian[n:, n:] = -Q, -A.T
    try:
        values, vectors = np.linalg.eig(hamiltonian)
        stable = vectors[:, values.real < 0.0]
        if stable.shape[1] != n:
            return None
        K = np.asarray(np.linalg.solve(stable[:n].T, stable[n:].T).real, dtype=np.float64)
    except np.linalg.LinAlgError:
        return None
    return _polished(A, S, Q, np.asarray(0.5 * (K + K.T)))


def _polished(A: FloatArray, S: FloatArray, Q: FloatArray, K: FloatArray) -> FloatArray:
    """One Newton-Kleinman step, kept where it lowers the residual."""
    n = len(A)
    closed = A - S @ K
    operator = np.kron(closed.T, np.eye(n)) + np.kron(np.eye(n), closed.T)
    try:
        better = np.linalg.solve(operator, -(Q + K @ S @ K).ravel()).reshape(n, n)
    except np.linalg.LinAlgError:
        return K
    better = 0.5 * (better + better.T)
    return better if relative_residual(A, S, Q, better) < relative_residual(A, S, Q, K) else K
