# cython: boundscheck=False, wraparound=False, cdivision=True
"""Contact forces in the stages inside a step; twin of ffsm_mj.contact_models.persistent.stage_forces.

Points over faces and joint limits are evaluated here, in memory that is used again from stage to stage; others, and points
of which some slide with friction, by the original.
"""

import numpy as np

from ffsm_mj.contact_models.persistent import stage_forces as plain

from ffsm_mj_fast.contact_acceleration import Active

from libc.string cimport memset

from ffsm_mj_fast.friction_state cimport structure_of
from ffsm_mj_fast.held_rows cimport HeldForces, of_rows
from ffsm_mj_fast.patches cimport patches_of
from ffsm_mj_fast.row_memory cimport RowMemory
from ffsm_mj_fast.rows cimport RowEvaluator
from ffsm_mj_fast.smooth cimport Smooth
from ffsm_mj_fast.stage_in_memory cimport StageInMemory, empty_stage, finish_stage, generalise


cdef class StageForces:
    """Contact forces of some points in the modes of a step."""

    def __init__(self, smooth, evaluator, contact_points, modes):
        self.given = smooth, evaluator, contact_points, modes
        self.contact_points, self.modes, self.frictional = contact_points, modes, modes is not None
        self.smooth, self.evaluator = smooth, evaluator
        if self.smooth.motion.loops is None and not (self.frictional and modes.any_slides):
            self.states = self.evaluator.groups_in_memory()
        if self.states is None:
            self.other = plain.StageForces(smooth, evaluator, contact_points, modes)
            return
        self.own = self.evaluator.empty(self.frictional)
        self.force, self.b, self.sums = np.empty(self.own.nv), np.empty(self.own.rows), np.empty(self.own.nv)
        if self.frictional:
            self.patches = patches_of(self.evaluator) if modes.all_stick else None
        else:
            self.structure = Active(self.own.rows, np.arange(self.own.rows))

    def __reduce__(self):
        """How a saved state of a simulation holds it: it has no memory."""
        return type(self), self.given

    def begin(self, rows):
        """Begin a step at the current state, with the rows of the points there; required with friction."""
        if self.other is not None:
            self.other.begin(rows)

    def add(self, double[::1] applied not None):
        """Add the forces at the current state to the applied ones, (nv,), and return the stage."""
        return self.add_to(applied)

    cdef object add_to(self, double[::1] applied):
        cdef RowMemory own = self.own
        cdef StageInMemory stage
        cdef Py_ssize_t d
        if self.other is not None:
            return self.other.add(applied.base)
        self.smooth.write_force(&applied[0], &self.force[0])
        self.evaluator.evaluate(self.states, own, self.frictional)
        stage = empty_stage(None, own.rows, own.nv, len(own.counts), self.frictional)
        if self.patches is not None and self.patches.prepare(self.states, own):
            self.patches.solve(own, &self.force[0], stage.along, &self.sums[0])
        else:
            self.hold_rows(stage)
        finish_stage(stage, own, &self.evaluator.rates[0], &self.sums[0])
        for d in range(own.nv):
            applied[d] += self.sums[d]
        return stage

    cdef int hold_rows(self, StageInMemory stage) except -1:
        """Find the forces that hold the rows of all points, and the generalised forces."""
        cdef RowMemory own = self.own
        cdef Py_ssize_t i, d
        cdef double total
        cdef const double* response
        self.evaluator.combine(own, 3 if self.frictional else 1)
        for i in range(own.rows):
            response, total = own.response + i * own.nv, own.gamma[i]
            for d in range(own.nv):
                total += response[d] * self.force[d]
            self.b[i] = total
        memset(stage.along, 0, own.rows * sizeof(double))
        self.hold()
        self.held.write_forces(&self.b[0], stage.along)
        generalise(stage.along, own, &self.sums[0])
        return 0

    cdef int hold(self) except -1:
        """Take the rows that are held in this step, as the start of the step determined them, and their matrix."""
        if self.frictional:
            structure = structure_of(self.modes, self.own)
            if structure is not self.structure:
                self.structure, self.held = structure, None
        if self.held is None:
            self.held = of_rows(self.own, self.structure)
        else:
            self.held.take(self.own.delassus())
        return 0
