# cython: boundscheck=False, wraparound=False, cdivision=True
"""Contact forces in one stage of a step in one block of memory; for Stage in ffsm_mj.contact_models.persistent.exchange."""

cimport cython

import numpy as np

from libc.string cimport memset

from ffsm_mj_fast.memory cimport numbers, zeros
from ffsm_mj_fast.row_memory cimport RowMemory


@cython.no_gc  # no cycle contains it
cdef class StageInMemory:
    """Forces along the rows, (r,), their power by degree of freedom, (nv,), and wrenches on each group of points, (g, 6)."""

    slide = None

    def __reduce__(self):
        """How a saved state of a simulation holds it."""
        return stage_in_memory, (self.rows, bytes(self.block), self.count, self.nv, self.groups, self.frictional)

    @property
    def forces(self):
        """Normal forces, N, (k,)."""
        along = np.frombuffer(self.block)[: self.count]
        return along[::3] if self.frictional else along

    @property
    def friction(self):
        """Friction force on geom b of each point, world axes, N, (k, 3); None without friction."""
        return self.rows.friction_forces(np.frombuffer(self.block)[: self.count])

    @property
    def power(self):
        """Power of the contact forces by degree of freedom, W, (nv,)."""
        return np.frombuffer(self.block)[self.count : self.count + self.nv]

    @property
    def wrenches(self):
        """Force, and moment about the world origin, on geom b of each group of points of one pair."""
        return np.frombuffer(self.block)[self.count + self.nv : self.count + self.nv + 6 * self.groups].reshape(-1, 6)


def stage_in_memory(rows, block, count, nv, groups, frictional):
    """A stage that was saved."""
    return new_stage(rows, bytearray(block), count, nv, groups, frictional)


cdef StageInMemory new_stage(rows, bytearray block, Py_ssize_t count, Py_ssize_t nv, Py_ssize_t groups, bint frictional):
    cdef StageInMemory stage = StageInMemory.__new__(StageInMemory)
    stage.rows, stage.block, stage.count, stage.nv, stage.groups = rows, block, count, nv, groups
    stage.frictional, stage.along = frictional, numbers(block)
    stage.powers, stage.found = stage.along + count, stage.along + count + nv
    return stage


cdef StageInMemory empty_stage(rows, Py_ssize_t count, Py_ssize_t nv, Py_ssize_t groups, bint frictional):
    """A stage without forces."""
    return new_stage(rows, zeros(count + nv + 6 * groups + 1), count, nv, groups, frictional)


cdef void generalise(const double* along, RowMemory own, double* generalised) noexcept:
    """Generalised forces, (nv,), of forces along rows."""
    cdef Py_ssize_t i, d, nv = own.nv
    cdef const double* J
    memset(generalised, 0, nv * sizeof(double))
    for i in range(own.rows):
        if along[i] != 0.0:
            J = own.J + i * nv
            for d in range(nv):
                generalised[d] += along[i] * J[d]


cdef int finish_stage(StageInMemory stage, RowMemory own, const double* qvel, const double* generalised) except -1:
    """Write power and wrenches of the forces of a stage."""
    cdef Py_ssize_t d
    for d in range(own.nv):
        stage.powers[d] = generalised[d] * qvel[d]
    return own.write_resultants(stage.along, stage.found)
