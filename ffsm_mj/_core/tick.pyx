# cython: boundscheck=False, wraparound=False
"""What every control tick and every step need: copies of live arrays into a row, limits of efforts, and their work."""

import numpy as np

from libc.math cimport isfinite
from libc.stdlib cimport calloc, free
from libc.string cimport memcpy

from ffsm_mj._core.functions cimport address, mj, mjData, mjModel, mjOBJ_SITE


cdef struct Copy:
    const char* live
    char* table
    size_t size, stride, lines


cdef class Sampler:
    """Samples live arrays, after a refresh of the quantities that MuJoCo does not keep current."""

    cdef readonly object jacp, jacr, twist
    cdef const mjModel* m
    cdef mjData* d
    cdef int base, tip
    cdef double[:, ::1] p, r
    cdef double[::1] v
    cdef Copy* copies
    cdef int count
    cdef object keep

    def __init__(self, model, data, *, int base=-1, int tip=-1):
        self.m, self.d, self.base, self.tip = <const mjModel*>address(model), <mjData*>address(data), base, tip
        self.jacp, self.jacr, self.twist = np.zeros((3, model.nv)), np.zeros((3, model.nv)), np.zeros(6)
        self.p, self.r, self.v = self.jacp, self.jacr, self.twist
        self.keep = model, data

    def __dealloc__(self):
        free(self.copies)

    def copy(self, copies):
        """Set what is copied: pairs of a live array and its table, one axis longer; lines of tables are contiguous.

        Raises:
            ValueError: An array is not of contiguous doubles, or does not fit into its table.
        """
        cdef size_t live_place, table_place
        cdef int i
        copies = tuple((live, table) for live, table in copies if live.size)
        for live, table in copies:
            line = table[0]
            both = live.dtype == table.dtype == np.float64 and live.flags.c_contiguous and line.flags.c_contiguous
            if not both or live.shape != line.shape or not table.flags.writeable:
                raise ValueError(f"cannot copy {live.dtype} {live.shape} into lines of {table.dtype} {line.shape}")
        self.count = 0
        free(self.copies)
        self.copies = <Copy*>calloc(max(len(copies), 1), sizeof(Copy))
        if self.copies == NULL:
            raise MemoryError
        self.count, self.keep = len(copies), (self.keep[0], self.keep[1], copies)
        for i, (live, table) in enumerate(copies):
            live_place, table_place = live.ctypes.data, table.ctypes.data
            self.copies[i].live, self.copies[i].table = <const char*>live_place, <char*>table_place
            self.copies[i].size, self.copies[i].stride = live.nbytes, table.strides[0]
            self.copies[i].lines = len(table)

    def take(self, size_t line):
        """Refresh, and copy into a line of the tables.

        Raises:
            IndexError: A table has no such line.
        """
        cdef int i
        cdef Copy* one
        if self.base >= 0:
            mj.subtreeVel(self.m, self.d)
            mj.jacBody(self.m, self.d, &self.p[0, 0], &self.r[0, 0], self.base)
        if self.tip >= 0:
            mj.objectVelocity(self.m, self.d, mjOBJ_SITE, self.tip, &self.v[0], 0)
        for i in range(self.count):
            one = &self.copies[i]
            if line >= one.lines:
                raise IndexError(f"line {line} of a table of {one.lines}")
            memcpy(one.table + line * one.stride, one.live, one.size)


cdef class JointWork:
    """Accumulates the work of each (sub-)step."""

    cdef double[::1] held, length, force, account, start
    cdef const double[::1] on_joint, external
    cdef bint working

    def __init__(self, data, const double[::1] on_joint, const double[::1] external, double[::1] account not None):
        if not len(data.ctrl) == len(on_joint) == len(external) or len(account) == 0:
            raise ValueError(f"{len(on_joint)} and {len(external)} flags and an account of {len(account)} do not fit the actuators")
        self.held, self.length, self.force = data.ctrl, data.actuator_length, data.actuator_force
        self.on_joint, self.external, self.account = on_joint, external, account
        self.start = data.actuator_length.copy()
        self.working = False

    def open(self):
        """Begin a step; returns whether an effort in it is external."""
        cdef Py_ssize_t i
        cdef bint pushed = False
        self.working = False
        for i in range(self.held.shape[0]):
            self.start[i] = self.length[i]
            if self.held[i] != 0.0:
                self.working = True
                pushed = pushed or self.external[i] != 0.0
        return pushed

    def close(self):
        """End the step and add its work."""
        cdef Py_ssize_t i
        cdef double work = 0.0
        if self.working:
            for i in range(self.held.shape[0]):
                work += self.force[i] * self.on_joint[i] * (self.length[i] - self.start[i])
            self.account[0] += work


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
