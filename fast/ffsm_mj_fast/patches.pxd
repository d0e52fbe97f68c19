from ffsm_mj_fast.held_rows cimport HeldForces
from ffsm_mj_fast.row_memory cimport RowMemory
from ffsm_mj_fast.rows cimport RowEvaluator

cdef class StuckPatches:
    cdef bint possible, is_regular
    cdef RowEvaluator evaluator
    cdef Py_ssize_t pairs, nv, reduced
    cdef list groups_of_pairs
    cdef Py_ssize_t[::1] counts, starts
    cdef HeldForces held
    cdef bytearray block
    # Reduced rows and these times M^-1, (reduced, nv); their matrix, and its factor; accelerations along them without
    # contact forces, and forces; of each pair, W^T W, factored, (6, 6), and middle and mean distance of its points, (4,);
    # wrench rows about the middles, (m, 6)
    cdef double* J
    cdef double* response
    cdef double* A
    cdef double* factor
    cdef double* right
    cdef double* forces
    cdef double* N
    cdef double* frames
    cdef double* shifted

    cdef int set_up(self, RowEvaluator evaluator) except -1
    cdef bint prepare(self, list states, RowMemory own) except -1
    cdef int hold(self) except -1
    cdef int solve(self, RowMemory own, const double* force, double* along, double* generalised) except -1
    cdef void find_frame(self, Py_ssize_t q, list states) noexcept
    cdef void reduce_patch(self, Py_ssize_t q) noexcept
    cdef void reduce_point(self, Py_ssize_t q, const double* wrenches) noexcept
    cdef bint factor_normal(self, Py_ssize_t q, RowMemory own) except -1
    cdef int set_right(self, const double* force, RowMemory own) except -1
    cdef int find_forces(self) except -1
    cdef int spread(self, double* along) except -1
cdef StuckPatches patches_of(RowEvaluator evaluator)
