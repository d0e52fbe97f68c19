from ffsm_mj_fast.functions cimport mjData, mjModel

cdef class FreeStepper:
    cdef readonly double energy, motion_bound, last_increment
    cdef public double event_bound
    cdef const mjModel* m
    cdef mjData* d
    cdef double[::1] state, momentum, rates
    cdef bint runge_kutta, unconstrained
    cdef object model, data

    cdef double kinetic(self) noexcept
    cdef bint add(self, double duration_s) noexcept
