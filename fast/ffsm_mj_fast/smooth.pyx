# cython: boundscheck=False, wraparound=False
"""Smooth forces on a motion; twin of ffsm_mj.contact_models.persistent.smooth."""

import numpy as np

from cpython.bytes cimport PyBytes_FromStringAndSize
from libc.string cimport memcmp, memcpy

from ffsm_mj_fast.functions cimport address, mj, mjData, mjModel


cdef bytes copied(double[::1] values):
    """A token: a new object that a saved state can hold."""
    return PyBytes_FromStringAndSize(<char*>&values[0], values.shape[0] * <Py_ssize_t>sizeof(double))


cdef bint same(double[::1] values, double[::1] last) noexcept:
    """Whether values are the last ones; those become the last ones."""
    cdef size_t size = values.shape[0] * sizeof(double)
    if not size or memcmp(&values[0], &last[0], size) == 0:
        return True
    memcpy(&last[0], &values[0], size)
    return False


cdef class Smooth:
    """State and smooth forces of a motion."""

    def __init__(self, motion, seen):
        data = motion.data
        self.seen = seen
        self.motion, self.m, self.d = motion, <const mjModel*>address(motion.model), <mjData*>address(data)
        self.qpos, self.qvel, self.ctrl, self.own_ctrl = data.qpos, data.qvel, seen.ctrl, data.ctrl
        self.passive, self.bias, self.actuator = data.qfrc_passive, data.qfrc_bias, data.qfrc_actuator
        self.follows = data is not seen
        # No state is the last one yet: NaN has many bit patterns, and the efforts of a run are not this one.
        self.last_qpos, self.last_qvel, self.last_ctrl, self.last_pushes = (
            np.full(len(each), np.nan) for each in (data.qpos, data.qvel, seen.ctrl, data.qvel)
        )
        self.last_place, self.last_load = copied(self.qpos), copied(self.qvel)

    def __reduce__(self):
        """How a saved state of a simulation holds it: it has no memory."""
        return type(self), (self.motion, self.seen)

    cpdef object place(self):
        """Token of the current positions and velocities: the same object while they are the same bit by bit."""
        cdef bint stays = same(self.qpos, self.last_qpos)
        if not same(self.qvel, self.last_qvel) or not stays:
            self.last_place = copied(self.qpos)
        return self.last_place

    cpdef object load(self, double[::1] pushes):
        """The same of the current efforts and of applied forces, (nv,)."""
        cdef bint stays = same(self.ctrl, self.last_ctrl)
        if not same(pushes, self.last_pushes) or not stays:
            self.last_load = copied(pushes)
        return self.last_load

    cpdef object state(self, double[::1] pushes):
        """The same of the positions, velocities, efforts and applied forces."""
        place, load = self.place(), self.load(pushes)
        if self.last_state is None or self.last_state[0] is not place or self.last_state[1] is not load:
            self.last_state = place, load
        return self.last_state

    cpdef object force(self, double[::1] pushes):
        """Generalised forces less the bias, including applied forces ``pushes``, (nv,); positions and velocities current."""
        total = np.empty(self.qvel.shape[0])
        cdef double[::1] force = total
        if force.shape[0]:
            self.write_force(&pushes[0], &force[0])
        return total

    cdef void write_force(self, const double* pushes, double* force) noexcept:
        cdef Py_ssize_t i
        if self.follows:
            self.own_ctrl[:] = self.ctrl
        mj.fwdActuation(self.m, self.d)
        for i in range(self.qvel.shape[0]):
            force[i] = self.passive[i] - self.bias[i] + self.actuator[i] + pushes[i]
