# cython: boundscheck=False, wraparound=False, cdivision=True
"""Forces of held rows where no point slides with friction; twin of HeldForces in ffsm_mj...friction.held_rows.

Systems have a few rows: loops are faster than LAPACK, which the original calls for the same factors.
"""

from types import SimpleNamespace

import numpy as np

from ffsm_mj.tolerances import EPSILON, RANK

from libc.math cimport fabs, sqrt
from libc.string cimport memcpy, memset

from ffsm_mj_fast.row_memory cimport RowMemory

cdef double _RANK = RANK
cdef int PASSES = 2  # of orthogonalisation: enough for rounding (Giraud et al. 2005)


cdef Py_ssize_t pivots(double* A, Py_ssize_t n, Py_ssize_t* order) noexcept:
    """Rank of a positive semidefinite matrix by Cholesky's method with pivots, largest first; the matrix is overwritten."""
    cdef Py_ssize_t i, j, l, best
    cdef double largest = 0.0, root, factor
    cdef double* row
    cdef const double* pivot
    for i in range(n):
        order[i] = i
        largest = max(largest, A[i * n + i])
    for j in range(n):
        best = j
        for i in range(j + 1, n):
            if A[order[i] * (n + 1)] > A[order[best] * (n + 1)]:
                best = i
        order[j], order[best] = order[best], order[j]
        pivot = A + order[j] * n
        root = pivot[order[j]]
        if not root > _RANK * largest:
            return j
        for i in range(j + 1, n):
            row = A + order[i] * n
            factor = row[order[j]] / root
            for l in range(n):  # those of earlier pivots are not used again
                row[l] -= factor * pivot[l]
    return n


cdef void orthonormal(double* columns, Py_ssize_t n, Py_ssize_t m) noexcept:
    """Make m independent columns of n numbers, stored one after the other, orthonormal, by Gram and Schmidt, twice."""
    cdef Py_ssize_t i, j, c
    cdef int each
    cdef double product
    cdef double* own
    cdef const double* other
    for c in range(m):
        own = columns + c * n
        for each in range(PASSES):
            for j in range(c):
                other, product = columns + j * n, 0.0
                for i in range(n):
                    product += other[i] * own[i]
                for i in range(n):
                    own[i] -= product * other[i]
        product = 0.0
        for i in range(n):
            product += own[i] * own[i]
        product = 1.0 / sqrt(product)
        for i in range(n):
            own[i] *= product


cdef void reduced(const double* A, const double* U, Py_ssize_t n, Py_ssize_t r, double* half, double* out) noexcept:
    """U^T A U, (r, r), with the columns of U, (n, r), stored one after the other; ``half`` has room for n numbers."""
    cdef Py_ssize_t i, j, l
    cdef double total
    cdef const double* column
    for j in range(r):
        column = U + j * n
        for i in range(n):
            total = 0.0
            for l in range(n):
                total += A[i * n + l] * column[l]
            half[i] = total
        for i in range(r):
            total, column = 0.0, U + i * n
            for l in range(n):
                total += column[l] * half[l]
            out[i * r + j] = total


cdef bint factored(double* A, Py_ssize_t n, Py_ssize_t* order) noexcept:
    """Factor a matrix in place by Gauss's method with partial pivots, with the rows exchanged; whether it is regular."""
    cdef Py_ssize_t i, j, l, best
    cdef double factor
    for j in range(n):
        best = j
        for i in range(j + 1, n):
            if fabs(A[i * n + j]) > fabs(A[best * n + j]):
                best = i
        order[j] = best
        if A[best * n + j] == 0.0:
            return False
        if best != j:
            for l in range(n):
                A[j * n + l], A[best * n + l] = A[best * n + l], A[j * n + l]
        for i in range(j + 1, n):
            factor = A[i * n + j] / A[j * n + j]
            A[i * n + j] = factor
            if factor != 0.0:
                for l in range(j + 1, n):
                    A[i * n + l] -= factor * A[j * n + l]
    return True


cdef void substitute(const double* A, double* b, Py_ssize_t n, const Py_ssize_t* order) noexcept:
    """Solve A x = b in place with a factored matrix."""
    cdef Py_ssize_t i, j
    for j in range(n):
        if order[j] != j:
            b[j], b[order[j]] = b[order[j]], b[j]
    for j in range(n):
        for i in range(j):
            b[j] -= A[j * n + i] * b[i]
    for j in reversed(range(n)):
        for i in range(j + 1, n):
            b[j] -= A[j * n + i] * b[i]
        b[j] /= A[j * n + j]


cdef class HeldForces:
    """The linear problem for the forces of held rows, at one state; under several efforts there."""

    def __init__(self, problem, structure):
        cdef double[:, ::1] G = problem.G
        self.set_up(problem.G, &G[0, 0] if len(G) else NULL, structure)

    cdef int set_up(self, kept, const double* G, structure) except -1:
        """Take a matrix, which an object keeps in memory, and the rows."""
        cdef Py_ssize_t n
        cdef double* start
        self.structure, self.kept = structure, kept
        self.rows, self.count, n = structure.rows, structure.count, len(structure.rows)
        self.held = n
        size = 3 * n * n + 3 * n + 1
        self.memory = bytearray(<Py_ssize_t>sizeof(double) * size + <Py_ssize_t>sizeof(Py_ssize_t) * n)
        start = <double*><char*>self.memory
        self.square, self.basis, self.work, self.half = start, start + n * n, start + 2 * n * n, start + 3 * n * n
        self.right, self.inner = self.half + n, self.half + 2 * n
        self.order = <Py_ssize_t*>(start + <Py_ssize_t>size)
        self.take(G)
        return 0

    cdef void take(self, const double* G) noexcept:
        """Take the matrix of another state, of the same points in the same modes."""
        cdef Py_ssize_t i, j, n = self.held, count = self.count
        cdef const double* row
        cdef double* square = self.square
        self.G, self.factored = G, False
        for i in range(n):
            row = G + self.rows[i] * count
            for j in range(n):
                square[i * n + j] = row[self.rows[j]]
        memcpy(self.work, square, n * n * sizeof(double))
        self.find_range()

    cdef object delassus(self):
        """The matrix as an array."""
        return self.kept.array("G") if isinstance(self.kept, RowMemory) else self.kept

    def __reduce__(self):
        """How a saved state of a simulation holds it."""
        return held_forces, (self.delassus(), self.structure)

    cdef void find_range(self) noexcept:
        """Determine the rank of the held rows, and a basis of their range if it is not all."""
        cdef Py_ssize_t j, n = self.held
        self.rank = pivots(self.work, n, self.order)
        if self.rank < n:
            for j in range(self.rank):
                memcpy(self.basis + j * n, self.square + self.order[j] * n, n * sizeof(double))  # symmetric
            orthonormal(self.basis, n, self.rank)

    @property
    def redundant(self):
        """Whether rows depend on each other."""
        return self.rank < self.held

    cdef object matrix(self, const double* values, Py_ssize_t rows, Py_ssize_t columns):
        return np.array([[values[i * columns + j] for j in range(columns)] for i in range(rows)]).reshape(rows, columns)

    def springs(self, rows, forces):
        """Forces of springs along other rows, and the inverse masses of these for motions that move held rows."""
        held = np.asarray(self.rows)
        U = self.matrix(self.basis, self.rank, self.held).T if self.rank < self.held else np.eye(self.held)
        square = self.matrix(self.square, self.held, self.held)
        along = rows @ U
        right = np.column_stack((U.T @ forces.ravel()[held], along.T))
        responses = np.linalg.lstsq(U.T @ square @ U, right, rcond=EPSILON)[0]
        return along @ responses[:, 0], np.sum(along.T * responses[:, 1:], axis=0)

    def forces(self, const double[::1] b not None, _):
        """Forces (n, t1, t2) of each point, N, (k, 3)."""
        forces = np.zeros((self.count // 3, 3))
        cdef double[:, ::1] found = forces
        if self.count:
            self.write_forces(&b[0], &found[0, 0])
        return forces

    cdef int write_forces(self, const double* b, double* forces) except -1:
        """Add these forces to zeros, (3k,)."""
        cdef Py_ssize_t i
        for i in range(self.held):
            self.right[i] = -b[self.rows[i]]
        self.solve()
        for i in range(self.held):
            forces[self.rows[i]] += self.right[i]
        return 0

    cdef void reduce(self) noexcept:
        """Put the system in the range of the held rows, (rank, rank), into the work space."""
        self.factored = False
        if self.rank < self.held:
            reduced(self.square, self.basis, self.held, self.rank, self.half, self.work)
        else:
            memcpy(self.work, self.square, self.held * self.held * sizeof(double))

    cdef void project(self) noexcept:
        """Components of the right side in the range of the held rows."""
        cdef Py_ssize_t i, j, n = self.held
        cdef double total
        cdef const double* column
        if self.rank == n:
            memcpy(self.inner, self.right, n * sizeof(double))
            return
        for j in range(self.rank):
            column, total = self.basis + j * n, 0.0
            for i in range(n):
                total += column[i] * self.right[i]
            self.inner[j] = total

    cdef void expand(self) noexcept:
        """The opposite of :meth:`project`."""
        cdef Py_ssize_t i, j, n = self.held
        cdef double part
        cdef double* right = self.right
        cdef const double* column
        if self.rank == n:
            memcpy(right, self.inner, n * sizeof(double))
            return
        memset(right, 0, n * sizeof(double))
        for j in range(self.rank):
            column, part = self.basis + j * n, self.inner[j]
            for i in range(n):
                right[i] += part * column[i]

    cdef int solve(self) except -1:
        """Replace the right side by the forces of the held rows."""
        self.project()
        if not self.factored:
            self.reduce()
            self.factored = factored(self.work, self.rank, self.order)
        if self.factored:
            substitute(self.work, self.inner, self.rank, self.order)
        else:
            self.solve_singular()
        self.expand()
        return 0

    cdef int solve_singular(self) except -1:
        """Components of forces, large where the system is singular, as at the limit of Painleve's paradox."""
        self.project()
        self.reduce()
        system = self.matrix(self.work, self.rank, self.rank)
        for j, each in enumerate(np.linalg.lstsq(system, self.matrix(self.inner, self.rank, 1)[:, 0], rcond=EPSILON)[0]):
            self.inner[<Py_ssize_t>j] = each
        return 0

def held_forces(G, structure):
    """The problem of held rows that was saved."""
    return HeldForces(SimpleNamespace(G=G), structure)


cdef HeldForces of_rows(RowMemory own, structure):
    """The problem of rows in memory."""
    cdef HeldForces held = HeldForces.__new__(HeldForces)
    held.set_up(own, own.delassus(), structure)
    return held
