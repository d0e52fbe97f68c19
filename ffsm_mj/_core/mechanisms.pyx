# cython: boundscheck=False, wraparound=False, cdivision=True
"""Closed loops in control ticks that the core takes: steps with their rows held, and loads of equality constraints."""

import numpy as np

from ffsm_mj.tolerances import PROJECTED_GAP_M, PROJECTED_RATE_M_S

from libc.math cimport NAN
from libc.string cimport memset

from ffsm_mj._core.loops cimport LoopStage
from ffsm_mj._core.stages cimport Smooth
from ffsm_mj._core.tick cimport OnSample, SteadyForces

cdef double GAP_M = PROJECTED_GAP_M, RATE_M_S = PROJECTED_RATE_M_S


cdef class SteadyLoops(SteadyForces):
    """Steps with rows that exchange nothing between the subsystems, while the same combinations of them are independent."""

    cdef LoopStage rows

    def __init__(self, LoopStage rows not None):
        """Take the rows, with independent combinations chosen."""
        self.rows = rows

    cpdef bint goes_on(self, double left_s=NAN) except -1:
        """Begin a step, if no other combinations are due and nothing is to be projected out; returns whether it has."""
        cdef double gap, rate
        try:
            # Other combinations of the rows are due: choosing them takes a singular value decomposition, in Python.
            if not self.rows.fits():
                return False
        # Rows that lost rank end the run (singular_mechanism): that is for the loop to report.
        except np.linalg.LinAlgError:
            return False
        self.rows.begin()
        self.rows.find_drift(&gap, &rate)
        # Drift beyond this is projected out, which changes the state, and is entered in the balance.
        return gap <= GAP_M and rate <= RATE_M_S

    cdef bint exchange_into(self, double duration_s, double* sums) except -1:
        memset(sums, 0, 21 * sizeof(double))
        # Rows within one subsystem exchange nothing. A singular configuration passed within the step is for the loop.
        return not self.rows.turns_over()


cdef class LoadSample(OnSample):
    """Writes the loads of equality constraints under all other forces, those of the current efforts among them.

    Attributes:
        values: The loads: force, of a weld torque too, or the force along the one row of a coupling.
    """

    cdef readonly object values
    cdef object others, pushes
    cdef Smooth smooth
    cdef const Py_ssize_t[::1] counts
    cdef double[::1] loads, applied, force

    def __init__(self, const Py_ssize_t[::1] counts not None, others):
        """Take what does not depend on the motion.

        Args:
            counts: How many numbers each constraint has.
            others: All other sources of forces.
        """
        self.counts, self.others, self.values = counts, tuple(others), np.zeros(sum(counts))
        self.loads = self.values

    def bind(self, Smooth smooth not None):
        """Use the smooth forces of another motion, whose first rows are those of the constraints."""
        self.smooth, self.pushes = smooth, np.zeros(smooth.qvel.shape[0])
        self.applied, self.force = self.pushes, np.empty(smooth.qvel.shape[0])

    cdef int sample(self, double time_s) except -1:
        cdef LoopStage rows = self.smooth.motion.loops.evaluated()
        self.applied[:] = 0.0
        for other in self.others:
            if other.active:
                other.add_forces(self.pushes)
        self.smooth.write_force(&self.applied[0], &self.force[0])
        rows.solve(&self.force[0])
        return rows.write_loads(self.counts, &self.loads[0])
