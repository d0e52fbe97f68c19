# cython: boundscheck=False, wraparound=False, cdivision=True
"""Lower bounds on gaps: of geoms by spheres around them, of pieces of two rigid bodies also by heights over their faces."""

import numpy as np

from libc.math cimport INFINITY, sqrt

from ffsm_mj._core.algebra cimport dot


cdef class SphereBounds:
    """Gaps of the spheres around the geoms of many pairs, one of which may be a plane."""

    cdef const Py_ssize_t[::1] a, b
    cdef const double[::1] radii, senses

    def __init__(self, a, b, radii, senses):
        """Take n pairs.

        Args:
            a: Ids of the first geoms, (n,).
            b: Ids of the second ones.
            radii: Sums of the radii of the spheres, m, (n,).
            senses: 1 where the second geom is a plane, -1 where the first one is, else 0, (n,).
        """
        self.a, self.b, self.radii, self.senses = a, b, radii, senses

    def gaps(self, data):
        """Gaps at the state in ``data``, m, (n,)."""
        cdef const double[:, ::1] centres = data.geom_xpos, axes = data.geom_xmat
        cdef double[::1] gaps = np.empty(len(self.a))
        cdef double[3] apart
        cdef const double* z
        cdef Py_ssize_t i
        cdef int k
        for i in range(len(self.a)):
            for k in range(3):
                apart[k] = centres[self.a[i], k] - centres[self.b[i], k]
            if self.senses[i] == 0.0:
                gaps[i] = sqrt(dot(apart, apart)) - self.radii[i]
            else:
                z = &axes[self.b[i] if self.senses[i] > 0.0 else self.a[i], 0]
                gaps[i] = self.senses[i] * (apart[0] * z[2] + apart[1] * z[5] + apart[2] * z[8]) - self.radii[i]
        return gaps.base


cdef class PiecesOfBody:
    """Spheres, segments and faces of the pieces of a rigid body, in its axes."""

    cdef readonly Py_ssize_t count
    cdef int body
    cdef const double[:, ::1] centres
    cdef const double[::1] radii, widths
    cdef const double[:, :, ::1] cores, normals
    cdef const double[:, ::1] offsets

    def __init__(self, int body, centres, radii, cores, widths, normals, offsets):
        """Take n pieces with up to f faces each.

        Args:
            body: Id of the body.
            centres: Centres of the spheres, m, (n, 3).
            radii: Their radii, m, (n,).
            cores: Segments, m, (n, 2, 3).
            widths: Radii around these within which the pieces are, m, (n,).
            normals: Outward normals of the faces, (n, f, 3).
            offsets: Their offsets, m, (n, f); infinite behind the last face.
        """
        self.body, self.count = body, len(centres)
        self.centres, self.radii, self.cores, self.widths = centres, radii, cores, widths
        self.normals, self.offsets = normals, offsets

    cdef double above(self, Py_ssize_t i, const double* start, const double* end) noexcept nogil:
        """Greatest height of a segment, in its axes, over the faces of a piece, m: no point of the piece is nearer.

        -inf over a round one, which has no faces.
        """
        cdef double greatest = -INFINITY
        cdef const double* n
        cdef Py_ssize_t f
        for f in range(self.offsets.shape[1]):
            if self.offsets[i, f] == INFINITY:
                break
            n = &self.normals[i, f, 0]
            greatest = max(greatest, min(dot(n, start), dot(n, end)) - self.offsets[i, f])
        return greatest


cdef struct Axes:
    double[9] turn  # from the axes of one body into those of the other, row by row
    double[3] shift


cdef inline void moved(const Axes* axes, const double* point, double* out) noexcept nogil:
    cdef int i
    for i in range(3):
        out[i] = dot(axes.turn + 3 * i, point) + axes.shift[i]


cdef class PieceBounds:
    """Lower bounds on the gaps of the pieces of two bodies, a and b."""

    cdef PiecesOfBody a, b
    cdef Axes from_b, from_a

    def __init__(self, PiecesOfBody a not None, PiecesOfBody b not None):
        """Take the pieces of both."""
        self.a, self.b = a, b

    def within(self, const unsigned char[:, :] among not None, pairs, data, double reach, Py_ssize_t without):
        """Pairs of pieces that may be within a reach: a lower bound of the gap of each, m, and its place, in ascending order.

        Args:
            among: Which pairs count, (pieces of a, pieces of b).
            pairs: Numbers of the pieces of a and b of those that are looked at, (n, 2); None: all.
            data: MuJoCo's data, kinematics current.
            reach: The reach, m.
            without: Place of a pair that does not count; negative: none.
        """
        cdef const double[:, ::1] matrices = data.xmat, positions = data.xpos
        cdef const double* A = &matrices[self.a.body, 0]
        cdef const double* B = &matrices[self.b.body, 0]
        cdef const Py_ssize_t[:, :] some
        cdef Axes* to_a = &self.from_b
        cdef Axes* to_b = &self.from_a
        cdef Py_ssize_t i, k
        cdef list near = []
        for i in range(3):
            to_a.shift[i] = 0.0
            for k in range(3):
                to_a.turn[3 * i + k] = to_b.turn[3 * k + i] = A[i] * B[k] + A[3 + i] * B[3 + k] + A[6 + i] * B[6 + k]
                to_a.shift[i] += (positions[self.b.body, k] - positions[self.a.body, k]) * A[3 * k + i]
        for i in range(3):
            to_b.shift[i] = -dot(to_b.turn + 3 * i, to_a.shift)
        if pairs is None:
            for i in range(self.a.count):
                for k in range(self.b.count):
                    if among[i, k]:
                        self.look_at(i, k, reach, without, near)
        else:
            some = pairs
            for i in range(some.shape[0]):
                if among[some[i, 0], some[i, 1]]:
                    self.look_at(some[i, 0], some[i, 1], reach, without, near)
        near.sort()
        return near

    cdef int look_at(self, Py_ssize_t i, Py_ssize_t k, double reach, Py_ssize_t without, list near) except -1:
        """Add a pair if it may be within the reach."""
        cdef PiecesOfBody a = self.a, b = self.b
        cdef Py_ssize_t place = i * b.count + k
        cdef double[3] start, end
        cdef double x, y, z, bound
        moved(&self.from_b, &b.centres[k, 0], start)
        x, y, z = a.centres[i, 0] - start[0], a.centres[i, 1] - start[1], a.centres[i, 2] - start[2]
        bound = sqrt(x * x + y * y + z * z) - a.radii[i] - b.radii[k]
        if place == without or bound > reach:
            return 0
        moved(&self.from_a, &a.cores[i, 0, 0], start)
        moved(&self.from_a, &a.cores[i, 1, 0], end)
        bound = max(bound, b.above(k, start, end) - a.widths[i])
        moved(&self.from_b, &b.cores[k, 0, 0], start)
        moved(&self.from_b, &b.cores[k, 1, 0], end)
        bound = max(bound, a.above(i, start, end) - b.widths[k])
        if bound <= reach:
            near.append((bound, place))
        return 0
