from ffsm_mj._core.functions cimport mjData, mjModel


cdef struct Body:
    double[3] centre
    double[3] omega
    double[3] velocity  # of the material point at the centre
    double[3] alpha
    double[3] acceleration


cdef class Latch:
    cdef Py_ssize_t first, second, start, count
    cdef bint together, about_axis
    cdef double[::1] on_first, on_second, point_in_first, point_in_second
    cdef Py_ssize_t[::1] of_first, of_second, dofs  # degrees of freedom that move each body, and both relative to each other
    cdef double[:, ::1] components  # linear rows, then angular ones, along axes of the first body
    cdef double[:, ::1] axes_in_first, axes_in_second  # by row


cdef class LoopStage:
    cdef readonly object J, R, response, factor, gamma, y
    cdef object model, data, seen
    cdef const mjModel* m
    cdef mjData* d
    cdef list places
    cdef Py_ssize_t n, r, nv
    cdef bint current, begun
    cdef double[:, ::1] cdof, cdof_dot, cvel, centres, xpos, xmat
    cdef int[::1] roots
    cdef Py_ssize_t[::1] columns  # degrees of freedom that take part in any row
    cdef double[::1] qpos, qvel, passive, bias, actuator, applied, ctrl, seen_ctrl
    cdef double[::1] last_qpos, last_qvel, all_gamma, every_error, force, gamma_view, y_view
    cdef double[:, ::1] rows, T, others, R_view, response_view, factor_view, start_response, turn
    cdef double vanishes

    cpdef int evaluate(self) except -1
    cpdef bint fits(self) except -1
    cpdef int begin(self) except -1
    cpdef bint turns_over(self) except -1
    cdef int find_drift(self, double* gap, double* rate) except -1
    cdef int solve(self, const double* force) except -1
    cdef int write_loads(self, const Py_ssize_t[::1] counts, double* loads) except -1
    cpdef int push(self) except -1
    cdef void body(self, Py_ssize_t number, const Py_ssize_t[::1] moves, Body* out) noexcept
    cdef void point(self, Latch latch, double* out) noexcept
    cdef void evaluate_latch(self, Latch latch) noexcept
    cdef void combined_row(self, const double* share, double* row) noexcept
    cdef double product(self, const double* full, const double* row) noexcept
    cdef int factorise(self) except -1
    cdef double error(self, Py_ssize_t i) noexcept
    cdef int write_errors(self) except -1
    cdef double force_along(self, Py_ssize_t k) noexcept
    cdef void add_to(self, double* generalised) noexcept
