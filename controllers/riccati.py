"""The continuous algebraic Riccati equation (33): A^T K + K A + Q - K B R^-1 B^T K = 0.

The loop solves it from the stable eigenvectors of the Hamiltonian, which takes a tenth of SciPy's Schur method for matrices
this small; every solution is verified, and SciPy takes over where the verification fails.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ffsm_mj.model import FloatArray

# The residual of SciPy's solution is about 1e-13 on the case study; eigenvectors lose a few digits near repeated roots.
_ACCEPTED_RESIDUAL = 1e-9


class RiccatiError(ArithmeticError):
    """No stabilising solution was found."""


@dataclass(frozen=True)
class RiccatiSolution:
    """Stabilising solution K, its residual relative to the largest term, and whether the fallback made it."""

    K: FloatArray
    residual: float
    fallback: bool


def solve_care(A: FloatArray, S: FloatArray, Q: FloatArray) -> RiccatiSolution:
    """Stabilising solution of A^T K + K A + Q - K S K = 0.

    Args:
        A: State matrix, (n, n).
        S: B R^-1 B^T, (n, n), symmetric positive semidefinite.
        Q: State weight, (n, n), symmetric positive semidefinite.

    Raises:
        RiccatiError: Neither method finds a stabilising solution.
    """
    K = _from_eigenvectors(A, S, Q)
    if K is not None:
        residual = relative_residual(A, S, Q, K)
        if residual <= _ACCEPTED_RESIDUAL:
            return RiccatiSolution(K, residual, fallback=False)
    K = _from_scipy(A, S, Q)
    return RiccatiSolution(K, relative_residual(A, S, Q, K), fallback=True)


def relative_residual(A: FloatArray, S: FloatArray, Q: FloatArray, K: FloatArray) -> float:
    """Largest entry of the equation's left side over the largest entry of its terms."""
    linear, quadratic = A.T @ K, K @ S @ K
    scale = max(np.abs(linear).max(), np.abs(quadratic).max(), np.abs(Q).max())
    return float(np.abs(linear + linear.T + Q - quadratic).max() / scale)


def _from_eigenvectors(A: FloatArray, S: FloatArray, Q: FloatArray) -> FloatArray | None:
    """K = X2 X1^-1 from the n stable eigenvectors [X1; X2] of the Hamiltonian; None where they are not n or not regular."""
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
    return np.asarray(0.5 * (K + K.T))


def _from_scipy(A: FloatArray, S: FloatArray, Q: FloatArray) -> FloatArray:
    from scipy.linalg import solve_continuous_are  # half a second to import, needed at near-singular poses only

    values, vectors = np.linalg.eigh(S)
    factor = vectors * np.sqrt(np.clip(values, 0.0, None))
    try:
        K: FloatArray = solve_continuous_are(A, factor, Q, np.eye(len(A)))
    except (np.linalg.LinAlgError, ValueError) as error:
        raise RiccatiError(f"the Riccati equation has no stabilising solution here ({error})") from error
    return K
