"""Structure-preserving doubling for the Riccati equation of any number of outputs (Chu, Fan & Lin 2005).

A Cayley transform with a shift gamma > 0 turns A^T K + K A + Q - K S K = 0 into a Stein equation of the same K. With
V = (I + G H)^-1 a step a <- a V a, G <- G + a V G a^T, H <- H + a^T H V a doubles the horizon that H has seen: H converges
to K as a vanishes, quadratically, from no start at all, and a vanishes only where the closed loop is stable. Where rounding
leaves too much of the equation, a step of Newton's method takes it away: with A - S K for A, and so little left that its
square is nothing, the same doubling goes without G.

The package ``ffsm-mj-fast`` has a twin of :class:`Doubling` in loops.
"""

from __future__ import annotations

import math

import numpy as np

from ffsm_controllers.osdre.riccati_planar import ACCEPTED_RESIDUAL
from ffsm_mj.arrays import FloatArray

_DOUBLINGS = 60
_CORRECTIONS = 3
# What a doubling adds to H is of the order of |a|^2: beyond this it is rounding, or little of a correction.
_VANISHED = 1e-17
_NEARLY_VANISHED = 1e-5
_TOLERATED_RESIDUAL = 1e-6
# A shift that happens to be an eigenvalue of A is of no use; one of these is none.
_SHIFTS = (1.0, 1.9, 0.53)


class RiccatiError(ArithmeticError):
    """No stabilising solution was found."""


class Doubling:
    """Solver for one state weight. It remembers nothing from one equation to the next.

    Attributes:
        doublings: How many the last solution took, without those of its corrections.
        corrections: How often the last solution was corrected for what rounding had left.
    """

    def __init__(self, Q: FloatArray) -> None:
        """Take a state weight, (2 p, 2 p)."""
        from scipy.linalg.lapack import dgesv  # a third of a second to import

        n, self._dgesv = len(Q), dgesv
        self._p, self._Q, self._size = n // 2, Q, float(Q.ravel().dot(Q.ravel()))
        self._largest = float(np.abs(Q).max())
        self._A, self._S, self._one = np.zeros((n, n)), np.zeros((n, n)), np.eye(n)
        self._A[: self._p, self._p :] = np.eye(self._p)
        self._room = tuple(np.empty((6, n, n)))  # of products: where they go takes as long as what they do
        self.doublings = self.corrections = 0

    def solve(self, A21: FloatArray, A22: FloatArray, S: FloatArray) -> tuple[FloatArray, float]:
        """[P2^T, P3] (p, 2 p), and what is left of the equation relative to its largest term.

        Args:
            A21: Lower left block of A, (p, p).
            A22: Lower right block of A, (p, p).
            S: B2 R^-1 B2^T, (p, p).

        Raises:
            RiccatiError: There is no stabilising solution, or rounding hides it.
        """
        p = self._p
        self._A[p:, :p], self._A[p:, p:], self._S[p:, p:] = A21, A22, S
        # The geometric mean of the sizes that poles of a double integrator have under these weights.
        shift = (float(S.ravel().dot(S.ravel())) * self._size) ** 0.125
        self.doublings = self.corrections = 0
        for factor in _SHIFTS:
            K, residual = self._corrected(factor * shift)
            if K is None or not residual <= _TOLERATED_RESIDUAL:
                continue
            # Near singular poses rounding leaves more: then the eigenvalues must prove the closed loop stable.
            if residual <= ACCEPTED_RESIDUAL or self._stabilises(K):
                return K[p:], residual
        raise RiccatiError("the Riccati equation has no stabilising solution here")

    def _corrected(self, shift: float) -> tuple[FloatArray | None, float]:
        """K with one shift, corrected until what is left is rounding or grows no smaller; None where a does not vanish."""
        try:
            K = self._doubled(shift)
            if K is None:
                return None, math.inf
            rest, residual = self._defect(K)
            while residual > ACCEPTED_RESIDUAL and self.corrections < _CORRECTIONS:
                better = K + self._lacking(K, rest, shift)
                rest, left = self._defect(better)
                if not left < residual:
                    break
                K, residual = better, left
        except np.linalg.LinAlgError:
            return None, math.inf
        return K, residual

    def _doubled(self, shift: float) -> FloatArray | None:
        """K with one shift; None where a does not vanish."""
        inverse, one, twice = self._inverse, self._one, 2.0 * shift
        shifted = self._A - shift * one
        left = inverse(shifted)
        G = left.dot(self._S)
        W = inverse(shifted.T + self._Q.dot(G))
        G = twice * G.dot(W)
        H = twice * W.dot(self._Q.dot(left))
        a, after, Va, aV, T, U = self._room
        np.multiply(W.T, twice, a)
        a += one
        for _ in range(_DOUBLINGS):
            self.doublings += 1
            G.dot(H, T)
            T += one
            V = inverse(T)
            V.dot(a, Va)
            a.T.dot(H.dot(Va, U), T)
            H += T
            a.dot(V, aV)
            a.dot(Va, after)
            flat = after.ravel()
            size = float(flat.dot(flat))
            if size <= _VANISHED:
                return np.asarray(0.5 * (H + H.T))
            if not size < math.inf:
                return None
            aV.dot(G, T).dot(a.T, U)
            G += U
            a, after = after, a
        return None

    def _lacking(self, K: FloatArray, rest: FloatArray, shift: float) -> FloatArray:
        """A Newton step from a stabilising K that leaves a rest of the equation."""
        self.corrections += 1
        left = self._inverse(self._A - self._S.dot(K) - shift * self._one)
        a = 2.0 * shift * left + self._one
        H = 2.0 * shift * left.T.dot(rest).dot(left)
        for _ in range(_DOUBLINGS):
            H += a.T.dot(H).dot(a)
            a = a.dot(a)
            if not a.ravel().dot(a.ravel()) > _NEARLY_VANISHED:
                break
        return np.asarray(0.5 * (H + H.T))

    def _inverse(self, M: FloatArray) -> FloatArray:
        """M^-1, by LAPACK itself: numpy's way there takes three times as long.

        Raises:
            LinAlgError: M is singular.
        """
        _, _, inverse, info = self._dgesv(M, self._one)
        if info:
            raise np.linalg.LinAlgError
        return np.asarray(inverse)

    def _defect(self, K: FloatArray) -> tuple[FloatArray, float]:
        """What K leaves of the equation, and its greatest entry over the greatest of the terms."""
        linear, KS, quadratic, *_ = self._room
        K.dot(self._A, linear)
        K.dot(self._S, KS).dot(K, quadratic)
        rest = linear + linear.T
        rest += self._Q
        rest -= quadratic
        scale = max(float(np.abs(linear).max()), float(np.abs(quadratic).max()), self._largest)
        return rest, float(np.abs(rest).max()) / scale

    def _stabilises(self, K: FloatArray) -> bool:
        return bool(np.linalg.eigvals(self._A - self._S.dot(K)).real.max() < 0.0)
