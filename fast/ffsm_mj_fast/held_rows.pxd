from ffsm_mj_fast.row_memory cimport RowMemory

cdef class HeldForces:
    cdef object mu, structure, kept, memory
    cdef const double* G
    cdef const Py_ssize_t[::1] rows, slides, columns
    cdef Py_ssize_t held, rank, count, sliding
    cdef bint factored
    # Of the held rows: their elements of G, an orthonormal basis of their range, column by column, and what forces along
    # slips do to them.
    cdef double* square
    cdef double* basis
    cdef double* system
    cdef double* work
    cdef double* half
    cdef double* right
    cdef double* inner
    cdef double* friction
    cdef Py_ssize_t* order

    cdef int set_up(self, mu, kept, const double* G, structure) except -1
    cdef void take(self, const double* G) noexcept
    cdef object delassus(self)
    cdef void find_range(self) noexcept
    cdef object matrix(self, const double* values, Py_ssize_t rows, Py_ssize_t columns)
    cdef int turn(self, const double* slips) except -1
    cdef int write_forces(self, const double* b, double* forces) except -1
    cdef void spread(self, double* forces) noexcept
    cdef void reduce(self) noexcept
    cdef void project(self) noexcept
    cdef void expand(self) noexcept
    cdef int solve(self) except -1
    cdef int solve_singular(self) except -1

cdef HeldForces of_rows(mu, RowMemory own, structure)
