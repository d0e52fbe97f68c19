# cython: boundscheck=False, wraparound=False, cdivision=True
"""Contact forces in one stage of a step in one block of memory; for Stage in ffsm_mj.contact_models.persistent.exchange.

No point slides with friction.
"""

import numpy as np

from libc.string cimport memset

from ffsm_mj_fast.row_memory cimport RowMemory


cdef class StageInMemory:
    """Forces along the rows, (r,), their power by degree of freedom, (nv,), and wrenches on each group of points, (g, 6)."""

    def __reduce__(self):
        """How a saved state of a simulation holds it."""
        return stage_in_memory, (self.rows, self.block, self.count, self.nv, self.groups, self.frictional)

    @property
    def slide(self):
        """Heat and slip of the points: none."""
        return None

    @property
    def forces(self):
        """Normal forces, N, (k,)."""
        along = self.block[: self.count]
        return along[::3] if self.frictional else along

    @property
    def friction(self):
        """Friction force on geom b of each point, world axes, N, (k, 3); None without friction."""
        return self.rows.friction_forces(self.block[: self.count])

    @property
    def power(self):
        """Power of the contact forces by degree of freedom, W, (nv,)."""
        return self.block[self.count : self.count + self.nv]

    @property
    def wrenches(self):
        """Force, and moment about the world origin, on geom b of each group of points of one pair."""
        return self.block[self.count + self.nv :].reshape(-1, 6)


def stage_in_memory(rows, block, count, nv, groups, frictional):
    """A stage that was saved."""
    cdef StageInMemory stage = StageInMemory.__new__(StageInMemory)
    cdef double[::1] memory = block
    stage.rows, stage.block, stage.count, stage.nv, stage.groups, stage.frictional = rows, block, count, nv, groups, frictional
    stage.along, stage.powers, stage.found = &memory[0], &memory[0] + stage.count, &memory[0] + stage.count + stage.nv
    return stage


cdef StageInMemory empty_stage(rows, Py_ssize_t count, Py_ssize_t nv, Py_ssize_t groups, bint frictional):
    """A stage without forces."""
    return stage_in_memory(rows, np.zeros(count + nv + 6 * groups), count, nv, groups, frictional)


cdef int finish_stage(StageInMemory stage, RowMemory own, const double* qvel, double* generalised) except -1:
    """Write power and wrenches of the forces of a stage along rows, and the generalised forces, (nv,)."""
    cdef Py_ssize_t i, d, nv = own.nv
    cdef double force
    cdef const double* J
    memset(generalised, 0, nv * sizeof(double))
    for i in range(own.rows):
        force, J = stage.along[i], own.J + i * nv
        if force != 0.0:
            for d in range(nv):
                generalised[d] += force * J[d]
    for d in range(nv):
        stage.powers[d] = generalised[d] * qvel[d]
    return own.write_resultants(stage.along, stage.found)
