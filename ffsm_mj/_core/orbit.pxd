cdef class Reference:
    cdef int find(self, double time_s, double* R, double* V) except -1
