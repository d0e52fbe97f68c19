# cython: boundscheck=False, wraparound=False, cdivision=True
"""Contact forces without friction; twin of ffsm_mj.contact_models.persistent.acceleration.

The original solves the complementarity problem where the active set is not the expected one.
"""

from typing import NamedTuple

cimport cython

import numpy as np

from ffsm_mj.contact_models.persistent import acceleration as plain
from ffsm_mj.tolerances import ACCELERATION, ACCELERATION_M_S2

from libc.math cimport INFINITY, fabs
from libc.string cimport memcpy, memset

from ffsm_mj_fast.held_rows cimport HeldForces, of_rows
from ffsm_mj_fast.memory cimport numbers, room
from ffsm_mj_fast.row_memory cimport RowMemory
from ffsm_mj_fast.rows cimport write_scales
from ffsm_mj_fast.smooth cimport Smooth
from ffsm_mj_fast.stage_in_memory cimport StageInMemory, empty_stage, finish_stage, generalise

cdef double _ACCELERATION = ACCELERATION, _ACCELERATION_M_S2 = ACCELERATION_M_S2
cdef double CLEARLY = plain.CLEARLY, IMMOVABLE = plain.IMMOVABLE


class Active(NamedTuple):
    """Active contacts, as a structure of held rows."""

    count: int
    rows: object


@cython.no_gc  # no cycle contains it
cdef class ContactAcceleration:
    """The contact problem at one state."""

    def __init__(self, M, rows, const double[::1] force not None):
        self.set_up(M, rows, rows.memory)
        if self.own.nv:
            memcpy(self.pushed, &force[0], self.own.nv * sizeof(double))
        self.accelerate()

    cdef int set_up(self, M, rows, RowMemory own) except -1:
        self.M, self.rows, self.own, self.held = M, rows, own, {}
        self.block = room(3 * own.rows + own.nv + 1)
        self.without = numbers(self.block)
        self.allowed = self.without + own.rows
        self.holding = self.allowed + own.rows
        self.pushed = self.holding + own.rows
        return 0

    cdef void accelerate(self) noexcept:
        cdef Py_ssize_t i, d, nv = self.own.nv
        cdef double total
        cdef const double* response
        for i in range(self.own.rows):
            response, total = self.own.response + i * nv, self.own.gamma[i]
            for d in range(nv):
                total += response[d] * self.pushed[d]
            self.without[i] = total

    @property
    def free(self):
        """Gap'' without contact forces, m/s^2, (k,)."""
        return np.frombuffer(self.block)[: self.own.rows]

    @property
    def force(self):
        """Generalised forces without the contact forces, less the bias, (nv,)."""
        at = 3 * self.own.rows
        return np.frombuffer(self.block)[at : at + self.own.nv]

    def __reduce__(self):
        """How a saved state of a simulation holds it."""
        return type(self), (self.M, self.rows, self.force)

    @property
    def rounding(self):
        """Rounding of each gap'', m/s^2, (k,): a share of its largest term."""
        cdef Py_ssize_t i
        cdef const double* rounding = self.roundings()
        return [rounding[i] for i in range(self.own.rows)]

    cdef double* roundings(self) except NULL:
        cdef RowMemory own = self.own
        cdef const double* response
        cdef Py_ssize_t i, d
        cdef double most
        if not self.is_rounded:
            write_scales(self.rows.groups, self.allowed)
            for i in range(own.rows):
                response, most = own.response + i * own.nv, max(self.allowed[i], fabs(own.gamma[i]))
                for d in range(own.nv):
                    most = max(most, fabs(response[d] * self.pushed[d]))
                self.allowed[i] = _ACCELERATION_M_S2 + _ACCELERATION * most
            self.is_rounded = True
        return self.allowed

    def pushing(self, const double[::1] forces not None):
        """Contacts whose force accelerates their gap by more than rounding."""
        cdef Py_ssize_t i, k = self.own.rows
        cdef const double* G = self.own.delassus()
        cdef const double* rounding = self.roundings()
        return [i for i in range(k) if forces[i] * G[i * (k + 1)] > rounding[i]]

    def own_acceleration(self, const double[:] forces not None):
        """Contribution of each force to gap'' at its own contact, m/s^2, (k,)."""
        cdef Py_ssize_t i, k = self.own.rows
        cdef const double* G = self.own.delassus()
        rates = np.empty(k)
        cdef double[::1] found = rates
        for i in range(k):
            found[i] = forces[i] * G[i * (k + 1)]
        return rates

    def gap_accelerations(self, const double[:] forces not None):
        """Gap'' under given forces, m/s^2, (k,)."""
        cdef Py_ssize_t i, j, k = self.own.rows
        cdef const double* G = self.own.delassus()
        rates = np.empty(k)
        cdef double[::1] found = rates
        for i in range(k):
            found[i] = self.without[i]
            for j in range(k):
                found[i] += G[i * k + j] * forces[j]
        return rates

    def bilateral_forces(self, which):
        """Forces that keep gap'' = 0 at some contacts, of either sign, N, (k,); zero at the others."""
        cdef double[::1] found
        cdef Py_ssize_t i, k = self.own.rows
        key = tuple(which)
        forces = self.held.get(key)
        if forces is None and len(key) == k:
            self.all_held()
            forces = self.held[key] = np.frombuffer(self.block)[2 * k : 3 * k]
        elif forces is None:
            forces = self.held[key] = np.zeros(k)
            found = forces
            if len(key) == 1:
                i = key[0]
                found[i] = -self.without[i] / self.own.delassus()[i * (k + 1)]
            elif key:
                self.problem(key).write_forces(self.without, &found[0])
        return forces

    cdef double* all_held(self) except NULL:
        """Forces that keep gap'' = 0 at all contacts, N, (k,)."""
        cdef Py_ssize_t k = self.own.rows
        if not self.has_forces:
            memset(self.holding, 0, k * sizeof(double))
            if k == 1:
                self.holding[0] = -self.without[0] / self.own.delassus()[0]
            elif k:
                self.problem(tuple(range(k))).write_forces(self.without, self.holding)
            self.has_forces = True
        return self.holding

    cdef HeldForces problem(self, key):
        """The linear problem of active contacts: the same under several efforts."""
        problem = self.rows.held.get(key)
        if problem is None:
            active = Active(self.own.rows, np.array(key, dtype=np.intp))
            problem = self.rows.held[key] = of_rows(self.own, active)
        return problem

    def validity(self, which):
        """Margin by which some active contacts push and gap'' = 0 everywhere, m/s^2."""
        cdef Py_ssize_t i, j, k = self.own.rows
        cdef const double* G = self.own.delassus()
        cdef const double[::1] forces = self.bilateral_forces(which)
        cdef double opens, allowed, least = INFINITY
        cdef const double* rounding = self.roundings()
        for i in range(k):
            opens, allowed = self.without[i], CLEARLY * rounding[i]
            for j in range(k):
                opens += G[i * k + j] * forces[j]
            least = min(least, min(forces[i] * G[i * (k + 1)] + allowed, allowed - fabs(opens)))
        return least

    def stage(self, const double[::1] qvel not None):
        """A stage in which all contacts are active, and the generalised forces, (nv,)."""
        generalised = np.empty(self.own.nv)
        cdef double[::1] sums = generalised
        return self.held_stage(&qvel[0], &sums[0]), generalised

    cdef StageInMemory held_stage(self, const double* qvel, double* generalised):
        cdef RowMemory own = self.own
        cdef StageInMemory stage = empty_stage(self.rows, own.rows, own.nv, len(own.counts), False)
        memcpy(stage.along, self.all_held(), own.rows * sizeof(double))
        generalise(stage.along, own, generalised)
        finish_stage(stage, own, qvel, generalised)
        return stage

    cdef bint holds_all(self) except -1:
        """Whether all contacts push, each by more than rounding: their forces are then those that hold them."""
        cdef Py_ssize_t i, j, k = self.own.rows
        cdef const double* G = self.own.delassus()
        cdef const double* rounding = self.roundings()
        cdef const double* forces
        cdef double opens, allowed
        if k == 1 and not G[0] > IMMOVABLE:
            return False
        forces = self.all_held()
        if k == 1:
            return forces[0] * G[0] > rounding[0]
        for i in range(k):
            opens, allowed = self.without[i], CLEARLY * rounding[i]
            for j in range(k):
                opens += G[i * k + j] * forces[j]
            if not (forces[i] * G[i * (k + 1)] > allowed and fabs(opens) <= allowed):
                return False
        return True

    def unilateral_forces(self, expected=()):
        """Solution of the complementarity problem, N, (k,); redundant contacts share the load by least norm.

        Args:
            expected: Contacts that probably carry force, such as the active set of the last step; tried first.
        """
        if self.own.rows > 1 and len(expected) == self.own.rows and self.holds_all():
            return self.bilateral_forces(range(self.own.rows))
        return plain.ContactAcceleration(self.M, self.rows, self.force).unilateral_forces(expected)


cdef ContactAcceleration problem_under(M, rows, RowMemory own, Smooth smooth, const double* pushes):
    """The problem under the smooth forces at the current state and applied forces, (nv,)."""
    cdef ContactAcceleration found = ContactAcceleration.__new__(ContactAcceleration)
    found.set_up(M, rows, own)
    smooth.write_force(pushes, found.pushed)
    found.accelerate()
    return found
