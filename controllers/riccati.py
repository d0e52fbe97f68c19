"""The continuous algebraic Riccati equation (33): A^T K + K A + Q - K B R^-1 B^T K = 0.

For two outputs the loop solves it by :mod:`controllers.riccati_planar`, warm-started from the tick before and verified; for
three, and wherever the verification fails, from the stable eigenvectors of the Hamiltonian, polished by a Newton-Kleinman
step; where that is not good enough SciPy's Schur method takes over.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controllers.riccati_planar import Matrix, PlanarWeight, extrapolated, newton, principal_axes, turned
from ffsm_mj.model import FloatArray

ACCEPTED_RESIDUAL = 1e-13
"""Relative residual at which a solution counts as exact to rounding."""
# What the robust methods may leave near singular poses.
_TOLERATED_RESIDUAL = 1e-9
_REMEMBERED = 3


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


class PlanarRiccati:
    """The equation of two outputs from tick to tick."""

    def __init__(self, Q: FloatArray) -> None:
        """Take the state weight apart."""
        self._Q = Q
        self._weight = PlanarWeight(_flat(Q[:2, :2]), _flat(Q[:2, 2:]), _flat(Q[2:, 2:]))
        self._isotropic = all((a, b, c) == (d, 0.0, 0.0) for a, b, c, d in self._weight)
        self.forget()

    def forget(self) -> None:
        """Start cold at the next tick."""
        self._history: list[tuple[Matrix, Matrix]] = []

    def solve(self, A21: Matrix, A22: Matrix, S: Matrix) -> tuple[Matrix, Matrix, float, bool]:
        """P2, P3, relative residual, and whether the warm start failed and a robust method was needed.

        Raises:
            RiccatiError: No method finds a stabilising solution.
        """
        history = self._history
        # Along the principal axes of S nothing cancels, however near the pose is to a singular one.
        axes, principal = principal_axes(S)
        back = (axes[0], -axes[1])
        Q = self._weight
        if not self._isotropic:
            Q = PlanarWeight(turned(Q.position, axes), turned(Q.coupling, axes), turned(Q.rate, axes))
        along = (turned(A21, axes), turned(A22, axes), principal, Q)
        if history:
            solution = newton(*along, self._guess())
            if solution is not None and solution.residual <= ACCEPTED_RESIDUAL:
                history.append((solution.P2, solution.P3))
                del history[:-_REMEMBERED]
                return turned(solution.P2, back), turned(solution.P3, back), solution.residual, False
        robust = self._robust(A21, A22, S)
        P2, P3 = _flat(robust.K[:2, 2:]), _flat(robust.K[2:, 2:])
        self._history = [(turned(P2, axes), turned(P3, axes))]
        solution = newton(*along, self._history[0])
        if solution is None or solution.residual > robust.residual:
            return P2, P3, robust.residual, bool(history)
        self._history = [(solution.P2, solution.P3)]
        return turned(solution.P2, back), turned(solution.P3, back), solution.residual, bool(history)

    def _guess(self) -> tuple[Matrix, Matrix]:
        """Where the solution is heading: the quadratic through the last three ticks, which mostly saves two iterations."""
        if len(self._history) < _REMEMBERED:
            return self._history[-1]
        return extrapolated(*self._history)

    def _robust(self, A21: Matrix, A22: Matrix, S: Matrix) -> RiccatiSolution:
        A, wide = np.zeros((4, 4)), np.zeros((4, 4))
        A[:2, 2:] = np.eye(2)
        A[2:, :2], A[2:, 2:] = np.reshape(A21, (2, 2)), np.reshape(A22, (2, 2))
        wide[2:, 2:] = np.reshape(S, (2, 2))
        return solve_care(A, wide, self._Q)


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
