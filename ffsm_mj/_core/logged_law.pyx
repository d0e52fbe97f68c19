# cython: boundscheck=False, wraparound=False
"""The commands of a log as a control law: a log replay takes control ticks as a run does, from logged state to logged state."""

import numpy as np

from libc.string cimport memcpy

from ffsm_mj._core.tick cimport Limits, TickLaw


cdef class LoggedLaw(TickLaw):
    """Commands what a block of rows says, and compares the states that are arrived at with those of the rows."""

    cdef double[::1] qpos, qvel, ctrl, effort, copy
    cdef unsigned char[::1] powered
    cdef const Py_ssize_t[::1] copied
    cdef const double[:, :] rows
    cdef const double[:, ::1] states, efforts, ctrls
    cdef const unsigned char[:, ::1] on
    cdef double[:, ::1] predicted
    cdef Py_ssize_t line

    def __init__(self, data, effort, powered, copied, copy):
        """Bind to the data, a command, and places in a row of columns to be copied with the array that receives them."""
        self.qpos, self.qvel, self.ctrl = data.qpos, data.qvel, data.ctrl
        self.effort, self.powered, self.copied, self.copy = effort, powered.view(np.uint8), copied, copy

    def begin(self, logged, predicted):
        """Begin a block: its ``LoggedRows``, and a table of the states arrived at, with a line for each."""
        self.rows, self.states, self.efforts, self.ctrls = logged.rows, logged.states, logged.asked, logged.ctrl
        self.on, self.predicted = np.ascontiguousarray(logged.powered).view(np.uint8), predicted
        self.check_sizes()

    cdef int check_sizes(self) except -1:
        cdef Py_ssize_t n = self.rows.shape[0], nu = self.effort.shape[0], size = self.qpos.shape[0] + self.qvel.shape[0]
        if not n == self.states.shape[0] == self.efforts.shape[0] == self.ctrls.shape[0] == self.on.shape[0]:
            raise ValueError("the tables have different lengths")
        if not nu == self.efforts.shape[1] == self.ctrls.shape[1] == self.on.shape[1] == self.ctrl.shape[0]:
            raise ValueError(f"the tables do not fit {nu} actuators")
        if self.predicted.shape[0] < n or not size == self.states.shape[1] == self.predicted.shape[1]:
            raise ValueError(f"the tables do not fit states of {size} numbers")
        return 0

    def go_to(self, Py_ssize_t line):
        """Go to the row of the state in ``data``."""
        self.line = line

    cdef bint command(self, Limits limits) except -1:
        cdef Py_ssize_t i
        for i in range(self.effort.shape[0]):
            self.effort[i], self.powered[i] = self.efforts[self.line, i], self.on[self.line, i]
        if not limits.apply():
            return False
        for i in range(self.ctrl.shape[0]):
            if self.ctrl[i] != self.ctrls[self.line, i]:
                return False  # the logged efforts act, and are not what the limits leave of the command
        for i in range(self.copied.shape[0]):
            self.copy[i] = self.rows[self.line, self.copied[i]]
        return True

    cdef bint arrives(self) except -1:
        cdef Py_ssize_t i, nq = self.qpos.shape[0], nv = self.qvel.shape[0]
        cdef double* predicted
        self.line += 1
        predicted = &self.predicted[self.line, 0]
        memcpy(predicted, &self.qpos[0], nq * sizeof(double))
        memcpy(predicted + nq, &self.qvel[0], nv * sizeof(double))
        for i in range(nq + nv):
            # Bit by bit: a row that differs in the last place is set to the logged state, which the loop enters in the
            # balance.
            if predicted[i] != self.states[self.line, i]:
                return False
        return True
