# cython: boundscheck=False, wraparound=False, cdivision=True
"""Contact points with friction at one state; twin of ffsm_mj.contact_models.persistent.friction.state."""

import numpy as np

from ffsm_mj.contact_models.persistent.friction import cone_depth, internal_forces
from ffsm_mj.contact_models.persistent.friction.held_rows import HeldRows
from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem
from ffsm_mj.contact_models.persistent.friction.solution import Solution

from ffsm_mj.tolerances import CANCELLED

from libc.math cimport INFINITY, fabs, sqrt
from libc.string cimport memcpy

from ffsm_mj_fast.held_rows cimport HeldForces, of_rows
from ffsm_mj_fast.row_memory cimport RowMemory
from ffsm_mj_fast.rows cimport write_rounding
from ffsm_mj_fast.stage_in_memory cimport StageInMemory, empty_stage, finish_stage

cdef double ON_CONE = cone_depth.ON_CONE, FRICTION_ROUNDING = internal_forces.FRICTION_ROUNDING


cdef double _CANCELLED = CANCELLED
NONE = np.zeros(0, dtype=np.intp)


cdef object structure_of(modes, RowMemory own):
    """The rows held in the modes of a step: as at the first of its states that needs them."""
    cdef const double* G
    cdef Py_ssize_t i, m = own.rows
    cdef double largest = 1.0
    structure = modes.structures.get(modes.key)
    if structure is not None:
        return structure
    if modes.all_stick:
        G = own.delassus()
        for i in range(m):
            largest = max(largest, G[i * (m + 1)])
        movable = [i for i in range(m) if G[i * (m + 1)] > _CANCELLED * largest]
        structure = HeldRows(m, np.array(movable, dtype=np.intp), NONE, HeldForces)
    else:
        own.delassus()
        structure = HeldRows.of(FrictionProblem(own.array("G"), np.empty(m), modes.mu), modes.kinds)
    modes.structures[modes.key] = structure
    return structure


cdef class FrictionState:
    """What stages and decisions need of k contact points at one state."""

    cdef readonly object contact_points, rows, force, modes
    cdef RowMemory own
    cdef object kept_problem, kept_rounding, kept_forces, b
    cdef double[::1] values
    cdef const double[::1] pushed

    def __init__(self, contact_points, rows, force, modes):
        cdef const double[::1] pushed = force
        cdef const double* response
        cdef Py_ssize_t i, d
        cdef double total
        self.pushed = pushed
        self.contact_points, self.rows, self.force, self.modes, self.own = contact_points, rows, force, modes, rows.memory
        self.b = np.empty(self.own.rows)
        self.values = self.b
        for i in range(self.own.rows):
            response, total = self.own.response + i * self.own.nv, self.own.gamma[i]
            for d in range(self.own.nv):
                total += response[d] * pushed[d]
            self.values[i] = total

    def __reduce__(self):
        """How a saved state of a simulation holds it."""
        return type(self), (self.contact_points, self.rows, self.force, self.modes)

    @property
    def problem(self):
        """The problem of the accelerations of the points."""
        if self.kept_problem is None:
            rows, modes = self.rows, self.modes
            self.kept_problem = FrictionProblem(rows.G, self.b, modes.mu, modes.structures, rows.held)
        return self.kept_problem

    @property
    def rounding(self):
        """Rounding of the accelerations of each point, m/s^2, (k,)."""
        cdef double[::1] found
        if self.kept_rounding is None:
            self.kept_rounding = np.empty(self.own.points)
            found = self.kept_rounding
            if self.own.points:
                write_rounding(self.rows.groups, self.own, &self.pushed[0], &found[0])
        return self.kept_rounding

    cdef HeldForces held(self):
        """The linear problem in the present modes."""
        structure = structure_of(self.modes, self.own)
        both = self.modes.key, structure.key
        held = self.rows.held.get(both)
        if held is None:
            held = self.rows.held[both] = of_rows(self.modes.mu, self.own, structure)
        return held

    cdef object stuck_forces(self):
        """Forces (n, t1, t2) in the present modes, in which no point slides with friction, N, (k, 3)."""
        cdef double[:, ::1] found
        if self.kept_forces is None:
            forces = np.zeros((self.own.points, 3))
            found = forces
            if self.own.points:
                self.held().write_forces(&self.values[0], &found[0, 0])
            self.kept_forces = forces
        return self.kept_forces

    cdef bint creeps(self) noexcept:
        """Whether no point slips by more than the drift of sticking points."""
        cdef Py_ssize_t p, d
        cdef int j
        cdef const double* J
        cdef double total, square, most = self.modes.drift_m_s
        for p in range(self.own.points):
            square = 0.0
            for j in range(1, 3):
                J, total = self.own.J + (3 * p + j) * self.own.nv, 0.0
                for d in range(self.own.nv):
                    total += J[d] * self.own.qvel[d]
                square += total * total
            if not square <= most * most:
                return False
        return True

    def sticking(self):
        """The solution if all points stick and may go on to do so: none slips, and each is inside its own cone."""
        cdef double[:, ::1] forces, accelerations
        cdef const double[::1] mu, rounding
        cdef const double* G
        cdef Py_ssize_t p, i, j, m = self.own.rows
        cdef double least, largest = 0.0, roughest = 0.0, inertia = 0.0, depth, total
        if not self.modes.all_stick or not self.creeps():
            return None
        found, rates, rounding, mu = self.stuck_forces(), np.empty((self.own.points, 3)), self.rounding, self.modes.mu
        forces, accelerations, G = found, rates, self.own.delassus()
        for p in range(self.own.points):
            depth = mu[p] * forces[p, 0] - sqrt(forces[p, 1] * forces[p, 1] + forces[p, 2] * forces[p, 2])
            least = depth if p == 0 or depth < least else least
            roughest, inertia = max(roughest, rounding[p]), inertia + G[3 * p * (m + 1)]
            for j in range(3):
                largest = max(largest, fabs(forces[p, j]))
        inertia /= self.own.points
        least = least * inertia + ON_CONE * (largest * inertia + roughest)
        if not least >= 0.0:
            return None
        for i in range(m):
            total = self.values[i]
            for j in range(m):
                total += G[i * m + j] * (&forces[0, 0])[j]
            (&accelerations[0, 0])[i] = total
        return Solution(self.modes.kinds, self.modes.no_slips, found, rates, least, False)

    def limit_ratios(self, const double[:, :] forces not None):
        """Ratios of friction to its limit; infinite where a normal force pulls, zero where there is no friction."""
        cdef const double[::1] mu = self.modes.mu
        cdef Py_ssize_t p
        cdef int i
        cdef double friction, limit, rounding = 0.0
        for p in range(forces.shape[0]):
            for i in range(3):
                rounding = max(rounding, FRICTION_ROUNDING * fabs(forces[p, i]))
        ratios = []
        for p in range(forces.shape[0]):
            friction = sqrt(forces[p, 1] * forces[p, 1] + forces[p, 2] * forces[p, 2])
            limit = mu[p] * forces[p, 0]
            ratios.append(0.0 if friction <= rounding else friction / limit if limit > 0.0 else INFINITY)
        return ratios

    def stuck_stage(self):
        """A stage in the present modes, in which no point slides with friction, and the generalised forces, (nv,)."""
        cdef RowMemory own = self.own
        cdef StageInMemory stage = empty_stage(self.rows, own.rows, own.nv, len(own.counts), True)
        cdef double[:, ::1] forces = self.stuck_forces()
        generalised = np.empty(own.nv)
        cdef double[::1] sums = generalised
        if own.rows:
            memcpy(stage.along, &forces[0, 0], own.rows * sizeof(double))
        finish_stage(stage, own, own.qvel, &sums[0])
        return stage, generalised
