cdef class RowMemory:
    cdef readonly Py_ssize_t points, rows, nv
    cdef object block, G_block
    cdef double* start
    cdef double* J
    cdef double* response
    cdef double* gamma
    cdef double* axes
    cdef double* qvel
    cdef double* G

    cdef double* delassus(self) except NULL
