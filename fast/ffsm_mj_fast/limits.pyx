# cython: boundscheck=False, wraparound=False
"""Efforts of actuators within their limits; twin of ffsm_mj.actuation.limits."""

import numpy as np

from libc.math cimport isfinite


cdef class Limits:
    """Converts a command to efforts within their bounds, and to ``ctrl``."""

    cdef double[::1] effort, velocity, ctrl
    cdef const double[::1] low, high, stall, slope, saturation, gear
    cdef const unsigned char[::1] powered
    cdef double[:, ::1] table

    def __init__(self, bounds, double[::1] effort, powered, double[::1] velocity, double[:, ::1] table, double[::1] ctrl):
        sizes = {len(x) for x in (effort, powered, velocity, table, ctrl, *vars(bounds).values())}
        if len(sizes) != 1 or table.shape[1] != 4:
            raise ValueError(f"arrays of {sorted(sizes)} actuators do not fit together")
        self.effort, self.powered, self.velocity = effort, powered.view(np.uint8), velocity
        self.table, self.ctrl = table, ctrl
        self.low, self.high, self.stall = bounds.low, bounds.high, bounds.stall
        self.slope, self.saturation, self.gear = bounds.slope, bounds.saturation, bounds.gear

    def apply(self):
        """Compute the table and ``ctrl``; returns False, with the commands only, if a powered effort is not finite."""
        cdef Py_ssize_t i, count = self.ctrl.shape[0]
        cdef double wanted, lower, upper, applied, drag, speed
        cdef bint finite = True
        for i in range(count):
            wanted = self.effort[i] if self.powered[i] else 0.0
            self.table[i, 0] = wanted
            finite = finite and isfinite(wanted)
        if not finite:
            return False
        for i in range(count):
            # The torque-speed line shifts both bounds; without a slope they are constant.
            drag, speed = self.velocity[i] * self.slope[i], self.velocity[i] / self.gear[i]
            lower, upper = -self.stall[i] - drag, self.stall[i] - drag
            lower = self.low[i] if lower < self.low[i] else lower
            upper = self.high[i] if upper > self.high[i] else upper
            lower = 0.0 if speed <= -self.saturation[i] else lower
            upper = 0.0 if speed >= self.saturation[i] else upper
            wanted = self.table[i, 0]
            applied = lower if wanted < lower else wanted
            applied = upper if applied > upper else applied
            applied = applied if self.powered[i] else 0.0
            self.table[i, 1], self.table[i, 2], self.table[i, 3] = applied, lower, upper
            self.ctrl[i] = applied / self.gear[i]
        return True
