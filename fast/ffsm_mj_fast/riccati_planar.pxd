# Types of ffsm_controllers/osdre/riccati_planar.py, which is compiled unchanged.

cimport cython

ctypedef (double, double) pair_t
ctypedef (double, double, double) triple_t
ctypedef (double, double, double, double) matrix_t
ctypedef (matrix_t, matrix_t) blocks_t
ctypedef (matrix_t, matrix_t, matrix_t) weight_t
ctypedef (triple_t, double, triple_t) rest_t

cdef int _ITERATIONS, _CORRECTIONS
cdef double ACCEPTED_RESIDUAL, _NEARLY, _ROUNDING


cdef class PlanarRiccati:
    cdef weight_t _weight
    cdef object _robust
    cdef bint _isotropic, _warm
    cdef blocks_t _first, _second, _third

    @cython.locals(Q=weight_t, blocks=blocks_t, rough=blocks_t, left=double, rough_left=double)
    cpdef (blocks_t, double, bint) solve(self, matrix_t A21, matrix_t A22, pair_t S, pair_t axes)


cdef (blocks_t, double) _attempt(matrix_t A21, matrix_t A22, pair_t S, weight_t Q, blocks_t start)

@cython.locals(cosine=double, sine=double)
cpdef (pair_t, pair_t) principal_axes(double s0, double s1, double s3)

cpdef matrix_t turned(matrix_t M, pair_t axes)

@cython.locals(
    P2=matrix_t, P3=matrix_t, X2=matrix_t, X3=matrix_t, rest=rest_t,
    F=matrix_t, G=matrix_t, D2=matrix_t, D3=matrix_t, near=bint, left=double, before=double, change=double,
)
cpdef (blocks_t, double) newton(matrix_t A21, matrix_t A22, pair_t S, weight_t Q, blocks_t start)

cpdef blocks_t extrapolated(blocks_t first, blocks_t second, blocks_t third)

@cython.locals(q1=matrix_t, q2=matrix_t, q3=matrix_t)
cdef (matrix_t, matrix_t) _step(matrix_t A21, matrix_t A22, pair_t S, weight_t Q, matrix_t P2, matrix_t P3)

cdef (matrix_t, matrix_t) _closed(matrix_t A21, matrix_t A22, pair_t S, matrix_t P2, matrix_t P3)

@cython.locals(r=double, t=double, x0=double, x1=double, x3=double, y0=double, y1=double, y3=double)
cdef (matrix_t, matrix_t) _blocks(matrix_t F, matrix_t G, rest_t W)

cdef triple_t _lyapunov(double g0, double g1, double g2, double g3, double n0, double n1, double n3)

cdef bint _stable(matrix_t F, matrix_t G)

@cython.locals(q1=matrix_t, q2=matrix_t, q3=matrix_t, worst=double, largest=double)
cdef (rest_t, double) _defect(matrix_t A21, matrix_t A22, pair_t S, weight_t Q, matrix_t P2, matrix_t P3)
