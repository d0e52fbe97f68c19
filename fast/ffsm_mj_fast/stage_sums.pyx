# cython: boundscheck=False, wraparound=False, cdivision=True
"""Integrals of contact forces over a step; twin of StageSums in ffsm_mj.contact_models.persistent.exchange."""

import numpy as np

from ffsm_mj.balance.exchange import Exchange

from libc.math cimport sqrt

from ffsm_mj_fast.stage_in_memory cimport StageInMemory


cdef class StageSums:
    """Integrals over a step of the contact forces in its stages."""

    cdef readonly object work, impulses
    cdef readonly double total
    cdef readonly list sizes

    def __init__(self, stages, const double[::1] parts not None):
        cdef StageInMemory first = stages[0] if isinstance(stages[0], StageInMemory) else None
        cdef Py_ssize_t groups = first.groups if first is not None else len(stages[0].wrenches)
        cdef Py_ssize_t nv = first.nv if first is not None else len(stages[0].power)
        cdef Py_ssize_t s, i
        self.work, self.impulses, self.total = np.zeros(nv), np.zeros((groups, 6)), 0.0
        cdef double[::1] work = self.work
        cdef double[:, ::1] impulses = self.impulses
        cdef const double[::1] power
        cdef double[:, ::1] wrenches
        cdef StageInMemory stage
        self.sizes = [0.0] * groups
        for s in range(parts.shape[0]):
            if isinstance(stages[s], StageInMemory):
                stage = stages[s]
                self.add(parts[s], stage.powers, &work[0], nv, stage.found, &impulses[0, 0] if groups else NULL, groups)
            else:
                power, wrenches = stages[s].power, np.array(stages[s].wrenches, dtype=np.float64).reshape(-1, 6)
                self.add(
                    parts[s], &power[0], &work[0], nv, &wrenches[0, 0] if groups else NULL, &impulses[0, 0] if groups else NULL, groups
                )
        for i in range(nv):
            self.total += work[i]

    cdef int add(
        self,
        double part,
        const double* power,
        double* work,
        Py_ssize_t nv,
        const double* wrenches,
        double* impulses,
        Py_ssize_t groups,
    ) except -1:
        """Add a stage with its weight."""
        cdef Py_ssize_t i, g
        for i in range(nv):
            work[i] += part * power[i]
        for i in range(6 * groups):
            impulses[i] += part * wrenches[i]
        for g in range(groups):
            self.sizes[g] += part * sqrt(
                wrenches[6 * g] * wrenches[6 * g]
                + wrenches[6 * g + 1] * wrenches[6 * g + 1]
                + wrenches[6 * g + 2] * wrenches[6 * g + 2]
            )
        return 0

    def exchange(self, const double[::1] from_robot not None, const double[:, ::1] outside not None, robot):
        """Energy and momentum exchanged between the subsystems."""
        cdef const double[::1] work = self.work
        cdef const double[:, ::1] impulses = self.impulses
        cdef Py_ssize_t i, g
        found = np.zeros(21)
        cdef double[::1] sums = found
        for i in range(<Py_ssize_t>robot.start, <Py_ssize_t>robot.stop):
            sums[1] += work[i]
        sums[0], sums[2] = self.total, self.total - sums[1]
        for g in range(impulses.shape[0]):
            for i in range(6):
                sums[3 + i] += from_robot[g] * impulses[g, i]
                sums[9 + i] += outside[0, g] * impulses[g, i]
                sums[15 + i] += outside[1, g] * impulses[g, i]
        return Exchange(found[:3], found[3:9], found[9:].reshape(2, 6))

    def __reduce__(self):
        """How a saved state of a simulation holds it."""
        return stage_sums, (self.work, self.impulses, self.total, self.sizes)


def stage_sums(work, impulses, total, sizes):
    """Integrals that were saved."""
    cdef StageSums sums = StageSums.__new__(StageSums)
    sums.work, sums.impulses, sums.total, sums.sizes = work, impulses, total, sizes
    return sums
