# cython: boundscheck=False, wraparound=False, cdivision=True
"""Lower bounds on gaps: of geoms by spheres around them, of pieces of two rigid bodies also by heights over their faces.

Those heights and their rates at both ends of a step also tell of most pairs that they do not touch in between.
"""

import numpy as np

from libc.math cimport INFINITY, sqrt

from ffsm_mj._core.algebra cimport cross, dot, velocity_at


cdef double _MARGIN = 0.1  # of the speed: rates within a step may go beyond those at its ends by this share


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


cdef class Instant:
    """Poses and twists of all bodies at one state.

    Attributes:
        time: Its time, s.
    """

    cdef readonly double time
    cdef const double[:, ::1] positions, matrices, twists, centres
    cdef const int[::1] roots

    def __init__(self, model, data):
        """Copy those in ``data``, which must be current."""
        self.time, self.roots = data.time, model.body_rootid
        self.positions, self.matrices, self.twists, self.centres = (
            np.array(data.xpos), np.array(data.xmat), np.array(data.cvel), np.array(data.subtree_com)
        )

    cdef void velocity(self, int body, const double* point, double* out) noexcept nogil:
        """Velocity of a point of a body, world axes, m/s."""
        velocity_at(&self.twists[body, 0], &self.centres[self.roots[body], 0], point, out)

    cdef double turning(self, int body) noexcept nogil:
        """Angular speed of a body, rad/s."""
        return sqrt(dot(&self.twists[body, 0], &self.twists[body, 0]))


cdef struct Ends:
    double[2][3] places, rates  # of both ends of a segment in the axes of another body, and as seen from there
    double speed  # greatest one, and what turning adds to it elsewhere, m/s


cdef Ends ends_over(PiecesOfBody a, Py_ssize_t i, PiecesOfBody b, Py_ssize_t k, Instant at) noexcept:
    """The segment of a piece of a, seen from a piece of b."""
    cdef Ends ends
    cdef const double* matrix = &at.matrices[a.body, 0]
    cdef const double* axes = &at.matrices[b.body, 0]
    cdef double[2][3] points
    cdef double[3] rate, other, half, turned
    cdef int e, j
    ends.speed = 0.0
    for e in range(2):
        for j in range(3):
            points[e][j] = dot(matrix + 3 * j, &a.cores[i, e, 0]) + at.positions[a.body, j]
        at.velocity(a.body, points[e], rate)
        at.velocity(b.body, points[e], other)
        for j in range(3):
            rate[j] -= other[j]
            other[j] = points[e][j] - at.positions[b.body, j]
        for j in range(3):
            ends.places[e][j] = axes[j] * other[0] + axes[3 + j] * other[1] + axes[6 + j] * other[2]
            ends.rates[e][j] = axes[j] * rate[0] + axes[3 + j] * rate[1] + axes[6 + j] * rate[2]
        ends.speed = max(ends.speed, sqrt(dot(rate, rate)))
    for j in range(3):
        half[j] = 0.5 * (points[1][j] - points[0][j])
    cross(&at.twists[a.body, 0], half, turned)
    ends.speed += sqrt(dot(turned, turned)) + at.turning(b.body) * b.radii[k]
    return ends


cdef bint is_parted(
    PiecesOfBody a, Py_ssize_t i, PiecesOfBody b, Py_ssize_t k, Instant before, Instant after, double least
) noexcept:
    """Whether the segment of a piece of a stays over a face of a piece of b, by its radius and a distance."""
    cdef Ends first = ends_over(a, i, b, k, before), last = ends_over(a, i, b, k, after)
    cdef double duration = after.time - before.time
    cdef double angle = duration * max(
        before.turning(a.body) + before.turning(b.body), after.turning(a.body) + after.turning(b.body)
    )
    # Between two times an angle apart, a component of what turns goes beyond its values there by angle^2 / 8 of its size.
    cdef double slack = (_MARGIN + 0.125 * angle * angle) * max(first.speed, last.speed)
    cdef double level, start, end, rate, other, falls, rises
    cdef const double* n
    cdef Py_ssize_t f
    cdef int e
    for f in range(b.offsets.shape[1]):
        if b.offsets[k, f] == INFINITY:
            break
        n, level = &b.normals[k, f, 0], b.offsets[k, f] + a.widths[i] + least
        for e in range(2):
            start, end = dot(n, first.places[e]) - level, dot(n, last.places[e]) - level
            rate, other = dot(n, first.rates[e]), dot(n, last.rates[e])
            # The height is above a line that falls from the start, and above one that rises to the end.
            falls, rises = slack - min(rate, other), slack + max(rate, other)
            if not (start > 0.0 and end > 0.0) or (
                falls > 0.0 and rises > 0.0 and start * rises + end * falls <= duration * falls * rises
            ):
                break
        else:
            return True
    return False


def stay_apart(
    PiecesOfBody a not None, Py_ssize_t i, PiecesOfBody b not None, Py_ssize_t k,
    Instant before not None, Instant after not None, double least
):
    """Whether a face of one of two pieces certainly parts them from the start of a step to its end, by a distance in m.

    Args:
        a: Pieces of one body.
        i: Number of one of them.
        b: Pieces of the other body.
        k: Number of one of them.
        before: State at the start.
        after: State at the end.
        least: The distance.
    """
    return is_parted(a, i, b, k, before, after, least) or is_parted(b, k, a, i, before, after, least)
