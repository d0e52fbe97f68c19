from ffsm_mj._core.functions cimport mjData, mjModel


cdef class FreeStepper:
    cdef readonly double energy, motion_bound, last_increment
    cdef public double event_bound
    cdef const mjModel* m
    cdef mjData* d
    cdef double[::1] state, momentum, rates
    cdef readonly bint kinked  # whether the last step contains a kink of a force
    cdef bint runge_kutta, unconstrained
    cdef object model, data
    cdef public object bands  # dead bands of tendon springs; None without any

    cpdef bint step(self, double duration_s) except? -1
    cdef bint add(self, double duration_s) noexcept
    cdef double kinetic(self) noexcept
