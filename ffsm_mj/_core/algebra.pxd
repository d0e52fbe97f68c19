# cython: boundscheck=False, wraparound=False, cdivision=True
# Vectors of three numbers, and small dense matrices by rows, in loops: a few rows cost less so than by calls of LAPACK.

from libc.math cimport fabs, sqrt


cdef inline double dot(const double* a, const double* b) noexcept nogil:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


cdef inline void cross(const double* a, const double* b, double* out) noexcept nogil:
    out[0], out[1], out[2] = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


cdef inline void velocity_at(const double* twist, const double* centre, const double* point, double* out) noexcept nogil:
    """Velocity of a point of a body by its twist (angular, then linear) at another point."""
    cdef double[3] arm
    cdef int i
    for i in range(3):
        arm[i] = point[i] - centre[i]
    cross(twist, arm, out)
    for i in range(3):
        out[i] += twist[3 + i]


cdef inline Py_ssize_t pivots(double* A, Py_ssize_t n, double least, Py_ssize_t* order) noexcept:
    """Rank of a positive semidefinite matrix by Cholesky's method with pivots, largest first; the matrix is overwritten.

    Pivots below a share of the largest element end it.
    """
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
        if not root > least * largest:
            return j
        for i in range(j + 1, n):
            row = A + order[i] * n
            factor = row[order[j]] / root
            for l in range(n):  # those of earlier pivots are not used again
                row[l] -= factor * pivot[l]
    return n


cdef inline void orthonormal(double* columns, Py_ssize_t n, Py_ssize_t m) noexcept:
    """Make m independent columns of n numbers, stored one after the other, orthonormal, by Gram and Schmidt, twice (Giraud et al. 2005)."""
    cdef Py_ssize_t i, j, c
    cdef int sweep
    cdef double product
    cdef double* column
    cdef const double* other
    for c in range(m):
        column = columns + c * n
        for sweep in range(2):
            for j in range(c):
                other, product = columns + j * n, 0.0
                for i in range(n):
                    product += other[i] * column[i]
                for i in range(n):
                    column[i] -= product * other[i]
        product = 0.0
        for i in range(n):
            product += column[i] * column[i]
        product = 1.0 / sqrt(product)
        for i in range(n):
            column[i] *= product


cdef inline void reduced(const double* A, const double* U, Py_ssize_t n, Py_ssize_t r, double* half, double* out) noexcept:
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


cdef inline bint factored(double* A, Py_ssize_t n, Py_ssize_t* order) noexcept:
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


cdef inline void substitute(const double* A, double* b, Py_ssize_t n, const Py_ssize_t* order) noexcept:
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


cdef inline bint cholesky(double* A, Py_ssize_t n, double least) noexcept:
    """Factor a symmetric matrix in place, in its lower half; whether all pivots exceed a share of the largest element."""
    cdef Py_ssize_t i, j, l
    cdef double total, largest = 0.0
    for i in range(n):
        largest = max(largest, A[i * (n + 1)])
    for j in range(n):
        total = A[j * (n + 1)]
        for l in range(j):
            total -= A[j * n + l] * A[j * n + l]
        if not total > least * largest:
            return False
        A[j * (n + 1)] = sqrt(total)
        for i in range(j + 1, n):
            total = A[i * n + j]
            for l in range(j):
                total -= A[i * n + l] * A[j * n + l]
            A[i * n + j] = total / A[j * (n + 1)]
    return True


cdef inline void forward(const double* L, double* b, Py_ssize_t n) noexcept:
    """Solve L x = b in place."""
    cdef Py_ssize_t i, j
    for i in range(n):
        for j in range(i):
            b[i] -= L[i * n + j] * b[j]
        b[i] /= L[i * (n + 1)]


cdef inline void backward(const double* L, double* b, Py_ssize_t n) noexcept:
    """Solve L^T x = b in place."""
    cdef Py_ssize_t i, j
    for i in reversed(range(n)):
        for j in range(i + 1, n):
            b[i] -= L[j * n + i] * b[j]
        b[i] /= L[i * (n + 1)]
