# cython: boundscheck=False, wraparound=False
"""Steps of free motion; twin of ffsm_mj.dynamics.free_stepper.

The operations are those of mj_step and mj_forward with one exception: mj_step begins with the position, velocity and constraint
stages of the initial state, which the last mj_forward has already computed. RK4 without an active constraint reuses them; all
other steps call mj_step.

MuJoCo is called without its bindings: an exception in a Python callback of MuJoCo (``mujoco.set_mjcb_control``) and an error in
MuJoCo itself end the process, whereas the bindings raise.
"""

import mujoco
import numpy as np

from ffsm_mj.dynamics import free_stepper as plain

from libc.math cimport INFINITY, fabs, sqrt

from ffsm_mj_fast.functions cimport address, mj, mjData, mjModel, mjSTAGE_VEL

cdef double BOUND_MARGIN = plain.BOUND_MARGIN
cdef int WHOLE_STATE = plain.WHOLE_STATE


cdef class FreeStepper:
    """Integrates steps and accumulates the motion bound, the integral of sqrt(2 T) dt."""

    def __init__(self, model, data, double[::1] state not None, double[::1] momentum not None):
        if len(state) != mujoco.mj_stateSize(model, WHOLE_STATE) or len(momentum) != model.nv:
            raise ValueError(f"a state of {len(state)} and a momentum of {len(momentum)} numbers do not fit the model")
        self.m, self.d, self.model, self.data = <const mjModel*>address(model), <mjData*>address(data), model, data
        self.state, self.momentum, self.rates = state, momentum, data.qvel
        self.runge_kutta = model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
        self.clear(INFINITY)

    def __reduce__(self):
        """How a saved state of a simulation holds it."""
        held = self.energy, self.motion_bound, self.last_increment, self.event_bound, self.unconstrained
        return type(self), (self.model, self.data, np.asarray(self.state), np.asarray(self.momentum)), held

    def __setstate__(self, held):
        self.energy, self.motion_bound, self.last_increment, self.event_bound, self.unconstrained = held

    def clear(self, double event_bound):
        """Reset the motion bound at the state in ``data``."""
        self.motion_bound, self.last_increment, self.event_bound = 0.0, 0.0, event_bound
        self.energy = self.kinetic()
        self.unconstrained = self.data.nefc == 0

    def step(self, double duration_s):
        """Integrate for the model's time step; returns whether no event is possible."""
        mj.getState(self.m, self.d, &self.state[0], WHOLE_STATE)
        if self.runge_kutta and self.unconstrained:
            mj.checkPos(self.m, self.d)
            mj.checkVel(self.m, self.d)
            mj.forwardSkip(self.m, self.d, mjSTAGE_VEL, 1)
            mj.checkAcc(self.m, self.d)
            mj.RungeKutta(self.m, self.d, 4)
        else:
            mj.step(self.m, self.d)
        mj.forward(self.m, self.d)
        # Evaluated here, not when it is needed: collision detection in between discards the constraints.
        self.unconstrained = self.data.nefc == 0
        return self.add(duration_s)

    def account(self, double duration_s):
        """Add a finished step to the motion bound; derived quantities must be current."""
        return self.add(duration_s)

    cdef bint add(self, double duration_s) noexcept:
        cdef double before = self.energy
        self.energy = self.kinetic()
        self.last_increment = BOUND_MARGIN * duration_s * sqrt(2.0 * fabs(before if before > self.energy else self.energy))
        self.motion_bound += self.last_increment
        return self.motion_bound < self.event_bound

    cdef double kinetic(self) noexcept:
        cdef double twice = 0.0
        cdef Py_ssize_t i
        mj.mulM(self.m, self.d, &self.momentum[0], &self.rates[0])
        for i in range(self.rates.shape[0]):
            twice += self.momentum[i] * self.rates[i]
        return 0.5 * twice
