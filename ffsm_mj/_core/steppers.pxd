from ffsm_mj._core.functions cimport mjData, mjModel


cdef class FreeStepper:
    cdef readonly double energy, motion_bound, last_increment
    cdef public double event_bound
    cdef const mjModel* m
    cdef mjData* d
    cdef double[::1] state, momentum, rates
    cdef readonly bint kinked  # whether a force was at its limit in a part of the last step only
    cdef bint runge_kutta, unconstrained
    cdef object model, data

    cpdef bint step(self, double duration_s) except? -1
    cdef bint add(self, double duration_s) noexcept
    cdef double kinetic(self) noexcept
