# cython: boundscheck=False, wraparound=False, cdivision=True
"""Contact points with friction at one state; twin of ffsm_mj.contact_models.persistent.friction.state."""

cimport cython

import numpy as np

from ffsm_mj.contact_models.persistent.friction import cone_depth, internal_forces
from ffsm_mj.contact_models.persistent.friction.held_rows import HeldRows
from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem
from ffsm_mj.contact_models.persistent.friction.solution import Solution

from ffsm_mj.tolerances import CANCELLED

from libc.math cimport INFINITY, fabs, sqrt
from libc.string cimport memcpy, memset

from ffsm_mj_fast.held_rows cimport HeldForces, of_rows
from ffsm_mj_fast.memory cimport numbers, room
from ffsm_mj_fast.row_memory cimport RowMemory
from ffsm_mj_fast.rows cimport write_rounding
from ffsm_mj_fast.smooth cimport Smooth
from ffsm_mj_fast.stage_in_memory cimport StageInMemory, empty_stage, finish_stage, generalise

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


@cython.no_gc  # no cycle contains it
cdef class FrictionState:
    """What stages and decisions need of k contact points at one state."""

    def __init__(self, contact_points, rows, const double[::1] force not None, modes):
        self.set_up(contact_points, rows, rows.memory, modes)
        if self.own.nv:
            memcpy(self.pushed, &force[0], self.own.nv * sizeof(double))
        self.accelerate()

    cdef int set_up(self, contact_points, rows, RowMemory own, modes) except -1:
        self.contact_points, self.rows, self.own, self.modes, self.mu = contact_points, rows, own, modes, modes.mu
        self.block = room(2 * own.rows + own.points + own.nv + 1)
        self.b = numbers(self.block)
        self.stuck = self.b + own.rows
        self.roughness = self.stuck + own.rows
        self.pushed = self.roughness + own.points
        return 0

    cdef void accelerate(self) noexcept:
        cdef const double* response
        cdef Py_ssize_t i, d, nv = self.own.nv
        cdef double total
        for i in range(self.own.rows):
            response, total = self.own.response + i * nv, self.own.gamma[i]
            for d in range(nv):
                total += response[d] * self.pushed[d]
            self.b[i] = total

    def __reduce__(self):
        """How a saved state of a simulation holds it."""
        return type(self), (self.contact_points, self.rows, self.force, self.modes)

    @property
    def force(self):
        """Generalised forces without the contact forces, less the bias, (nv,)."""
        at = 2 * self.own.rows + self.own.points
        return np.frombuffer(self.block)[at : at + self.own.nv]

    @property
    def problem(self):
        """The problem of the accelerations of the points."""
        if self.kept_problem is None:
            rows, modes = self.rows, self.modes
            b = np.frombuffer(self.block)[: self.own.rows]
            self.kept_problem = FrictionProblem(rows.G, b, modes.mu, modes.structures, rows.held)
        return self.kept_problem

    @property
    def rounding(self):
        """Rounding of the accelerations of each point, m/s^2, (k,)."""
        self.roundings()
        return np.frombuffer(self.block)[2 * self.own.rows : 2 * self.own.rows + self.own.points]

    cdef double* roundings(self) except NULL:
        if not self.has_rounding:
            write_rounding(self.rows.groups, self.own, self.pushed, self.roughness)
            self.has_rounding = True
        return self.roughness

    cdef HeldForces held(self):
        """The linear problem in the present modes."""
        structure = structure_of(self.modes, self.own)
        both = self.modes.key, structure.key
        held = self.rows.held.get(both)
        if held is None:
            held = self.rows.held[both] = of_rows(self.own, structure)
        return held

    cdef double* stuck_forces(self) except NULL:
        """Forces (n, t1, t2) in the present modes, in which no point slides with friction, N, (k, 3)."""
        if not self.has_forces:
            memset(self.stuck, 0, self.own.rows * sizeof(double))
            if self.own.points:
                self.held().write_forces(self.b, self.stuck)
            self.has_forces = True
        return self.stuck

    cdef bint creeps(self) noexcept:
        """Whether no point slips by more than the drift of sticking points."""
        cdef Py_ssize_t p
        cdef double u, v, most = self.modes.drift_m_s
        for p in range(self.own.points):
            u, v = self.own.velocity(3 * p + 1), self.own.velocity(3 * p + 2)
            if not u * u + v * v <= most * most:
                return False
        return True

    cdef double largest_slip(self) noexcept:
        """Largest slip along a tangent, m/s."""
        cdef Py_ssize_t p
        cdef double most = 0.0
        for p in range(self.own.points):
            most = max(most, max(fabs(self.own.velocity(3 * p + 1)), fabs(self.own.velocity(3 * p + 2))))
        return most

    cdef double margin(self) except? -2.0:
        """Least margin of the points to their own cones, m/s^2, if all stick and none slips; negative otherwise."""
        if not self.has_margin:
            self.has_margin = True
            self.kept_margin = self.own_margin() if self.modes.all_stick and self.creeps() else -1.0
        return self.kept_margin

    cdef double own_margin(self) except? -2.0:
        cdef const double* forces = self.stuck_forces()
        cdef const double* rounding = self.roundings()
        cdef Py_ssize_t p
        cdef int j
        cdef double least = 0.0, largest = 0.0, roughest = 0.0, inertia = 0.0, depth
        for p in range(self.own.points):
            depth = self.mu[p] * forces[0] - sqrt(forces[1] * forces[1] + forces[2] * forces[2])
            least = depth if p == 0 or depth < least else least
            roughest, inertia = max(roughest, rounding[p]), inertia + self.own.inverse_mass(3 * p)
            for j in range(3):
                largest = max(largest, fabs(forces[j]))
            forces += 3
        inertia /= self.own.points
        return least * inertia + ON_CONE * (largest * inertia + roughest)

    def sticking(self):
        """The solution if all points stick and may go on to do so: none slips, and each is inside its own cone."""
        cdef double[:, ::1] accelerations
        cdef const double* G
        cdef const double* forces
        cdef Py_ssize_t i, j, m = self.own.rows
        cdef double total, least = self.margin()
        if not least >= 0.0:
            return None
        rates, forces, G = np.empty((self.own.points, 3)), self.stuck_forces(), self.own.delassus()
        found, accelerations = np.frombuffer(self.block)[m : 2 * m].reshape(-1, 3), rates
        for i in range(m):
            total = self.b[i]
            for j in range(m):
                total += G[i * m + j] * forces[j]
            (&accelerations[0, 0])[i] = total
        return Solution(self.modes.kinds, self.modes.no_slips, found, rates, least, least, False)

    def limit_ratios(self, const double[:, :] forces not None):
        """Ratios of friction to its limit; infinite where a normal force pulls, zero where there is no friction."""
        cdef const double[:, ::1] given = np.ascontiguousarray(forces)
        cdef Py_ssize_t p, n = forces.shape[0]
        cdef bytearray block = room(n + 1)
        cdef double* ratios = numbers(block)
        if n:
            largest_ratio(&given[0, 0], self.mu, ratios)
        return [ratios[p] for p in range(n)]

    def stuck_stage(self):
        """A stage in the present modes, in which no point slides with friction, and the generalised forces, (nv,)."""
        generalised = np.empty(self.own.nv)
        cdef double[::1] sums = generalised
        return self.stuck_into(&sums[0]), generalised

    cdef StageInMemory stuck_into(self, double* generalised):
        cdef RowMemory own = self.own
        cdef StageInMemory stage = empty_stage(self.rows, own.rows, own.nv, len(own.counts), True)
        memcpy(stage.along, self.stuck_forces(), own.rows * sizeof(double))
        generalise(stage.along, own, generalised)
        finish_stage(stage, own, own.qvel, generalised)
        return stage


cdef FrictionState state_under(contact_points, rows, RowMemory own, modes, Smooth smooth, const double* pushes):
    """The points under the smooth forces at the current state and applied forces, (nv,)."""
    cdef FrictionState here = FrictionState.__new__(FrictionState)
    here.set_up(contact_points, rows, own, modes)
    smooth.write_force(pushes, here.pushed)
    here.accelerate()
    return here


cdef double largest_ratio(const double* forces, const double[::1] mu, double* ratios) noexcept:
    """Ratios of friction to its limit, see ``FrictionState.limit_ratios``, and the largest of them."""
    cdef Py_ssize_t p
    cdef double friction, limit, rounding = 0.0, largest = 0.0
    for p in range(3 * mu.shape[0]):
        rounding = max(rounding, FRICTION_ROUNDING * fabs(forces[p]))
    for p in range(mu.shape[0]):
        friction = sqrt(forces[1] * forces[1] + forces[2] * forces[2])
        limit = mu[p] * forces[0]
        ratios[p] = 0.0 if friction <= rounding else friction / limit if limit > 0.0 else INFINITY
        largest, forces = max(largest, ratios[p]), forces + 3
    return largest
