cdef class Travel:
    cdef readonly object travelled, last
    cdef readonly double length
    cdef double reach
    cdef double[::1] rates, sums, steps, before
    cdef const double[::1] weights

    cpdef bint add(self, double duration_s) except -1
