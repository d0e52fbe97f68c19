# cython: boundscheck=False, wraparound=False
"""Steps of free motion; the twin of ffsm_mj.flight.

The same operations as mj_step and mj_forward, but for one: mj_step begins with the position and velocity stages of the state
it starts from, and those are current.
"""

from libc.math cimport INFINITY, sqrt

from ffsm_mj_fast.functions cimport address, mj

cdef int STAGE_VEL = 2  # mjSTAGE_VEL: positions and velocities are current, forces are not
cdef double BOUND_MARGIN = 1.1


cdef class Flight:
    """Integration that keeps account of sqrt(2 T) dt."""

    cdef readonly double energy, way, last
    cdef public double horizon
    cdef const void* m
    cdef void* d
    cdef double[::1] state, momentum, rates
    cdef int what
    cdef object keep

    def __init__(self, model, data, double[::1] state, double[::1] momentum):
        from ffsm_mj.flight import WHOLE_STATE

        self.m, self.d, self.keep = address(model), address(data), (model, data)
        self.state, self.momentum, self.rates, self.what = state, momentum, data.qvel, WHOLE_STATE
        self.clear(INFINITY)

    def clear(self, double horizon):
        """Begin a new account at the state in ``data``."""
        self.way, self.last, self.horizon = 0.0, 0.0, horizon
        self.energy = self.kinetic()

    def step(self, double duration_s):
        """Integrate for the model's time step; says whether no pair can have touched."""
        cdef double before = self.energy
        mj.get_state(self.m, self.d, &self.state[0], self.what)
        mj.check_pos(self.m, self.d)
        mj.check_vel(self.m, self.d)
        mj.forward_skip(self.m, self.d, STAGE_VEL, 1)
        mj.check_acc(self.m, self.d)
        mj.runge_kutta(self.m, self.d, 4)
        mj.forward(self.m, self.d)
        self.energy = self.kinetic()
        self.last = BOUND_MARGIN * duration_s * sqrt(2.0 * (before if before > self.energy else self.energy))
        self.way += self.last
        return self.way < self.horizon

    cdef double kinetic(self) noexcept:
        cdef double twice = 0.0
        cdef Py_ssize_t i
        mj.mul_m(self.m, self.d, &self.momentum[0], &self.rates[0])
        for i in range(self.rates.shape[0]):
            twice += self.momentum[i] * self.rates[i]
        return 0.5 * twice
