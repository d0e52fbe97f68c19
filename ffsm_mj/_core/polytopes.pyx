# cython: boundscheck=False, wraparound=False, cdivision=True
"""Surfaces of polytopes at a point, and towards a segment; all in the axes of the polytope (:mod:`ffsm_mj.polytope`)."""

import numpy as np

from libc.math cimport INFINITY, sqrt

from ffsm_mj._core.algebra cimport dot
from ffsm_mj.tolerances import MERGED_M


cdef double _MERGED = MERGED_M


cdef inline double above(const double[:, :] normals, const double[:] offsets, Py_ssize_t i, const double* point) noexcept:
    """Height of a point over the plane of a face, m."""
    return normals[i, 0] * point[0] + normals[i, 1] * point[1] + normals[i, 2] * point[2] - offsets[i]


def normals_at(polytope, const double[:] point not None, double tolerance):
    """Normals of the planes that pass through a point, (3,), within a tolerance in m, (k, 3).

    Empty if the point is strictly inside; None if it is outside by more than the tolerance.
    """
    cdef const double[:, :] normals = polytope.normals
    cdef const double[:] offsets = polytope.offsets
    cdef double[3] place
    cdef double height
    cdef list there = []
    cdef Py_ssize_t i
    place[0], place[1], place[2] = point[0], point[1], point[2]
    for i in range(normals.shape[0]):
        height = above(normals, offsets, i, place)
        if height > tolerance:
            return None
        if height >= -tolerance:
            there.append(i)
    return polytope.normals[there]


def outward_vectors(polytope, const double[:, :] segment not None):
    """Unit vectors along which a segment may be nearest, (3,) each: of a face that it is over, else from an edge or corner.

    Args:
        polytope: The polytope.
        segment: Its ends, (2, 3), m; a point is both of them.
    """
    cdef const double[:, :] normals = polytope.normals
    cdef const double[:] offsets = polytope.offsets
    cdef double[3] start, end, foot
    cdef double[::1] offset
    cdef double over_start, over_end, height = -INFINITY, beyond = -INFINITY, length
    cdef const double* lowest = &start[0]
    cdef Py_ssize_t i, best = 0
    for i in range(3):
        start[i], end[i] = segment[0, i], segment[1, i]
    for i in range(normals.shape[0]):
        over_start, over_end = above(normals, offsets, i, start), above(normals, offsets, i, end)
        if min(over_start, over_end) > height:
            height, best, lowest = min(over_start, over_end), i, &end[0] if over_end < over_start else &start[0]
    for i in range(3):
        foot[i] = lowest[i] - height * normals[best, i]
    for i in range(normals.shape[0]):
        beyond = max(beyond, above(normals, offsets, i, foot))
    if height <= 0.0 or beyond <= _MERGED:
        return [polytope.normals[best]]
    offset = np.empty(3)
    starts, spans = polytope.segments
    _from_edges(starts, spans, start, end, &offset[0])
    length = sqrt(dot(&offset[0], &offset[0]))
    for i in range(3):
        offset[i] /= length
    if length <= height + _MERGED:  # it crosses the edges of the face, or ends over one of them
        return [polytope.normals[best], offset.base]
    return [offset.base]


cdef inline double clipped(double value) noexcept nogil:
    return min(max(value, 0.0), 1.0)


cdef int _from_edges(
    const double[:, :] starts, const double[:, :] spans, const double* start, const double* end, double* out
) except -1:
    """Shortest vector from the edges to a segment, m, (3,).

    Ericson, Real-Time Collision Detection, sec. 5.1.9. Parallel lines are as near anywhere, a point at 0.
    """
    cdef double[3] along, apart, span, offset
    cdef double a, b, c, e, f, across, s, t, squared, least = INFINITY
    cdef Py_ssize_t i
    cdef int k
    for k in range(3):
        along[k] = end[k] - start[k]
    a = dot(along, along)
    for i in range(starts.shape[0]):
        for k in range(3):
            apart[k], span[k] = start[k] - starts[i, k], spans[i, k]
        b, c, e, f = dot(span, along), dot(apart, along), dot(span, span), dot(span, apart)
        across = a * e - b * b
        s = clipped((b * f - c * e) / (across if across > 0.0 else 1.0))
        t = clipped((b * s + f) / e)
        s = clipped((b * t - c) / (a if a > 0.0 else 1.0))
        for k in range(3):
            offset[k] = apart[k] + s * along[k] - t * span[k]
        squared = dot(offset, offset)
        if squared < least:
            least, out[0], out[1], out[2] = squared, offset[0], offset[1], offset[2]
    return 0
