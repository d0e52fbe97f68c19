# cython: boundscheck=False, wraparound=False
"""Smooth forces on a motion; twin of ffsm_mj.contact_models.persistent.smooth."""

import numpy as np

from cpython.bytes cimport PyBytes_FromStringAndSize

from ffsm_mj_fast.functions cimport address, mj, mjData, mjModel


cdef bytes copied(double[::1] values):
    return PyBytes_FromStringAndSize(<char*>&values[0], values.shape[0] * <Py_ssize_t>sizeof(double)) if len(values) else b""


cdef class Smooth:
    """State and smooth forces of a motion."""

    cdef readonly object motion
    cdef object seen
    cdef const mjModel* m
    cdef mjData* d
    cdef double[::1] qpos, qvel, ctrl, own_ctrl, passive, bias, actuator
    cdef bint follows

    def __init__(self, motion, seen):
        data = motion.data
        self.seen = seen
        self.motion, self.m, self.d = motion, <const mjModel*>address(motion.model), <mjData*>address(data)
        self.qpos, self.qvel, self.ctrl, self.own_ctrl = data.qpos, data.qvel, seen.ctrl, data.ctrl
        self.passive, self.bias, self.actuator = data.qfrc_passive, data.qfrc_bias, data.qfrc_actuator
        self.follows = data is not seen

    def __reduce__(self):
        """How a saved state of a simulation holds it: it has no memory."""
        return type(self), (self.motion, self.seen)

    def state(self):
        """Current positions and velocities as bytes, for exact comparison."""
        return copied(self.qpos), copied(self.qvel)

    def efforts(self):
        """Current efforts as bytes, for exact comparison."""
        return copied(self.ctrl)

    def force(self, double[::1] pushes not None):
        """Generalised forces less the bias, including applied forces ``pushes``, (nv,); positions and velocities current."""
        cdef Py_ssize_t i
        total = np.empty(self.qvel.shape[0])
        cdef double[::1] force = total
        if self.follows:
            self.own_ctrl[:] = self.ctrl
        mj.fwdActuation(self.m, self.d)
        for i in range(force.shape[0]):
            force[i] = self.passive[i] - self.bias[i] + self.actuator[i] + pushes[i]
        return total
