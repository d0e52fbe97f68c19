"""The continuous algebraic Riccati equation (33): A^T K + K A + Q - K B R^-1 B^T K = 0.

In the loop it is solved by Newton-Kleinman steps that use the structure of A and B, warm-started from the ticks before and
verified: in floats for two outputs (:mod:`~ffsm_controllers.osdre.riccati_planar`), in small arrays for any other number
(:mod:`~ffsm_controllers.osdre.riccati_blocks`). At the first tick of a phase, and where the verification fails, the stable
eigenvectors of the Hamiltonian, polished, take over; where that is not good enough, SciPy's Schur method. Both are
counted as fallbacks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ffsm_controllers.osdre.riccati_blocks import BlockNewton
from ffsm_controllers.osdre.riccati_planar import ACCEPTED_RESIDUAL, Blocks, Matrix, Pair, PlanarRiccati, Weight
from ffsm_mj.arrays import FloatArray
from ffsm_mj.compiled import fastest

# What the robust methods may leave near singular poses.
_TOLERATED_RESIDUAL = 1e-9


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
        K = _polished(A, S, Q, K)
        residual = relative_residual(A, S, Q, K)
        if residual <= _TOLERATED_RESIDUAL and _stabilises(A, S, K):
            return RiccatiSolution(K, residual, fallback=False)
    K = _polished(A, S, Q, _from_scipy(A, S, Q))
    if not _stabilises(A, S, K):
        raise RiccatiError("the Riccati equation has no stabilising solution here")
    return RiccatiSolution(K, relative_residual(A, S, Q, K), fallback=True)


def _stabilises(A: FloatArray, S: FloatArray, K: FloatArray) -> bool:
    return bool(np.all(np.isfinite(K)) and np.linalg.eigvals(A - S @ K).real.max() < 0.0)


def planar_riccati(Q: FloatArray) -> PlanarRiccati:
    """The solver for two outputs and their weight Q, (4, 4); compiled where it can be."""
    return fastest(PlanarRiccati)((_flat(Q[:2, :2]), _flat(Q[:2, 2:]), _flat(Q[2:, 2:])), _planar_robust)


def _planar_robust(A21: Matrix, A22: Matrix, S: Pair, Q: Weight) -> tuple[Blocks, float]:
    A21_, A22_, Q1, Q12, Q3 = (np.reshape(block, (2, 2)) for block in (A21, A22, *Q))
    solution = solve_care(*_wide(A21_, A22_, np.diag(S)), np.block([[Q1, Q12], [Q12.T, Q3]]))
    return (_flat(solution.K[:2, 2:]), _flat(solution.K[2:, 2:])), solution.residual


class BlockRiccati:
    """The equation of any number of outputs p from tick to tick."""

    def __init__(self, Q: FloatArray) -> None:
        """Start cold, with a state weight (2 p, 2 p)."""
        self._Q, self._newton = Q, fastest(BlockNewton)(Q)
        self._history: tuple[FloatArray, FloatArray, FloatArray] | None = None

    def solve(self, A21: FloatArray, A22: FloatArray, S: FloatArray) -> tuple[FloatArray, float, bool]:
        """[P2^T, P3] (p, 2 p), relative residual, and whether the robust method was needed: no warm start, or it failed.

        Raises:
            RiccatiError: No method finds a stabilising solution.
        """
        history, p = self._history, len(S)
        A, wide = _wide(A21, A22, S)
        if history is not None:
            first, second, third = history
            K = self._newton.solve(A21, A22, S, first + 3.0 * (third - second))
            if K is not None:
                residual = relative_residual(A, wide, self._Q, K)
                if residual <= ACCEPTED_RESIDUAL and _stabilises(A, wide, K):
                    self._history = second, third, K[p:]
                    return K[p:], residual, False
        robust = solve_care(A, wide, self._Q)
        K, residual = robust.K, robust.residual
        better = self._newton.solve(A21, A22, S, K[p:])
        if better is not None and _stabilises(A, wide, better):
            left = relative_residual(A, wide, self._Q, better)
            K, residual = (better, left) if left < residual else (K, residual)
        self._history = K[p:], K[p:], K[p:]
        return K[p:], residual, True


def _wide(A21: FloatArray, A22: FloatArray, S: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A and B R^-1 B^T of the output stack from their lower blocks."""
    p = len(S)
    A, wide = np.zeros((2 * p, 2 * p)), np.zeros((2 * p, 2 * p))
    A[:p, p:] = np.eye(p)
    A[p:, :p], A[p:, p:], wide[p:, p:] = A21, A22, S
    return A, wide


def _flat(block: FloatArray) -> Matrix:
    a, b, c, d = np.ravel(block).tolist()
    return a, b, c, d


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


def _from_scipy(A: FloatArray, S: FloatArray, Q: FloatArray) -> FloatArray:
    from scipy.linalg import solve_continuous_are  # half a second to import, needed at near-singular poses only

    values, vectors = np.linalg.eigh(S)
    factor = vectors * np.sqrt(np.clip(values, 0.0, None))
    try:
        K: FloatArray = solve_continuous_are(A, factor, Q, np.eye(len(A)))
    except (np.linalg.LinAlgError, ValueError) as error:
        raise RiccatiError(f"the Riccati equation has no stabilising solution here ({error})") from error
    return K
