cdef class RuleColumns:
    cdef Py_ssize_t[:, ::1] parts
    cdef double[:, ::1] values, friction_values
    cdef double[::1] work_J

    cdef int write(
        self, list groups, const double* axes, const double* normal_forces, const double* forces, const double* use
    ) except -1
    cdef void clear(self) noexcept
    cdef void finish(self) noexcept
    cdef void add_pair(self, Py_ssize_t i, const double* found) noexcept
    cdef void add_friction(
        self, Py_ssize_t i, const double* axes, const double* forces, const double* use, double* found
    ) noexcept
    cdef void add_impulses(self, double part, const double* wrenches) noexcept
