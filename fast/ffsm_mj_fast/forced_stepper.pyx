# cython: boundscheck=False, wraparound=False
"""Steps under applied forces; twin of ffsm_mj.dynamics.forced_stepper. Implicit stages are those of the original."""

import numpy as np

from ffsm_mj.dynamics import forced_stepper as plain
from ffsm_mj.dynamics.free_stepper import WHOLE_STATE as _WHOLE_STATE
from ffsm_mj.dynamics.implicit_stages import IMPLICIT_WEIGHTS, integrate_implicitly
from ffsm_mj.dynamics.rigid_body import rotation_dofs

from libc.string cimport memcpy, memset

from ffsm_mj_fast.free_stepper cimport FreeStepper
from ffsm_mj_fast.functions cimport mj, mjSTAGE_VEL

cdef int WHOLE_STATE = _WHOLE_STATE
WEIGHTS = plain.WEIGHTS


cdef void rotation_vector_rate(const double* turned, double* spin) noexcept:
    """Replace a body-frame angular velocity by the rate of the rotation vector."""
    cdef double a = turned[0], b = turned[1], c = turned[2], x = spin[0], y = spin[1], z = spin[2]
    cdef double u = b * z - c * y, v = c * x - a * z, w = a * y - b * x, twelfth = 1.0 / 12.0
    spin[0] = x + 0.5 * u + twelfth * (b * w - c * v)
    spin[1] = y + 0.5 * v + twelfth * (c * u - a * w)
    spin[2] = z + 0.5 * w + twelfth * (a * v - b * u)


cdef class ForcedStepper(FreeStepper):
    """Integrates steps under state-dependent applied forces."""

    cdef public bint implicit, inside, solved
    cdef public int repeats
    cdef public object stage
    cdef readonly object start_rates, rotations
    cdef tuple pushes
    cdef object follow
    cdef double[::1] qpos, accelerations, applied, start_qpos, start_qvel
    cdef double[:, :, ::1] slopes  # of four stages: rates of rotation vectors and other coordinates, accelerations
    cdef double[::1] mean
    cdef object flat_slopes, flat_mean
    cdef Py_ssize_t[::1] turning

    def __init__(self, model, data, double[::1] state not None, double[::1] momentum not None, pushes, follow):
        FreeStepper.__init__(self, model, data, state, momentum)
        self.pushes, self.follow, self.rotations = tuple(pushes), follow, rotation_dofs(model)
        self.turning = np.array([part.start for part in self.rotations], dtype=np.intp)
        self.qpos, self.accelerations, self.applied = data.qpos, data.qacc, data.qfrc_applied
        self.start_rates = np.empty(model.nv)
        self.start_qpos, self.start_qvel = np.empty(model.nq), self.start_rates
        self.flat_slopes, self.flat_mean = np.empty((4, 2 * model.nv)), np.empty(2 * model.nv)
        self.slopes, self.mean = self.flat_slopes.reshape(4, 2, -1), self.flat_mean

    def __reduce__(self):
        """How a saved state of a simulation holds it."""
        given = self.model, self.data, np.asarray(self.state), np.asarray(self.momentum), (), None
        return type(self), given, (FreeStepper.__reduce__(self)[2], self.pushes, self.follow, self.implicit)

    def __setstate__(self, held):
        FreeStepper.__setstate__(self, held[0])
        self.pushes, self.follow, self.implicit = held[1:]

    @property
    def weights(self):
        """Quadrature weights of the stages of a step."""
        return IMPLICIT_WEIGHTS if self.implicit else WEIGHTS

    def refresh(self):
        """Update forces and all derived quantities for the state in ``data``."""
        self.update()

    cdef int update(self) except -1:
        mj.fwdPosition(self.m, self.d)
        mj.fwdVelocity(self.m, self.d)
        return self.update_forces()

    cdef int update_forces(self) except -1:
        """The same if positions and velocities are current and only efforts may have changed."""
        self.follow()
        memset(&self.applied[0], 0, self.applied.shape[0] * sizeof(double))
        for push in self.pushes:
            push(self.data)
        mj.forwardSkip(self.m, self.d, mjSTAGE_VEL, 1)
        return 0

    def integrate(self, double duration_s):
        """Integrate for a time; forces and derived quantities are current at its end."""
        self.update()
        self.integrate_step(duration_s)

    cdef int integrate_step(self, double duration_s) except -1:
        """The same if forces are current at the start."""
        cdef double start_s = self.data.time
        memcpy(&self.start_qpos[0], &self.qpos[0], self.qpos.shape[0] * sizeof(double))
        memcpy(&self.start_qvel[0], &self.rates[0], self.rates.shape[0] * sizeof(double))
        self.solved = True
        if self.implicit:
            self.solved = integrate_implicitly(self, self.data, duration_s)
        else:
            self.integrate_explicitly(start_s, duration_s)
        self.data.time = start_s + duration_s
        return self.update()

    cdef int integrate_explicitly(self, double start_s, double h) except -1:
        """Set the state at the end of a step, by the classical tableau."""
        cdef Py_ssize_t n = self.rates.shape[0]
        cdef double* slopes = &self.slopes[0, 0, 0]
        memcpy(slopes, &self.rates[0], n * sizeof(double))
        memcpy(slopes + n, &self.accelerations[0], n * sizeof(double))
        self.data.time, self.inside = start_s + 0.5 * h, True
        try:
            self.evaluate(0.5 * h, slopes, slopes + 2 * n)
            self.evaluate(0.5 * h, slopes + 2 * n, slopes + 4 * n)
            self.data.time = start_s + h
            self.evaluate(h, slopes + 4 * n, slopes + 6 * n)
        finally:
            self.inside = False
        WEIGHTS.dot(self.flat_slopes, self.flat_mean)  # its order of summation is not ours to know
        self.set_state(h, &self.mean[0])
        return 0

    def move_by(self, const double[:, ::1] increment not None):
        """Set the state at increments of (rotation vectors and other coordinates, rates) from the start, (2, nv)."""
        self.set_state(1.0, &increment[0, 0])

    cdef void set_state(self, double after_s, const double* slope) noexcept:
        """Set the state reached from the start of the step with constant rates and accelerations, (2, nv)."""
        cdef Py_ssize_t i, n = self.rates.shape[0]
        memcpy(&self.qpos[0], &self.start_qpos[0], self.qpos.shape[0] * sizeof(double))
        mj.integratePos(self.m, &self.qpos[0], slope, after_s)
        for i in range(n):
            self.rates[i] = self.start_qvel[i] + after_s * slope[n + i]

    cdef int evaluate(self, double after_s, const double* slope, double* found) except -1:
        """Evaluate one stage: rates and accelerations at the state that given ones lead to, (2, nv) each."""
        cdef Py_ssize_t i, j, first, n = self.rates.shape[0]
        cdef double[3] turned
        self.set_state(after_s, slope)
        self.update()
        memcpy(found, &self.rates[0], n * sizeof(double))
        memcpy(found + n, &self.accelerations[0], n * sizeof(double))
        for j in range(self.turning.shape[0]):
            first = self.turning[j]
            for i in range(3):
                turned[i] = after_s * slope[first + i]
            rotation_vector_rate(turned, found + first)
        return 0

    def step(self, double duration_s):
        """Integrate for a time; returns whether the motion bound excludes any event."""
        mj.getState(self.m, self.d, &self.state[0], WHOLE_STATE)
        self.update_forces()
        self.integrate_step(duration_s)
        return self.add(duration_s)
