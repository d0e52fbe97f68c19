# cython: boundscheck=False, wraparound=False, cdivision=True
"""Contact forces without friction; twin of ffsm_mj.contact_models.persistent.acceleration.

The original solves the complementarity problem where the active set is not the expected one.
"""

from typing import NamedTuple

import numpy as np

from ffsm_mj.contact_models.persistent import acceleration as plain
from ffsm_mj.tolerances import ACCELERATION, ACCELERATION_M_S2

from libc.math cimport INFINITY, fabs
from libc.string cimport memcpy

from ffsm_mj_fast.held_rows cimport HeldForces, of_rows
from ffsm_mj_fast.row_memory cimport RowMemory
from ffsm_mj_fast.rows cimport write_scales
from ffsm_mj_fast.stage_in_memory cimport StageInMemory, empty_stage, finish_stage

cdef double _ACCELERATION = ACCELERATION, _ACCELERATION_M_S2 = ACCELERATION_M_S2
cdef double CLEARLY = plain.CLEARLY, IMMOVABLE = plain.IMMOVABLE


class Active(NamedTuple):
    """Active contacts, as a structure of held rows."""

    count: int
    rows: object
    slides: tuple = ()


cdef class ContactAcceleration:
    """The contact problem at one state."""

    cdef readonly object rows, free
    cdef object M, force, block
    cdef dict held
    cdef RowMemory own
    cdef const double[::1] pushed
    cdef double* without
    cdef double* allowed
    cdef bint is_rounded

    def __init__(self, M, rows, const double[::1] force not None):
        cdef RowMemory own = rows.memory
        cdef Py_ssize_t i, d
        cdef double total
        cdef const double* response
        cdef double[::1] memory
        self.M, self.rows, self.force, self.own, self.held, self.pushed = M, rows, force.base, own, {}, force
        self.block = np.empty(2 * own.rows + 1)
        memory, self.free = self.block, self.block[: own.rows]
        self.without, self.allowed = &memory[0], &memory[0] + own.rows
        for i in range(own.rows):
            response, total = own.response + i * own.nv, own.gamma[i]
            for d in range(own.nv):
                total += response[d] * force[d]
            self.without[i] = total

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
        cdef Py_ssize_t i
        key = tuple(which)
        forces = self.held.get(key)
        if forces is None:
            forces = self.held[key] = np.zeros(self.own.rows)
            found = forces
            if len(key) == 1:
                i = key[0]
                found[i] = -self.without[i] / self.own.delassus()[i * (self.own.rows + 1)]
            elif key:
                self.problem(key).write_forces(self.without, &found[0])
        return forces

    cdef HeldForces problem(self, key):
        """The linear problem of active contacts: the same under several efforts."""
        problem = self.rows.held.get(key)
        if problem is None:
            active = Active(self.own.rows, np.array(key, dtype=np.intp))
            problem = self.rows.held[key] = of_rows(None, self.own, active)
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
        cdef RowMemory own = self.own
        cdef StageInMemory stage = empty_stage(self.rows, own.rows, own.nv, len(own.counts), False)
        cdef const double[::1] forces = self.bilateral_forces(range(own.rows))
        generalised = np.empty(own.nv)
        cdef double[::1] sums = generalised
        if own.rows:
            memcpy(stage.along, &forces[0], own.rows * sizeof(double))
        finish_stage(stage, own, &qvel[0], &sums[0])
        return stage, generalised

    def unilateral_forces(self, expected=()):
        """Solution of the complementarity problem, N, (k,); redundant contacts share the load by least norm.

        Args:
            expected: Contacts that probably carry force, such as the active set of the last step; tried first.
        """
        cdef Py_ssize_t i, j, k = self.own.rows
        cdef const double* G = self.own.delassus()
        cdef const double[::1] forces
        cdef const double* rounding
        cdef double opens, allowed
        key = tuple(expected)
        if k > 1 and len(key) == k:
            found, rounding = self.bilateral_forces(key), self.roundings()
            forces = found
            for i in range(k):
                opens, allowed = self.without[i], CLEARLY * rounding[i]
                for j in range(k):
                    opens += G[i * k + j] * forces[j]
                if not (forces[i] * G[i * (k + 1)] > allowed and fabs(opens) <= allowed):
                    break
            else:
                return found
        return plain.ContactAcceleration(self.M, self.rows, self.force).unilateral_forces(expected)
