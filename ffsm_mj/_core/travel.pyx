# cython: boundscheck=False, wraparound=False, cdivision=True
"""How far the coordinates of a system have travelled since the gaps of its pairs were evaluated, step by step.

The kinetic energy bounds the motion of a light link of a heavy system poorly: it could be fast with all that energy. The
rates themselves do better, at the cost of a sum in each step.
"""

import numpy as np

from libc.math cimport fabs, INFINITY

from ffsm_mj._core.steppers import BOUND_MARGIN


cdef double _BOUND_MARGIN = BOUND_MARGIN


cdef class Travel:
    """Bounds on the motion of every coordinate, |rate| dt in each step, and on their weighted largest one.

    Attributes:
        travelled: Since :meth:`begin`, (nv,).
        last: In the last step, (nv,).
        length: Sum over the steps of the largest weighted motion of any coordinate.
    """

    def __init__(self, double[::1] rates not None):
        """Bind to the rates of the coordinates, (nv,)."""
        self.rates = rates
        self.travelled, self.last = np.zeros(len(rates)), np.zeros(len(rates))
        self.sums, self.steps = self.travelled, self.last
        self.before, self.weights = np.zeros(len(rates)), np.zeros(len(rates))

    def begin(self, const double[::1] weights not None, double reach):
        """Begin at the present rates: weights of the motions, (nv,), and the length within which no pair can be near."""
        cdef Py_ssize_t i
        self.weights, self.reach, self.length = weights, reach, 0.0
        for i in range(self.rates.shape[0]):
            self.sums[i], self.steps[i], self.before[i] = 0.0, 0.0, fabs(self.rates[i])

    def end(self):
        """End the reach here: pairs may be near that were not when it began."""
        self.reach = 0.0

    cpdef bint add(self, double duration_s) except -1:
        """Add a finished step; returns whether no pair can be near yet."""
        cdef Py_ssize_t i
        cdef double rate, moved, longest = 0.0, total = 0.0
        for i in range(self.rates.shape[0]):
            rate = fabs(self.rates[i])
            # The larger rate of both ends, with a margin: the rate inside a step is not known.
            moved = _BOUND_MARGIN * duration_s * (self.before[i] if rate <= self.before[i] else rate)
            self.before[i], self.steps[i] = rate, moved
            # By coordinate too: the one number is a bound for all pairs, these serve to see which pair it may concern.
            self.sums[i] += moved
            longest, total = max(longest, moved * self.weights[i]), total + moved
        self.length += longest + 0.0 * total  # of a rate that is no number, none is within reach
        return self.length < self.reach

    @property
    def is_within(self):
        """Whether no pair can be near."""
        return self.length < self.reach


cdef class Closings:
    """How far pairs can close at most, by the motion of the coordinates and by the kinetic energy: the smaller bound holds."""

    cdef const double[:, ::1] rows
    cdef const double[::1] per_root_energy, weights, per_length

    def __init__(self, rows, slides, per_root_energy):
        """Take the bounds of n pairs.

        Args:
            rows: Largest closing of each pair per m or rad of motion of each coordinate, (n, nv).
            slides: Coordinates whose displacement has a limit, (k,).
            per_root_energy: Largest closing of each pair per motion bound, (n,).
        """
        every = np.concatenate((rows, np.eye(rows.shape[1])[slides]))
        # One number accumulates the largest weighted motion of all coordinates, instead of a sum for each pair.
        self.weights = weights = every.max(axis=0, initial=0.0)
        self.per_length = (every / np.where(weights > 0.0, weights, 1.0)).sum(axis=1)
        self.rows, self.per_root_energy = np.ascontiguousarray(rows), per_root_energy

    def most(self, const double[::1] moved not None, double motion_bound):
        """Largest closings, m, (n,), of a motion of the coordinates, (nv,), with its motion bound."""
        cdef double[::1] closings = np.empty(self.rows.shape[0])
        cdef double by_rates, by_energy
        cdef Py_ssize_t i, k
        for i in range(self.rows.shape[0]):
            by_rates, by_energy = 0.0, self.per_root_energy[i] * motion_bound if motion_bound > 0.0 else 0.0
            for k in range(self.rows.shape[1]):
                by_rates += self.rows[i, k] * moved[k]
            closings[i] = by_energy if by_rates >= by_energy else by_rates  # one that is no number stays so
        return closings.base

    def begin(self, Travel travel not None, const double[::1] clearances not None, const double[::1] allowances not None):
        """Begin a motion with clearances of the pairs, (n,), and of the displacements, (k,), m; the motion bound of none near."""
        cdef double reach = INFINITY, by_energy = INFINITY
        cdef Py_ssize_t i, n = self.rows.shape[0]
        # Infinite clearances over infinite bounds are no numbers: the first of two is kept then.
        for i in range(n):
            reach = min(reach, clearances[i] / self.per_length[i])
            by_energy = min(by_energy, clearances[i] / self.per_root_energy[i])
        for i in range(allowances.shape[0]):
            reach = min(reach, allowances[i] / self.per_length[n + i])
        travel.begin(self.weights, reach)
        return by_energy
