ctypedef (double, double) pair_t
ctypedef (double, double, double) triple_t
ctypedef (double, double, double, double) matrix_t
ctypedef (matrix_t, matrix_t) blocks_t
ctypedef (matrix_t, matrix_t, matrix_t) weight_t
ctypedef (triple_t, double, triple_t) rest_t


cdef class PlanarRiccati:
    cdef weight_t _weight
    cdef object _robust
    cdef bint _isotropic, _warm
    cdef blocks_t _first, _second, _third

    cpdef (blocks_t, double, bint) solve(self, matrix_t A21, matrix_t A22, pair_t S, pair_t axes)


cpdef (pair_t, pair_t) principal_axes(double s0, double s1, double s3)

cpdef matrix_t turned(matrix_t M, pair_t axes)

cpdef (blocks_t, double) newton(matrix_t A21, matrix_t A22, pair_t S, weight_t Q, blocks_t start)

cpdef blocks_t extrapolated(blocks_t first, blocks_t second, blocks_t third)
