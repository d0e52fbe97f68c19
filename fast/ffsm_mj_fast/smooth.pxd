from ffsm_mj_fast.functions cimport mjData, mjModel

cdef class Smooth:
    cdef readonly object motion
    cdef object seen
    cdef const mjModel* m
    cdef mjData* d
    cdef double[::1] qpos, qvel, ctrl, own_ctrl, passive, bias, actuator
    cdef double[::1] last_qpos, last_qvel, last_ctrl, last_pushes
    cdef object last_place, last_load, last_state
    cdef bint follows

    cdef void write_force(self, const double* pushes, double* force) noexcept
    cpdef object place(self)
    cpdef object load(self, double[::1] pushes)
    cpdef object state(self, double[::1] pushes)
    cpdef object force(self, double[::1] pushes)
