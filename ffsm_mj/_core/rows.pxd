cdef class RowMemory:
    cdef readonly Py_ssize_t points, rows, nv
    cdef readonly tuple counts
    cdef bytearray block, G_block
    cdef bytes kept_rubs  # to which rubs points
    cdef const unsigned char* rubs
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
    # Responses before closed loops take what they hold, (m, nv): what cancels there is known to its rounding. None: no loops
    cdef public object unclosed

    cdef bint moves(self, Py_ssize_t i) noexcept
    cdef void renew(self) noexcept
    cdef void accelerate(self, const double* force, double* out) noexcept
    cdef double velocity(self, Py_ssize_t i) noexcept
    cdef double inverse_mass(self, Py_ssize_t i) noexcept
    cdef double* delassus(self) except NULL
    cdef int write_resultants(self, const double* forces, double* out) except -1


cdef int write_scales(list groups, double* scales) except -1
cdef int write_rounding(list groups, RowMemory memory, const double* force, double* out) except -1
cdef int find_extremes(list groups, double* out) except -1
cdef int sum_up(list groups, Py_ssize_t start, Py_ssize_t stop, const double* forces, double* out) except -1
