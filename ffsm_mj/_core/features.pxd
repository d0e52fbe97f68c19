cdef struct Twist:  # see ffsm_mj.dynamics.body_twists.BodyTwist
    double[3] centre
    double[3] omega
    double[3] velocity
    double[3] alpha
    double[3] acceleration

cdef class FaceGroup:
    cdef readonly Py_ssize_t count
    cdef readonly bint swapped
    cdef bint in_patch
    cdef double[3] normal
    cdef double level
    cdef double[:, ::1] centres, sides
    cdef double[::1] first_radius, radius
    cdef const double[::1] first_origin, second_origin, first_axes, second_axes
    cdef object face

    cdef FaceState at_state(self, const Twist* b, const Twist* a)

cdef class FaceState:
    cdef FaceGroup group
    cdef readonly Py_ssize_t count
    cdef Twist first, second
    cdef double[3] normal
    cdef double[3] offset
    cdef double[3] turning  # rate of the normal
    cdef double[3] face_turning  # that of the normal of the face, from which it differs in a flat patch
    cdef double sign
    cdef bytearray block
    cdef double* values

    cdef void go_to(self, const Twist* b, const Twist* a) noexcept
    cdef void place_points(self, const double* omega) noexcept
    cdef const double* centre(self) noexcept
    cdef const double* point(self, Py_ssize_t p) noexcept
    cdef void wrench_row(self, const double* axis, const double* place, double* row) noexcept
    cdef double normal_rate(self, const Twist* body, const double* arm) noexcept
    cdef double normal_gamma(self, Py_ssize_t p) noexcept
    cdef void outward(self, double* normal) noexcept
    cdef void normal_rows(self, double* rows, double* gamma) noexcept
    cdef void tangential_rows(self, const double* tangents, double* rows, double* gamma) noexcept
    cdef double inside(self, Py_ssize_t p) except? -1.0
    cdef Py_ssize_t write_scales(self, double* scales) noexcept
    cdef int find_extremes(self, double* inside, double* gap, double* rate, double* lowest) except -1
    cdef void add_resultant(
        self, const double* forces, Py_ssize_t at, double total, Py_ssize_t count, double* out
    ) noexcept
    cdef object table(self)

cdef void add_point(
    const double* normal, const double* point, double force, double total, Py_ssize_t count, double* out
) noexcept
