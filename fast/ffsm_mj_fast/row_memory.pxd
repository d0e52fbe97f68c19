cdef class RowMemory:
    cdef readonly Py_ssize_t points, rows, nv
    cdef readonly tuple counts
    cdef bytearray block, G_block
    cdef bint frictional
    cdef double* start
    cdef double* J
    cdef double* response
    cdef double* gamma
    cdef double* wrenches
    cdef double* centres
    cdef double* axes
    cdef double* qvel
    cdef double* G
    cdef bint has_G

    cdef void renew(self) noexcept
    cdef double velocity(self, Py_ssize_t i) noexcept
    cdef double inverse_mass(self, Py_ssize_t i) noexcept
    cdef double* delassus(self) except NULL
    cdef int write_resultants(self, const double* forces, double* out) except -1
