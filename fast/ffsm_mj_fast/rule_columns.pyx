# cython: boundscheck=False, wraparound=False, cdivision=True
"""Log columns of contact rules in steady states; twin of RuleColumns in ffsm_mj.contact_models.persistent.steady_columns."""

import numpy as np

from ffsm_mj.contact_models.persistent.rule_columns import IMPULSE, NOTHING, PRESSING, STICKING

from libc.math cimport sqrt
from libc.string cimport memcpy, memset

from ffsm_mj_fast.rows cimport sum_up

cdef double _PRESSING = PRESSING, _STICKING = STICKING
cdef const double[::1] _NOTHING = NOTHING
cdef Py_ssize_t COLUMNS = IMPULSE
cdef enum:
    MODE = 0  # columns of a rule
    PAIRS = 1
    POINTS = 2
    SIZE = 3
    FORCE = 4
    CENTRE = 7
    USE = 4  # of those of friction
    OF_FRICTION = 6
    START = 0  # of a pair: first of its points, end; rows of its rule, with friction or -1; first group of points, end
    STOP = 1
    ROW = 2
    FRICTION_ROW = 3
    GROUP = 4
    LAST_GROUP = 5


cdef inline double norm(const double* v) noexcept nogil:
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


cdef class RuleColumns:
    """Columns of the rules of pairs all of whose points carry force, without sliding."""

    def __init__(self, by_pair, shares, tables):
        """Find the points, groups of points and rows of each pair."""
        cdef Py_ssize_t at = 0, i
        groups = {pair: each for pair, each, _ in shares.pairs}
        self.values, rows, self.friction_values, friction_rows, self.work_J = tables
        self.parts = np.empty((len(by_pair), 6), dtype=np.intp)
        for i, (pair, own) in enumerate(by_pair.items()):
            self.parts[i, START], at = at, at + <Py_ssize_t>len(own)
            self.parts[i, STOP], self.parts[i, ROW] = at, rows[pair.rule]
            self.parts[i, FRICTION_ROW] = friction_rows[pair.rule] if pair.mu > 0.0 else -1
            self.parts[i, GROUP], self.parts[i, LAST_GROUP] = min(groups[pair]), max(groups[pair]) + 1

    cdef int write(
        self, list groups, const double* axes, const double* normal_forces, const double* forces, const double* use
    ) except -1:
        """Write all columns but the impulses.

        Args:
            groups: The points at the state.
            axes: Normal and tangents of each point; without friction, they and the next are not read.
            normal_forces: Normal force of each point, N.
            forces: Forces (n, t1, t2) of each point, N.
            use: Share of the friction limit of each point.
        """
        cdef Py_ssize_t i
        cdef double[9] found
        self.clear()
        for i in range(self.parts.shape[0]):
            memset(found, 0, sizeof(found))
            sum_up(groups, self.parts[i, START], self.parts[i, STOP], normal_forces, found)
            if self.parts[i, FRICTION_ROW] >= 0:
                self.add_friction(i, axes, forces, use, found)
            self.add_pair(i, found)
        self.finish()
        return 0

    cdef void clear(self) noexcept:
        """Begin without pairs."""
        cdef Py_ssize_t row
        for row in range(self.values.shape[0]):
            self.values[row, PAIRS] = 0.0
        for row in range(self.friction_values.shape[0]):
            memset(&self.friction_values[row, 0], 0, OF_FRICTION * sizeof(double))

    cdef void finish(self) noexcept:
        """Divide the centres of several pairs by the sum of their weights; rules without a pair have the columns of these."""
        cdef Py_ssize_t row
        cdef double* values
        cdef int j
        for row in range(self.values.shape[0]):
            values = &self.values[row, 0]
            if values[PAIRS] == 0.0:
                memcpy(values, &_NOTHING[0], COLUMNS * sizeof(double))
            elif values[PAIRS] > 1.0:
                for j in range(3):
                    values[CENTRE + j] /= values[SIZE]

    cdef void add_pair(self, Py_ssize_t i, const double* found) noexcept:
        """Add a pair, with its force and centre, to its rule: of several, centres are weighted by the sizes of the forces."""
        cdef double* values = &self.values[self.parts[i, ROW], 0]
        cdef Py_ssize_t points = self.parts[i, STOP] - self.parts[i, START]
        cdef double size = norm(found)
        cdef int j
        if values[PAIRS] == 0.0:
            values[MODE] = _STICKING if self.parts[i, FRICTION_ROW] >= 0 else _PRESSING
            values[PAIRS], values[POINTS], values[SIZE] = 1.0, points, size
            memcpy(values + FORCE, found, 6 * sizeof(double))
            return
        for j in range(3):
            if values[PAIRS] == 1.0:
                values[CENTRE + j] *= values[SIZE]
            values[FORCE + j] += found[j]
            values[CENTRE + j] += size * found[3 + j]
        values[PAIRS], values[POINTS], values[SIZE] = values[PAIRS] + 1.0, values[POINTS] + points, values[SIZE] + size

    cdef void add_friction(
        self, Py_ssize_t i, const double* axes, const double* forces, const double* use, double* found
    ) noexcept:
        """Add a pair to the columns of friction of its rule, and its friction to the force."""
        cdef double* values = &self.friction_values[self.parts[i, FRICTION_ROW], 0]
        cdef double[3] across
        cdef Py_ssize_t p
        cdef int j
        across[0] = across[1] = across[2] = 0.0
        for p in range(self.parts[i, START], self.parts[i, STOP]):
            values[USE] = max(values[USE], use[p])
            for j in range(3):
                across[j] += forces[3 * p + 1] * axes[9 * p + 3 + j] + forces[3 * p + 2] * axes[9 * p + 6 + j]
        values[0] += norm(across)
        for j in range(3):
            values[1 + j] += across[j]
            found[j] += across[j]

    cdef void add_impulses(self, double part, const double* wrenches) noexcept:
        """Add the sizes of the resultants of all pairs in a stage, with its weight, to the impulses of their rules."""
        cdef Py_ssize_t i, g
        cdef double[3] force
        cdef int j
        for i in range(self.parts.shape[0]):
            force[0] = force[1] = force[2] = 0.0
            for g in range(self.parts[i, GROUP], self.parts[i, LAST_GROUP]):
                for j in range(3):
                    force[j] += wrenches[6 * g + j]
            self.values[self.parts[i, ROW], COLUMNS] += part * norm(force)
