cdef class Doubling:
    cdef readonly int doublings, corrections
    cdef Py_ssize_t p, n
    cdef double size, largest
    cdef double[:, ::1] Q, A, S, K, best, rest, left, W, a, G, H, new, T, wide

    cdef double solution(self) except -1.0
    cdef double corrected(self, double shift) noexcept
    cdef bint doubled(self, double shift) noexcept
    cdef bint lacking(self, double shift) noexcept
    cdef double defect(self) noexcept
    cdef bint stabilises(self)
