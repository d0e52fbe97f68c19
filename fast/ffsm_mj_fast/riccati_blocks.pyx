# cython: boundscheck=False, wraparound=False, cdivision=True
"""Newton-Kleinman steps for the Riccati equation of p outputs; the twin of ffsm_controllers.osdre.riccati_blocks.

Unknown are the entries above the diagonal of the antisymmetric T, then those on and above it of the symmetric X3. The equations
are those of the same entries of X1 - X1^T and of the lower right block.
"""

import numpy as np

from ffsm_controllers.osdre import riccati_blocks as plain

from libc.math cimport fabs, isfinite

cdef int ITERATIONS = plain._ITERATIONS
cdef double LAST_CHANGE = plain._LAST_CHANGE


cdef void product(const double[:, ::1] a, const double[:, ::1] b, double[:, ::1] out) noexcept:
    """out = a b."""
    cdef Py_ssize_t i, j, k, p = a.shape[0]
    for i in range(p):
        for j in range(p):
            out[i, j] = 0.0
            for k in range(p):
                out[i, j] += a[i, k] * b[k, j]


cdef bint eliminate(double[:, ::1] a) noexcept:
    """Gauss-Jordan with partial pivoting on n rows [a | b]: b becomes a^-1 b. False where a is singular."""
    cdef Py_ssize_t i, j, k, best, n = a.shape[0], m = a.shape[1]
    cdef double factor, swapped
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if fabs(a[i, k]) > fabs(a[best, k]):
                best = i
        if not fabs(a[best, k]) > 0.0:
            return False
        if best != k:
            for j in range(k, m):
                swapped, a[k, j] = a[k, j], a[best, j]
                a[best, j] = swapped
        for j in range(k + 1, m):
            a[k, j] /= a[k, k]
        for i in range(n):
            if i != k:
                factor = a[i, k]
                for j in range(k + 1, m):
                    a[i, j] -= factor * a[k, j]
    return True


cdef class BlockNewton:
    """Solver for one state weight."""

    cdef Py_ssize_t p
    cdef const double[:, ::1] Q1, Q12, Q3
    cdef double[:, ::1] P2, P3, M, N, F, G, U, W, turn, wide, system

    def __init__(self, Q):
        p = self.p = len(Q) // 2
        self.Q1, self.Q12, self.Q3 = Q[:p, :p].copy(), Q[:p, p:].copy(), Q[p:, p:].copy()
        self.P2, self.P3, self.M, self.N, self.F, self.G, self.U, self.W, self.turn = np.zeros((9, p, p))
        self.wide, self.system = np.zeros((p, 2 * p)), np.zeros((p * p, p * p + 1))

    def solve(self, double[:, :] A21, double[:, :] A22, double[:, :] S, double[:, :] start):
        """Iterate from [P2^T, P3] (p, 2 p) until steps are rounding; K, or None where the iteration breaks down."""
        cdef Py_ssize_t i, j, p = self.p
        cdef double change2, change3, size2, size3
        if not (A21.shape[0] == A22.shape[0] == S.shape[0] == start.shape[0] == p and start.shape[1] == 2 * p):
            raise ValueError(f"blocks of another size than {p}")
        cdef const double[:, ::1] a21 = np.ascontiguousarray(A21), a22 = np.ascontiguousarray(A22), s = np.ascontiguousarray(S)
        for i in range(p):
            for j in range(p):
                self.P2[i, j], self.P3[i, j] = start[j, i], start[i, p + j]
        for _ in range(ITERATIONS):
            # U and W take the new P2 and P3.
            if not self.step(a21, a22, s):
                return None
            change2 = change3 = size2 = size3 = 0.0
            for i in range(p):
                for j in range(p):
                    change2, size2 = larger(change2, self.U[i, j] - self.P2[i, j]), larger(size2, self.U[i, j])
                    change3, size3 = larger(change3, self.W[i, j] - self.P3[i, j]), larger(size3, self.W[i, j])
            self.P2[:], self.P3[:] = self.U, self.W
            if not change2 + change3 > LAST_CHANGE * (size2 + size3):
                break
        return self.whole(a21, a22, s)

    cdef bint step(self, const double[:, ::1] A21, const double[:, ::1] A22, const double[:, ::1] S) noexcept:
        """One Newton-Kleinman step; False where it is not defined."""
        cdef Py_ssize_t i, j, k, row, column, p = self.p, unknown = p * p
        cdef double v
        for i in range(p):
            for j in range(p):
                self.M[i, j] = self.N[i, j] = 0.0
                for k in range(p):
                    self.M[i, j] += S[i, k] * self.P2[j, k]
                    self.N[i, j] += S[i, k] * self.P3[k, j]
        for i in range(p):
            for j in range(p):
                self.F[i, j], self.G[i, j] = A21[i, j] - self.M[i, j], A22[i, j] - self.N[i, j]
                self.wide[i, j], self.wide[i, p + j] = self.F[i, j], 1.0 if i == j else 0.0
        if not eliminate(self.wide):
            return False
        product(self.P2, self.M, self.W)
        for i in range(p):
            for j in range(p):
                self.W[i, j] += self.Q1[i, j]
        for i in range(p):
            for j in range(p):
                self.U[i, j] = 0.0
                for k in range(p):
                    self.U[i, j] -= 0.5 * self.W[i, k] * self.wide[k, p + j]
        product(self.P3, self.N, self.W)
        product(self.P2, self.N, self.turn)
        for i in range(p):
            for j in range(p):
                self.W[i, j] += self.Q3[i, j]
                self.turn[i, j] += self.Q12[i, j]
                for k in range(p):
                    self.turn[i, j] += self.U[i, k] * self.G[k, j]
        self.system[:] = 0.0
        row = 0
        for i in range(p):
            for j in range(i, p):
                self.system[row, unknown] = -(self.W[i, j] + self.U[i, j] + self.U[j, i])
                self.fill(row, i, j, 1.0)
                row += 1
        for i in range(p):
            for j in range(i + 1, p):
                self.system[row, unknown] = -(self.turn[i, j] - self.turn[j, i])
                self.fill(row, i, j, -1.0)
                row += 1
        if not eliminate(self.system):
            return False
        column = 0
        for i in range(p):
            for j in range(i + 1, p):
                v = self.system[column, unknown]
                for k in range(p):
                    self.U[i, k] += v * self.wide[j, p + k]
                    self.U[j, k] -= v * self.wide[i, p + k]
                column += 1
        for i in range(p):
            for j in range(i, p):
                self.W[i, j] = self.W[j, i] = self.system[column, unknown]
                column += 1
        return True

    cdef void fill(self, Py_ssize_t row, Py_ssize_t a, Py_ssize_t b, double sign) noexcept:
        """Coefficients of entry (a, b), plus or minus (b, a): of V or V G for T, of E G or F^T E for X3."""
        cdef Py_ssize_t i, j, column = 0, p = self.p
        for i in range(p):
            for j in range(i + 1, p):
                self.system[row, column] = self.of_T(i, j, a, b, sign) + sign * self.of_T(i, j, b, a, sign)
                column += 1
        for i in range(p):
            for j in range(i, p):
                self.system[row, column] = self.of_E(i, j, a, b, sign) + sign * self.of_E(i, j, b, a, sign)
                column += 1

    cdef double of_T(self, Py_ssize_t i, Py_ssize_t j, Py_ssize_t a, Py_ssize_t b, double sign) noexcept:
        """Entry (a, b) of V = T F^-1 (sign 1) or V G (sign -1), with T one at (i, j) and minus one at (j, i)."""
        cdef Py_ssize_t k, p = self.p
        cdef Py_ssize_t row = j if a == i else i
        cdef double total = 0.0
        if a != i and a != j:
            return 0.0
        if sign > 0.0:
            total = self.wide[row, p + b]
        else:
            for k in range(p):
                total += self.wide[row, p + k] * self.G[k, b]
        return total if a == i else -total

    cdef double of_E(self, Py_ssize_t i, Py_ssize_t j, Py_ssize_t a, Py_ssize_t b, double sign) noexcept:
        """Entry (a, b) of E G (sign 1) or F^T E (sign -1), with the symmetric E one at (i, j) and (j, i)."""
        cdef double total = 0.0
        if sign > 0.0:
            if a == i:
                total += self.G[j, b]
            if a == j and i != j:
                total += self.G[i, b]
        else:
            if b == j:
                total += self.F[i, a]
            if b == i and i != j:
                total += self.F[j, a]
        return total

    def whole(self, const double[:, ::1] A21, const double[:, ::1] A22, const double[:, ::1] S):
        """K of the present P2 and P3, or None where it is not finite."""
        cdef Py_ssize_t i, j, k, p = self.p
        cdef double value
        cdef bint finite = True
        K = np.empty((2 * p, 2 * p))
        cdef double[:, ::1] out = K
        product(S, self.P3, self.N)
        for i in range(p):
            for j in range(p):
                value = -self.Q12[i, j]
                for k in range(p):
                    value += self.P2[i, k] * (self.N[k, j] - A22[k, j]) - A21[k, i] * self.P3[k, j]
                self.M[i, j] = value
        for i in range(p):
            for j in range(p):
                out[i, j], out[i, p + j] = 0.5 * (self.M[i, j] + self.M[j, i]), self.P2[i, j]
                out[p + j, i], out[p + i, p + j] = self.P2[i, j], self.P3[i, j]
                finite = finite and isfinite(out[i, j]) and isfinite(self.P2[i, j]) and isfinite(self.P3[i, j])
        return K if finite else None


cdef double larger(double a, double b) noexcept:
    """The larger of a and the size of b, NaN where b is."""
    return a if fabs(b) <= a else fabs(b)
