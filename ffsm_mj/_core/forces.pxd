from ffsm_mj._core.row_evaluator cimport RowEvaluator
from ffsm_mj._core.rows cimport RowMemory


cdef class ActiveForces:
    cdef object structure, kept, memory
    cdef const double* G
    cdef const Py_ssize_t[::1] rows, sliding_points, columns
    cdef const double[::1] mu
    cdef Py_ssize_t active, rank, count
    cdef bint factored
    # Of the held rows: their elements of G, an orthonormal basis of their range, column by column, and their system, which
    # differs from G where points slide; -mu times the direction of slip of each of these
    cdef double* square
    cdef double* basis
    cdef double* system
    cdef double* friction
    cdef double* work
    cdef double* half
    cdef double* right
    cdef double* inner
    cdef Py_ssize_t* order

    cdef int set_up(self, kept, const double* G, structure) except -1
    cdef void take(self, const double* G) noexcept
    cdef object delassus(self)
    cdef void find_system(self) noexcept
    cdef void turn(self, const double* slips) noexcept
    cdef bint has_sign(self) noexcept
    cdef void find_range(self) noexcept
    cdef object independent(self)
    cdef void add_forces(self, double* forces) noexcept
    cdef void factor(self) noexcept
    cdef object matrix(self, const double* values, Py_ssize_t rows, Py_ssize_t columns)
    cdef int write_forces(self, const double* b, double* forces) except -1
    cdef void reduce(self) noexcept
    cdef void project(self) noexcept
    cdef void expand(self) noexcept
    cdef int solve(self) except -1
    cdef int solve_singular(self) except -1

cdef ActiveForces of_rows(RowMemory memory, structure)


cdef class StuckPatches:
    cdef bint possible, is_regular
    cdef RowEvaluator evaluator
    cdef Py_ssize_t pairs, nv, reduced
    cdef list groups_of_pairs
    cdef Py_ssize_t[::1] counts, starts
    cdef ActiveForces active_forces
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
    cdef bint prepare(self, list states, RowMemory memory) except -1
    cdef int hold(self) except -1
    cdef int solve(self, RowMemory memory, const double* force, double* along, double* generalised) except -1
    cdef void find_frame(self, Py_ssize_t q, list states) noexcept
    cdef void reduce_patch(self, Py_ssize_t q) noexcept
    cdef void reduce_point(self, Py_ssize_t q, const double* wrenches) noexcept
    cdef bint factor_normal(self, Py_ssize_t q, RowMemory memory) except -1
    cdef int set_right(self, const double* force, RowMemory memory) except -1
    cdef int find_forces(self) except -1
    cdef int spread(self, double* along) except -1
cdef StuckPatches patches_of(RowEvaluator evaluator)
