from ffsm_mj_fast.row_memory cimport RowMemory

cdef class HeldForces:
    cdef object structure, kept, memory
    cdef const double* G
    cdef const Py_ssize_t[::1] rows
    cdef Py_ssize_t held, rank, count
    cdef bint factored
    # Of the held rows: their elements of G, and an orthonormal basis of their range, column by column.
    cdef double* square
    cdef double* basis
    cdef double* work
    cdef double* half
    cdef double* right
    cdef double* inner
    cdef Py_ssize_t* order

    cdef int set_up(self, kept, const double* G, structure) except -1
    cdef void take(self, const double* G) noexcept
    cdef object delassus(self)
    cdef void find_range(self) noexcept
    cdef object matrix(self, const double* values, Py_ssize_t rows, Py_ssize_t columns)
    cdef int write_forces(self, const double* b, double* forces) except -1
    cdef void reduce(self) noexcept
    cdef void project(self) noexcept
    cdef void expand(self) noexcept
    cdef int solve(self) except -1
    cdef int solve_singular(self) except -1

cdef HeldForces of_rows(RowMemory own, structure)
