# cython: boundscheck=False, wraparound=False, cdivision=True
"""Integrals of contact forces over a step; twin of StageSums in ffsm_mj.contact_models.persistent.exchange."""

import numpy as np

from libc.math cimport sqrt


cdef class StageSums:
    """Integrals over a step of the contact forces in its stages."""

    cdef readonly object work, impulses
    cdef readonly double total
    cdef readonly list sizes

    def __init__(self, stages, const double[::1] parts not None):
        cdef const double[::1] power
        cdef const double[:, ::1] wrenches
        cdef double[::1] work
        cdef double[:, ::1] impulses
        cdef Py_ssize_t s, g, i
        cdef double part
        first = np.asarray(stages[0].wrenches)
        self.work, self.impulses, self.total = np.zeros(len(stages[0].power)), np.zeros_like(first), 0.0
        work, impulses, self.sizes = self.work, self.impulses, [0.0] * len(first)
        for s in range(parts.shape[0]):
            part, power, wrenches = parts[s], stages[s].power, np.asarray(stages[s].wrenches)
            for i in range(power.shape[0]):
                work[i] += part * power[i]
            for g in range(wrenches.shape[0]):
                for i in range(6):
                    impulses[g, i] += part * wrenches[g, i]
                self.sizes[g] += part * sqrt(
                    wrenches[g, 0] * wrenches[g, 0] + wrenches[g, 1] * wrenches[g, 1] + wrenches[g, 2] * wrenches[g, 2]
                )
        for i in range(work.shape[0]):
            self.total += work[i]

    def __reduce__(self):
        """How a saved state of a simulation holds it."""
        return stage_sums, (self.work, self.impulses, self.total, self.sizes)


def stage_sums(work, impulses, total, sizes):
    """Integrals that were saved."""
    cdef StageSums sums = StageSums.__new__(StageSums)
    sums.work, sums.impulses, sums.total, sums.sizes = work, impulses, total, sizes
    return sums
