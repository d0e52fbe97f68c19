from ffsm_mj._core.features cimport FaceGroup, Twist
from ffsm_mj._core.functions cimport mjData, mjModel


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


cdef class Group:
    cdef FaceGroup on_face
    cdef object other
    cdef Py_ssize_t start, count, pair, b, a
    cdef bint rubs, is_limit

cdef class RowEvaluator:
    cdef readonly list at_limits
    cdef list groups, limits, moving
    cdef tuple counts
    cdef bytes rubs
    cdef const mjModel* m
    cdef mjData* d
    cdef readonly object data
    cdef object motion
    cdef Py_ssize_t k, nv, bodies
    cdef double[:, ::1] chains, screws, screw_rates, velocities, centres
    cdef double[:, ::1] jacobian, responses  # rows of the twists of all pairs, then of the limits, and these times M^-1
    cdef Py_ssize_t[:, ::1] pairs
    cdef double[::1] rates
    cdef Py_ssize_t[::1] ids, roots
    cdef double[:, ::1] memory
    cdef Twist* twists

    cdef int evaluate_twists(self) except -1
    cdef int evaluate_pairs(self) except -1
    cdef int combine(self, RowMemory memory) except -1
    cdef object twist(self, Py_ssize_t body)
    cdef list states(self)
    cdef object state(self, Group group)
    cdef list groups_in_memory(self)
    cdef RowMemory empty(self)
    cdef int evaluate(self, list states, RowMemory memory) except -1
    cdef int write_wrenches(self, list states, RowMemory memory) except -1
    cdef int write_group(self, Group group, state, RowMemory memory) except -1
    cdef int other_rows(self, Group group, state, axes, wrenches, gamma) except -1

cdef int write_scales(list groups, double* scales) except -1
cdef int write_rounding(list groups, RowMemory memory, const double* force, double* out) except -1
cdef int find_extremes(list groups, double* out) except -1
cdef int sum_up(list groups, Py_ssize_t start, Py_ssize_t stop, const double* forces, double* out) except -1
