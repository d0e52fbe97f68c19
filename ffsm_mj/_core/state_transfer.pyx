# cython: boundscheck=False, wraparound=False, cdivision=True
"""The state of the logged system, from that of a model in which a grasped object is a child of the link."""

from math import pi

import numpy as np

from libc.math cimport atan2, rint

from ffsm_mj._core.functions cimport address, mj, mjData, mjModel, mjOBJ_XBODY


cdef double TURN = 2.0 * pi


cdef class StateTransfer:
    """Transfers the state of the moving system to the data of the logged system."""

    cdef const mjModel* m
    cdef mjData* d
    cdef const mjModel* moving
    cdef mjData* state_of
    cdef int root
    cdef bint free, reads, turns
    cdef double zero
    cdef double[::1] qpos, qvel, momentum, other_qpos, other_qvel, base_qpos, base_qvel, position, quaternion, axes, twist
    cdef double[::1] axis, sine, cosine
    cdef double[:, ::1] slides
    cdef const Py_ssize_t[::1] coordinates, other_coordinates, rates, other_rates
    cdef object keep, data, other, placing

    def __init__(self, logged, moving, shared, placing):
        model, self.data, self.momentum = logged
        other_model, self.other, self.root = moving
        self.keep = model, other_model
        self.m, self.d = <const mjModel*>address(model), <mjData*>address(self.data)
        self.moving, self.state_of = <const mjModel*>address(other_model), <mjData*>address(self.other)
        (self.coordinates, self.other_coordinates), (self.rates, self.other_rates) = (
            [np.ascontiguousarray(places, dtype=np.intp) for places in both] for both in shared
        )
        self.qpos, self.qvel = self.data.qpos, self.data.qvel
        self.other_qpos, self.other_qvel = self.other.qpos, self.other.qvel
        self.position, self.quaternion, self.twist = self.other.xpos[self.root], self.other.xquat[self.root], np.empty(6)
        self.base_qpos, self.base_qvel, self.axes = placing.base
        self.placing, self.free, read = placing, placing.free, placing.reading
        self.reads = read is not None
        if self.reads:
            self.slides, self.zero, self.sine, self.cosine = read.slides, read.zero, read.sine, read.cosine
            self.turns = read.axis is not None
            self.axis = read.axis if self.turns else np.zeros(3)

    def state(self):
        """Transfer positions and velocities, and compute derived quantities."""
        cdef Py_ssize_t i
        for i in range(self.coordinates.shape[0]):
            self.qpos[self.coordinates[i]] = self.other_qpos[self.other_coordinates[i]]
        for i in range(self.rates.shape[0]):
            self.qvel[self.rates[i]] = self.other_qvel[self.other_rates[i]]
        self.data.time = self.other.time
        self.pose()
        # Rates of the base need the frames of this state: positions first.
        mj.fwdPosition(self.m, self.d)
        mj.objectVelocity(self.moving, self.state_of, mjOBJ_XBODY, self.root, &self.twist[0], 0)
        self.rate()
        mj.fwdVelocity(self.m, self.d)

    def step(self):
        """The same, with M qdot and the actuator forces for the efforts in the data of the logged system."""
        self.state()
        mj.mulM(self.m, self.d, &self.momentum[0], &self.qvel[0])
        # Efforts are not transferred: those of the logged system act, and it logs their forces.
        mj.fwdActuation(self.m, self.d)

    cdef int pose(self) except -1:
        cdef double[::1] base = self.base_qpos
        cdef double[::1] q = self.quaternion
        cdef double sine = 0.0, cosine = 0.0, angle
        cdef Py_ssize_t i, last = base.shape[0] - 1
        if self.free:
            base[0], base[1], base[2] = self.position[0], self.position[1], self.position[2]
            base[3], base[4], base[5], base[6] = q[0], q[1], q[2], q[3]
            return 0
        if not self.reads:
            self.placing.pose(self.position.base, self.quaternion.base)
            return 0
        for i in range(self.slides.shape[0]):
            base[i] = self.slides[i, 0] + self.along(i, self.position[0], self.position[1], self.position[2])
        if self.turns:
            for i in range(4):
                sine += self.sine[i] * q[i]
                cosine += self.cosine[i] * q[i]
            # A quaternion knows an angle up to full turns; the coordinate of a hinge counts them, and must not jump.
            angle = self.zero + 2.0 * atan2(sine, cosine)
            base[last] = angle + TURN * rint((base[last] - angle) / TURN)
        return 0

    cdef double along(self, Py_ssize_t slide, double x, double y, double z) noexcept:
        return self.slides[slide, 1] * x + self.slides[slide, 2] * y + self.slides[slide, 3] * z

    cdef int rate(self) except -1:
        cdef double[::1] base = self.base_qvel
        cdef double[::1] v = self.twist
        cdef double[::1] R = self.axes
        cdef Py_ssize_t i
        if self.free:
            base[0], base[1], base[2] = v[3], v[4], v[5]
            for i in range(3):
                base[3 + i] = R[i] * v[0] + R[3 + i] * v[1] + R[6 + i] * v[2]
            return 0
        if not self.reads:
            self.placing.rates(self.twist.base)
            return 0
        for i in range(self.slides.shape[0]):
            base[i] = self.along(i, v[3], v[4], v[5])
        if self.turns:
            base[base.shape[0] - 1] = self.axis[0] * v[0] + self.axis[1] * v[1] + self.axis[2] * v[2]
        return 0
