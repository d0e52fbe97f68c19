# cython: boundscheck=False, wraparound=False, cdivision=True
"""Velocities of one body relative to another at points in space, and the gap rates that they are along a normal."""

import numpy as np

from libc.math cimport fabs

from ffsm_mj._core.algebra cimport dot, velocity_at
from ffsm_mj.tolerances import RATE


cdef double _RATE = RATE


cdef class RelativeVelocity:
    """Velocity of a body b relative to a body a.

    Attributes:
        roots: Ids of the roots of the trees that a and b are in.
    """

    cdef readonly (int, int) roots
    cdef int a, b

    def __init__(self, model, int a, int b):
        """Take the ids of both bodies."""
        self.a, self.b, self.roots = a, b, (model.body_rootid[a], model.body_rootid[b])

    cdef void at_point(
        self, const double[:, ::1] twists, const double[:, ::1] centres, const double* point, double* out, double* greatest
    ) noexcept:
        """The velocity at a point, m/s, (3,); raise the greatest components of those of a and b, (2,)."""
        cdef double[3] of_a, of_b
        cdef int k
        velocity_at(&twists[self.a, 0], &centres[self.roots[0], 0], point, of_a)
        velocity_at(&twists[self.b, 0], &centres[self.roots[1], 0], point, of_b)
        for k in range(3):
            out[k] = of_b[k] - of_a[k]
            greatest[0], greatest[1] = max(greatest[0], fabs(of_a[k])), max(greatest[1], fabs(of_b[k]))

    def at(self, data, const double[:] point not None):
        """The velocity at a point, m/s, (3,); velocities in ``data`` must be current."""
        cdef double[::1] out = np.empty(3)
        cdef double[3] place
        cdef double[2] greatest = [0.0, 0.0]
        place[0], place[1], place[2] = point[0], point[1], point[2]
        self.at_point(data.cvel, data.subtree_com, place, &out[0], greatest)
        return out.base

    def along(self, data, const double[:] normal not None, const double[:, :] points not None):
        """Gap rate at each point in m/s, (k,), and its rounding; velocities in ``data`` must be current."""
        cdef const double[:, ::1] twists = data.cvel, centres = data.subtree_com
        cdef double[::1] rates = np.empty(points.shape[0])
        cdef double[3] direction, place, velocity
        cdef double[2] greatest = [0.0, 0.0]
        cdef Py_ssize_t i
        direction[0], direction[1], direction[2] = normal[0], normal[1], normal[2]
        for i in range(points.shape[0]):
            place[0], place[1], place[2] = points[i, 0], points[i, 1], points[i, 2]
            self.at_point(twists, centres, place, velocity, greatest)
            rates[i] = dot(velocity, direction)
        return rates.base, _RATE * (1.0 + greatest[0] + greatest[1])
