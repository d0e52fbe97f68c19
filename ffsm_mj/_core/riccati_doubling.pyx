# cython: boundscheck=False, wraparound=False, cdivision=True
"""Structure-preserving doubling for the Riccati equation of any number of outputs (Chu, Fan & Lin 2005).

A Cayley transform with a shift gamma > 0 turns A^T K + K A + Q - K S K = 0 into a Stein equation of the same K. With
V = (I + G H)^-1 a step a <- a V a, G <- G + a V G a^T, H <- H + a^T H V a doubles the horizon that H has seen: H converges
to K as a vanishes, quadratically, from no start at all, and a vanishes only where the closed loop is stable. Where rounding
leaves too much of the equation, a step of Newton's method takes it away: with A - S K for A, and so little left that its
square is nothing, the same doubling goes without G.

Matrices have n = 2 p rows and are contiguous; products and eliminations loop over rows, which the compiler vectorises.
"""

import numpy as np

from ffsm_mj._core.riccati_planar import ACCEPTED_RESIDUAL

from libc.math cimport fabs, INFINITY, pow
from libc.string cimport memcpy, memset

# What a doubling adds to H is of the order of |a|^2: beyond this it is rounding, or little of a correction.
cdef double VANISHED = 1e-17
cdef double NEARLY_VANISHED = 1e-5
cdef double _ACCEPTED_RESIDUAL = ACCEPTED_RESIDUAL
cdef double TOLERATED_RESIDUAL = 1e-6
cdef int DOUBLINGS = 60
cdef int CORRECTIONS = 3
# Shifts in units of the magnitude of the poles. One that happens to be an eigenvalue of A is of no use: the others are about
# twice and half the first, so that doubling is nearly as fast, and in no simple ratio, so that one of the three is none.
SHIFTS = (1.0, 1.9, 0.53)


class RiccatiError(ArithmeticError):
    """No stabilising solution was found."""


cdef void add_product(double sign, const double* a, const double* b, Py_ssize_t wide, double* out, Py_ssize_t n) noexcept nogil:
    """out += sign a b, for rows of b of this width."""
    cdef Py_ssize_t i, j, k
    cdef double factor
    for i in range(n):
        for k in range(n):
            factor = sign * a[n * i + k]
            for j in range(n):
                out[n * i + j] += factor * b[wide * k + j]


cdef void product(const double* a, const double* b, Py_ssize_t wide, double* out, Py_ssize_t n) noexcept nogil:
    """out = a b."""
    memset(out, 0, n * n * sizeof(double))
    add_product(1.0, a, b, wide, out, n)


cdef void add_transposed_product(const double* a, const double* b, double* out, Py_ssize_t n) noexcept nogil:
    """out += a^T b."""
    cdef Py_ssize_t i, j, k
    cdef double factor
    for k in range(n):
        for i in range(n):
            factor = a[n * k + i]
            for j in range(n):
                out[n * i + j] += factor * b[n * k + j]


cdef void add_product_transposed(const double* a, const double* b, double* out, Py_ssize_t n) noexcept nogil:
    """out += a b^T."""
    cdef Py_ssize_t i, j, k
    cdef double total
    for i in range(n):
        for j in range(n):
            total = 0.0
            for k in range(n):
                total += a[n * i + k] * b[n * j + k]
            out[n * i + j] += total


cdef bint eliminate(double* a, Py_ssize_t n, Py_ssize_t wide) noexcept nogil:
    """Gauss-Jordan with partial pivoting on n rows [a | b]: b becomes a^-1 b. Returns False if a is singular."""
    cdef Py_ssize_t i, j, k, best
    cdef double factor, swapped
    cdef double* pivot
    cdef double* row
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if fabs(a[wide * i + k]) > fabs(a[wide * best + k]):
                best = i
        pivot, row = a + wide * k, a + wide * best
        # Zero or NaN: A minus the shift is singular, and another shift is tried.
        if not fabs(row[k]) > 0.0:
            return False
        if best != k:
            for j in range(k, wide):
                swapped = pivot[j]
                pivot[j] = row[j]
                row[j] = swapped
        factor = 1.0 / pivot[k]
        for j in range(k + 1, wide):
            pivot[j] *= factor
        for i in range(n):
            if i != k:
                row = a + wide * i
                factor = row[k]
                for j in range(k + 1, wide):
                    row[j] -= factor * pivot[j]
    return True


cdef double greatest(const double* a, Py_ssize_t count) noexcept nogil:
    """Largest magnitude of an entry; NaN if an entry is NaN."""
    cdef double largest = 0.0
    cdef Py_ssize_t i
    for i in range(count):
        if not fabs(a[i]) <= largest:
            largest = fabs(a[i])
    return largest


cdef class Doubling:
    """Solver for one state weight."""

    def __init__(self, Q):
        n = self.n = len(Q)
        self.p, self.Q = n // 2, np.array(Q, dtype=np.float64, order="C")
        self.size, self.largest = float(np.sum(np.square(Q))), float(np.abs(Q).max())
        self.A, self.S, self.K, self.best, self.rest, self.left, self.W = np.zeros((7, n, n))
        self.a, self.G, self.H, self.new, self.T = np.zeros((5, n, n))
        self.wide = np.zeros((n, 3 * n))
        for i in range(self.p):
            self.A[i, self.p + i] = 1.0

    def solve(self, double[:, :] A21, double[:, :] A22, double[:, :] S):
        """[P2^T, P3] (p, 2 p), and the residual of the equation relative to its largest term.

        Raises:
            RiccatiError: There is no stabilising solution, or rounding hides it.
            ValueError: Blocks of another size.
        """
        cdef Py_ssize_t p = self.p
        if not (A21.shape[0] == A22.shape[0] == S.shape[0] == A21.shape[1] == A22.shape[1] == S.shape[1] == p):
            raise ValueError(f"blocks of another size than {p}")
        self.A[p:, :p] = A21
        self.A[p:, p:] = A22
        self.S[p:, p:] = S
        residual = self.solution()
        return np.array(self.K[p:]), residual

    cdef double solution(self) except -1.0:
        """Compute K for the present A and S; returns its residual."""
        cdef Py_ssize_t i, j, p = self.p
        cdef double shift, residual, square = 0.0
        for i in range(p, self.n):
            for j in range(p, self.n):
                square += self.S[i, j] * self.S[i, j]
        # gamma = (|S| |Q|)^(1/4), here of squared norms: the magnitude of the poles of a double integrator
        # (docs/derivations.md).
        shift = pow(square * self.size, 0.125)
        self.doublings = self.corrections = 0
        for factor in SHIFTS:
            residual = self.corrected(factor * shift)
            # Above the accepted residual rounding hides the equation (S almost singular): the eigenvalues of the closed loop
            # decide then.
            if residual <= _ACCEPTED_RESIDUAL or (residual <= TOLERATED_RESIDUAL and self.stabilises()):
                return residual
        raise RiccatiError("the Riccati equation has no stabilising solution here")

    cdef double corrected(self, double shift) noexcept:
        """Compute K with one shift, and correct it; returns its residual, infinite if a does not vanish."""
        cdef double residual, left
        if not self.doubled(shift):
            return INFINITY
        residual = self.defect()
        # Doubling from a shift far from the poles loses digits; a Newton step from a near solution squares what is left.
        while residual > _ACCEPTED_RESIDUAL and self.corrections < CORRECTIONS:
            self.best[:] = self.K
            # A correction that does not help has met rounding; the last one that did is kept.
            left = self.defect() if self.lacking(shift) else INFINITY
            if not left < residual:
                self.K[:] = self.best
                break
            residual = left
        return residual if residual < INFINITY else INFINITY

    cdef bint doubled(self, double shift) noexcept:
        """Compute K with one shift; returns False if a does not vanish."""
        cdef Py_ssize_t i, j, n = self.n, count = n * n
        cdef double twice = 2.0 * shift, size
        cdef double *a = &self.a[0, 0], *G = &self.G[0, 0], *H = &self.H[0, 0], *T = &self.T[0, 0], *new = &self.new[0, 0]
        cdef double* wide = &self.wide[0, 0]
        # left = (A - shift)^-1, and left S.
        for i in range(n):
            for j in range(n):
                wide[3 * n * i + j] = self.A[i, j] - (shift if i == j else 0.0)
                wide[3 * n * i + n + j] = 1.0 if i == j else 0.0
                wide[3 * n * i + 2 * n + j] = self.S[i, j]
        if not eliminate(wide, n, 3 * n):
            return False
        for i in range(n):
            memcpy(&self.left[i, 0], wide + 3 * n * i + n, n * sizeof(double))
            memcpy(G + n * i, wide + 3 * n * i + 2 * n, n * sizeof(double))
        # W = ((A - shift)^T + Q left S)^-1.
        product(&self.Q[0, 0], G, n, T, n)
        for i in range(n):
            for j in range(n):
                wide[2 * n * i + j] = T[n * i + j] + self.A[j, i] - (shift if i == j else 0.0)
                wide[2 * n * i + n + j] = 1.0 if i == j else 0.0
        if not eliminate(wide, n, 2 * n):
            return False
        for i in range(n):
            for j in range(n):
                self.W[i, j] = twice * wide[2 * n * i + n + j]
        for i in range(n):
            for j in range(n):
                a[n * i + j] = self.W[j, i] + (1.0 if i == j else 0.0)
        product(G, &self.W[0, 0], n, T, n)
        memcpy(G, T, count * sizeof(double))
        product(&self.Q[0, 0], &self.left[0, 0], n, T, n)
        product(&self.W[0, 0], T, n, H, n)
        for _ in range(DOUBLINGS):
            self.doublings += 1
            product(G, H, n, T, n)
            for i in range(n):
                memcpy(wide + 3 * n * i, T + n * i, n * sizeof(double))
                memcpy(wide + 3 * n * i + n, a + n * i, n * sizeof(double))
                memcpy(wide + 3 * n * i + 2 * n, G + n * i, n * sizeof(double))
                # G and H are positive semidefinite, so G H has no negative eigenvalue and I + G H is regular.
                wide[3 * n * i + i] += 1.0
            if not eliminate(wide, n, 3 * n):
                return False
            product(H, wide + n, 3 * n, T, n)
            add_transposed_product(a, T, H, n)
            product(a, wide + n, 3 * n, new, n)
            size = 0.0
            for i in range(count):
                size += new[i] * new[i]
            # a is the Cayley transform of the closed loop to the power 2^k: it vanishes only if that is stable, so this
            # proves the solution.
            if size <= VANISHED:
                for i in range(n):
                    for j in range(n):
                        # H is symmetric but for rounding, which the feedback must not see.
                        self.K[i, j] = 0.5 * (H[n * i + j] + H[n * j + i])
                return True
            # An unstable closed loop makes a grow; NaN ends here too.
            if not size < INFINITY:
                return False
            product(a, wide + 2 * n, 3 * n, T, n)
            add_product_transposed(T, a, G, n)
            memcpy(a, new, count * sizeof(double))
        return False

    cdef bint lacking(self, double shift) noexcept:
        """Add a Newton step to a stabilising K with a residual; returns False if the step is not defined."""
        cdef Py_ssize_t i, j, n = self.n, count = n * n
        cdef double twice = 2.0 * shift, size
        cdef double *a = &self.a[0, 0], *H = &self.H[0, 0], *T = &self.T[0, 0], *new = &self.new[0, 0]
        cdef double* wide = &self.wide[0, 0]
        self.corrections += 1
        product(&self.S[0, 0], &self.K[0, 0], n, T, n)
        for i in range(n):
            for j in range(n):
                wide[2 * n * i + j] = self.A[i, j] - T[n * i + j] - (shift if i == j else 0.0)
                wide[2 * n * i + n + j] = 1.0 if i == j else 0.0
        if not eliminate(wide, n, 2 * n):
            return False
        for i in range(n):
            memcpy(&self.left[i, 0], wide + 2 * n * i + n, n * sizeof(double))
        for i in range(n):
            for j in range(n):
                a[n * i + j] = twice * self.left[i, j] + (1.0 if i == j else 0.0)
        product(&self.rest[0, 0], &self.left[0, 0], n, T, n)
        memset(H, 0, count * sizeof(double))
        add_transposed_product(&self.left[0, 0], T, H, n)
        for i in range(count):
            H[i] *= twice
        for _ in range(DOUBLINGS):
            product(H, a, n, T, n)
            add_transposed_product(a, T, H, n)
            product(a, a, n, new, n)
            memcpy(a, new, count * sizeof(double))
            size = 0.0
            for i in range(count):
                size += a[i] * a[i]
            # The correction is small: it needs few digits, so the doubling may end early.
            if not size > NEARLY_VANISHED:
                break
        for i in range(n):
            for j in range(n):
                self.K[i, j] += 0.5 * (H[n * i + j] + H[n * j + i])
        return True

    cdef double defect(self) noexcept:
        """Compute the residual of K in ``rest``; returns its largest entry over the largest entry of the terms."""
        cdef Py_ssize_t i, j, n = self.n, count = n * n
        cdef double *linear = &self.T[0, 0], *quadratic = &self.new[0, 0], *rest = &self.rest[0, 0]
        cdef double scale
        product(&self.S[0, 0], &self.K[0, 0], n, linear, n)
        product(&self.K[0, 0], linear, n, quadratic, n)
        product(&self.K[0, 0], &self.A[0, 0], n, linear, n)
        for i in range(n):
            for j in range(n):
                rest[n * i + j] = linear[n * i + j] + linear[n * j + i] + self.Q[i, j] - quadratic[n * i + j]
        # Over the largest term, as the terms cancel in a solution.
        scale = max(self.largest, greatest(linear, count), greatest(quadratic, count))
        return greatest(rest, count) / scale

    cdef bint stabilises(self):
        closed = np.asarray(self.A) - np.asarray(self.S) @ np.asarray(self.K)
        return bool(np.linalg.eigvals(closed).real.max() < 0.0)
