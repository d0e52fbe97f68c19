# cython: boundscheck=False, wraparound=False
"""Copies of live arrays into lines of tables; twin of ffsm_mj.records.sampler."""

import numpy as np

from libc.stdlib cimport calloc, free
from libc.string cimport memcpy

from ffsm_mj_fast.functions cimport address, mj, mjData, mjModel, mjOBJ_SITE


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
