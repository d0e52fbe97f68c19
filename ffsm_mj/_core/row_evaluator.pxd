from ffsm_mj._core.features cimport FaceGroup, Twist
from ffsm_mj._core.functions cimport mjData, mjModel
from ffsm_mj._core.rows cimport RowMemory


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
