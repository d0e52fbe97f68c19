# cython: boundscheck=False, wraparound=False, cdivision=True
"""Convex polygons across a normal: hulls of points, and where two features touch each other.

The features of two geoms along a normal are given by their extreme points, in world axes: a point, a segment or a polygon.
"""

import numpy as np

from libc.math cimport copysign, fabs, hypot, INFINITY, rint, sqrt
from libc.stdlib cimport qsort

from ffsm_mj._core.algebra cimport cross, dot
from ffsm_mj._core.memory cimport numbers, room
from ffsm_mj.tolerances import CONTACT_GAP_M, MERGED_M, PARALLEL, STRAIGHT


cdef double _GAP = CONTACT_GAP_M
cdef double _MERGED = MERGED_M
cdef double _PARALLEL = PARALLEL
cdef double _STRAIGHT = STRAIGHT
# Ratio of the moments of places across and along their longest direction, above which their plane is known to 1e-10 of
# their rises by Cramer's rule: they are level to PARALLEL.
cdef double _WIDE = 1e-6
cdef double _PLACES = 1e12  # places of contact points are no rounding to so many parts of a metre


cdef struct Place:
    double x, y
    Py_ssize_t index  # among the points that it is of


cdef struct Polygon:
    Place* corners  # in order; of a segment both ends
    Py_ssize_t count


cdef inline Place* places(bytearray block) noexcept:
    return <Place*>numbers(block)


cdef inline bytearray room_for(Py_ssize_t count):
    """Memory for a hull of so many points: for themselves and for the chain around them."""
    return room(3 * (3 * count + 1))


cdef int _ordered(const void* a, const void* b) noexcept nogil:
    """Order of two places: by x, then by y, then as they came."""
    cdef const Place* p = <const Place*>a
    cdef const Place* q = <const Place*>b
    if p.x != q.x:
        return -1 if p.x < q.x else 1
    if p.y != q.y:
        return -1 if p.y < q.y else 1
    return -1 if p.index < q.index else 1


cdef inline double turn(const Place* o, const Place* a, const Place* b) noexcept nogil:
    """Twice the area of the triangle o, a, b: positive where the way from o by a to b turns left."""
    return (a.x - o.x) * (b.y - o.y) - (a.y - o.y) * (b.x - o.x)


cdef Py_ssize_t _distinct(Place* points, Py_ssize_t count, double merge) noexcept nogil:
    """Keep the first of each cluster of places, which are sorted in place; their number."""
    cdef Py_ssize_t i, k, kept = 0
    qsort(points, count, sizeof(Place), _ordered)
    for i in range(count):
        k = kept - 1
        # Of those before, x decreases backwards: none is near enough behind the first that is too far along x.
        while k >= 0 and points[i].x - points[k].x <= merge < fabs(points[i].x - points[k].x) + fabs(points[i].y - points[k].y):
            k -= 1
        if k < 0 or points[i].x - points[k].x > merge:
            points[kept] = points[i]
            kept += 1
    return kept


cdef Polygon hull_of(Place* points, Py_ssize_t count, double merge, double straight) noexcept nogil:
    """Convex hull of places in memory of :func:`room_for`, by Andrew's monotone chain; see :func:`hull_indices`."""
    cdef Polygon polygon
    cdef Place* chain = points + count
    cdef const Place* p
    cdef Py_ssize_t i, half, start, length = 0
    cdef double low = INFINITY, high = -INFINITY, span, least
    polygon.corners, polygon.count = points, count
    if count > 1:
        polygon.count = count = _distinct(points, count, merge)
    if count < 3:
        return polygon
    for i in range(count):
        low, high = min(low, points[i].y), max(high, points[i].y)
    span = max(points[count - 1].x - points[0].x, high - low)
    least = straight * span * span
    for half in range(2):
        start = length
        for i in range(count):
            p = points + (count - 1 - i if half else i)
            while length - start >= 2 and turn(chain + length - 2, chain + length - 1, p) <= least:
                length -= 1
            chain[length] = p[0]
            length += 1
        length -= 1
    polygon.corners, polygon.count = chain, length
    return polygon


def hull_indices(const double[:, :] points not None, *, double merge=0.0, double straight=0.0):
    """Indices of the corners of the convex hull, counter-clockwise; one or two where the points are a point or a segment.

    Args:
        points: (n, 2), n > 0.
        merge: Points no farther apart than this (sum of both distances along the axes) are one.
        straight: A corner that turns by no more than this area over the square of the points' extent is none.
    """
    cdef Py_ssize_t i, count = points.shape[0]
    cdef bytearray block = room_for(count)
    cdef Place* flat = places(block)
    cdef Polygon polygon
    for i in range(count):
        flat[i].x, flat[i].y, flat[i].index = points[i, 0], points[i, 1], i
    polygon = hull_of(flat, count, merge, straight)
    return [polygon.corners[i].index for i in range(polygon.count)]


def hull(points, *, double merge=0.0, double straight=0.0):
    """The same corners as points, (k, 2)."""
    return points[hull_indices(points, merge=merge, straight=straight)]


cdef void axes_across(const double[:] normal, double* plane) noexcept:
    """The normal, and two axes across it, (3, 3)."""
    cdef double[3] axis
    cdef double length
    cdef int i, least = 0
    for i in range(3):
        plane[i], axis[i] = normal[i], 0.0
        if fabs(normal[i]) < fabs(normal[least]):
            least = i
    axis[least] = 1.0
    cross(plane, axis, plane + 3)
    length = sqrt(dot(plane + 3, plane + 3))
    for i in range(3):
        plane[3 + i] /= length
    cross(plane, plane + 3, plane + 6)


cdef void flatten(const double[:, :] points, const double* plane, Place* flat) noexcept:
    """Places of points in the plane of two axes."""
    cdef Py_ssize_t i
    cdef double[3] point
    for i in range(points.shape[0]):
        point[0], point[1], point[2] = points[i, 0], points[i, 1], points[i, 2]
        flat[i].x, flat[i].y, flat[i].index = dot(point, plane + 3), dot(point, plane + 6), i


cdef double extent(const Place* points, Py_ssize_t count) noexcept nogil:
    """Greatest extent of some places along one of the axes."""
    cdef double[4] bounds
    cdef Py_ssize_t i
    bounds[0] = bounds[2] = INFINITY
    bounds[1] = bounds[3] = -INFINITY
    for i in range(count):
        bounds[0], bounds[1] = min(bounds[0], points[i].x), max(bounds[1], points[i].x)
        bounds[2], bounds[3] = min(bounds[2], points[i].y), max(bounds[3], points[i].y)
    return max(bounds[1] - bounds[0], bounds[3] - bounds[2])


def corners_across(const double[:, :] points not None, const double[:] normal not None):
    """Indices of the points, (k, 3), that are corners of their hull in the plane across a normal, in order around it."""
    cdef Py_ssize_t i, count = points.shape[0]
    cdef bytearray block = room_for(count)
    cdef Place* flat = places(block)
    cdef double[9] plane
    cdef Polygon polygon
    axes_across(normal, plane)
    flatten(points, plane, flat)
    # Rounded: of three points on a line along the second axis the middle one would else come first by rounding, and the
    # chain of the hull keeps its first.
    for i in range(count):
        flat[i].x, flat[i].y = rint(flat[i].x * _PLACES) / _PLACES, rint(flat[i].y * _PLACES) / _PLACES
    polygon = hull_of(flat, count, _GAP + 1e-7 * extent(flat, count), _STRAIGHT)
    return [polygon.corners[i].index for i in range(polygon.count)]


cpdef bint lie_along(double sine, double length, double flush):
    """Whether two lines are parallel, or so nearly that round sides around them touch along the length that they share.

    Args:
        sine: Sine of the angle between them.
        length: Length of the shorter one, m.
        flush: Their :func:`~ffsm_mj.contact.patch.flush_offset`, m.
    """
    return sine <= max(_PARALLEL, flush / length)


cdef bint _spans_lie_along(const double* one, const double* other, double flush):
    """The same of two lines by the vectors, (3,), between their ends."""
    cdef double length = sqrt(dot(one, one)), other_length = sqrt(dot(other, other))
    cdef double sense = copysign(1.0, dot(one, other))
    cdef double[3] apart
    cdef int i
    for i in range(3):
        apart[i] = other[i] / other_length - one[i] / length * sense
    return lie_along(sqrt(dot(apart, apart)), min(length, other_length), flush)


def segments_lie_along(const double[:, :] first not None, const double[:, :] second not None, double flush):
    """The same of two features: whether both are segments, (2, 3), at least one of which is a round side."""
    cdef double[3] one, other
    cdef int i
    if not first.shape[0] == second.shape[0] == 2 or flush <= 0.0:
        return False
    for i in range(3):
        one[i], other[i] = first[1, i] - first[0, i], second[1, i] - second[0, i]
    return _spans_lie_along(one, other, flush)


cdef inline Py_ssize_t sides(const Polygon* polygon) noexcept nogil:
    """Number of its sides: one of a segment, none of a point."""
    return polygon.count if polygon.count > 2 else polygon.count - 1


cdef inline const Place* after(const Polygon* polygon, Py_ssize_t i) noexcept nogil:
    """End of the side that starts at a corner."""
    return polygon.corners + (i + 1 if i + 1 < polygon.count else 0)


cdef bint inside(const Place* p, const Polygon* polygon, double reach) noexcept nogil:
    """Whether a place lies in a convex polygon, on a segment or at a point, within a distance."""
    cdef const Place* a = polygon.corners
    cdef const Place* b
    cdef double u, v, t
    cdef Py_ssize_t i
    if polygon.count == 1:
        return hypot(p.x - a.x, p.y - a.y) <= reach
    if polygon.count == 2:
        u, v = a[1].x - a.x, a[1].y - a.y
        t = min(max(((p.x - a.x) * u + (p.y - a.y) * v) / (u * u + v * v), 0.0), 1.0)
        return hypot(p.x - a.x - t * u, p.y - a.y - t * v) <= reach
    for i in range(polygon.count):
        a, b = polygon.corners + i, after(polygon, i)
        if turn(a, b, p) < -reach * hypot(b.x - a.x, b.y - a.y):
            return False
    return True


cdef Py_ssize_t crossings(const Polygon* a, const Polygon* b, Place* out) noexcept nogil:
    """Number of places at which a side of one polygon crosses a side of the other, and these."""
    cdef const Place* p
    cdef const Place* r
    cdef double dx, dy, ex, ey, x, y, across, t, v
    cdef Py_ssize_t i, k, count = 0
    for i in range(sides(a)):
        p = a.corners + i
        dx, dy = after(a, i).x - p.x, after(a, i).y - p.y
        for k in range(sides(b)):
            r = b.corners + k
            ex, ey = after(b, k).x - r.x, after(b, k).y - r.y
            across = dx * ey - dy * ex
            if fabs(across) <= _PARALLEL * hypot(dx, dy) * hypot(ex, ey):
                continue
            x, y = r.x - p.x, r.y - p.y
            t, v = (x * ey - y * ex) / across, (x * dy - y * dx) / across
            if 0.0 <= t <= 1.0 and 0.0 <= v <= 1.0:
                out[count].x, out[count].y, out[count].index = p.x + t * dx, p.y + t * dy, count
                count += 1
    return count


cdef class _Across:
    """Two features in the plane across a normal."""

    cdef double[9] plane
    cdef Polygon a, b
    cdef bytearray of_first, of_second, between  # memory of their hulls, and for that of what they have in common

    def __cinit__(self, const double[:, :] first, const double[:, :] second, const double[:] normal):
        axes_across(normal, self.plane)
        self.of_first, self.of_second = room_for(first.shape[0]), room_for(second.shape[0])
        flatten(first, self.plane, places(self.of_first))
        flatten(second, self.plane, places(self.of_second))
        self.a = hull_of(places(self.of_first), first.shape[0], _MERGED, _STRAIGHT)
        self.b = hull_of(places(self.of_second), second.shape[0], _MERGED, _STRAIGHT)
        self.between = room_for(self.a.count + self.b.count + self.a.count * self.b.count)

    cdef bint lie_along(self, double flush):
        """Whether both are segments that lie along each other; see :func:`segments_lie_along`."""
        cdef double[6] spans
        cdef const Place* a = self.a.corners
        cdef const Place* b = self.b.corners
        if not self.a.count == self.b.count == 2 or flush <= 0.0:
            return False
        spans[0], spans[1], spans[2] = a[1].x - a.x, a[1].y - a.y, 0.0
        spans[3], spans[4], spans[5] = b[1].x - b.x, b[1].y - b.y, 0.0
        return _spans_lie_along(spans, spans + 3, flush)

    cdef Py_ssize_t candidates(self, double reach, bint crossing):
        """Number of corners of one that lie in the other within a distance, and of crossings of sides: in ``between``."""
        cdef Place* out = places(self.between)
        cdef Py_ssize_t i, count = 0
        for i in range(self.a.count):
            if inside(self.a.corners + i, &self.b, reach):
                out[count] = self.a.corners[i]
                count += 1
        for i in range(self.b.count):
            if inside(self.b.corners + i, &self.a, reach):
                out[count] = self.b.corners[i]
                count += 1
        return count + (crossings(&self.a, &self.b, out + count) if crossing else 0)


def opposite(
    const double[:, :] first not None, const double[:, :] second not None, const double[:] normal not None, double flush=0.0
):
    """Whether two features overlap in projection along a direction; if not, the direction is not the contact normal.

    Args:
        first: Extreme points of the first geom along the direction, (m, 3).
        second: Extreme points of the second geom opposite to it, (n, 3).
        normal: Unit vector from the first geom to the second.
        flush: See :func:`touching_set`.
    """
    cdef double[3] offset, along
    cdef double height
    cdef int i
    cdef _Across both
    if first.shape[0] == second.shape[0] == 1:  # the most frequent case
        for i in range(3):
            along[i], offset[i] = normal[i], second[0, i] - first[0, i]
        height = dot(offset, along)
        for i in range(3):
            offset[i] -= height * along[i]
        return sqrt(dot(offset, offset)) <= _MERGED
    both = _Across(first, second, normal)
    return both.candidates(max(_MERGED, flush) if both.lie_along(flush) else _MERGED, True) > 0


def touching_set(
    const double[:, :] first not None,
    const double[:, :] second not None,
    const double[:] normal not None,
    double level=_GAP,
    double flush=0.0,
):
    """Extreme points of the intersection of two features, projected onto the plane across the normal, (k, 3).

    Args:
        first: Extreme points of the first geom along the normal, (m, 3).
        second: Extreme points of the second geom opposite to it, (n, 3).
        normal: Unit normal from the first geom to the second.
        level: Points whose gap exceeds the least gap by more than this, in m, are not in contact.
        flush: Offset across the normal, m, within which two lines lie along each other; see
            :func:`~ffsm_mj.contact.patch.flush_offset`.

    Returns:
        Points midway between the two features; empty if the projections do not overlap within rounding.
    """
    cdef _Across both
    cdef Polygon common
    cdef bytearray block
    cdef const Place* corner
    cdef Py_ssize_t i, k, count
    cdef double reach, least = INFINITY
    cdef double* low
    cdef double* high
    cdef double[:, ::1] out
    cdef bint along
    if first.shape[0] == 1 or second.shape[0] == 1:
        return (first if first.shape[0] == 1 else second).base
    both = _Across(first, second, normal)
    reach = _GAP + 1e-7 * max(extent(both.a.corners, both.a.count), extent(both.b.corners, both.b.count))
    along = both.lie_along(flush)
    count = both.candidates(max(reach, flush) if along else reach, not along)
    if count == 0:
        return np.empty((0, 3))
    common = hull_of(places(both.between), count, max(reach, flush) if along else reach, _STRAIGHT)
    block = room(2 * common.count)
    low, high = numbers(block), numbers(block) + common.count
    heights(first, both.plane, &common, low)
    heights(second, both.plane, &common, high)
    for i in range(common.count):
        least = min(least, high[i] - low[i])
    out, count = np.empty((common.count, 3)), 0
    for i in range(common.count):
        if high[i] - low[i] <= least + level:
            corner = common.corners + i
            for k in range(3):
                out[count, k] = (
                    corner.x * both.plane[3 + k] + corner.y * both.plane[6 + k] + 0.5 * (low[i] + high[i]) * both.plane[k]
                )
            count += 1
    return out.base[:count]


cdef int heights(const double[:, :] points, const double* plane, const Polygon* corners, double* out) except -1:
    """Heights at the corners of the line or plane fitted to points, m."""
    cdef Py_ssize_t i, count = points.shape[0]
    cdef bytearray block = room(4 * count)
    cdef Place* flat = places(block)
    cdef double* rises = numbers(block) + 3 * count
    cdef double[3] point
    cdef double x = 0.0, y = 0.0, level = 0.0, a = 0.0, b = 0.0, c = 0.0, u = 0.0, v = 0.0, det, square, along, across
    flatten(points, plane, flat)
    for i in range(count):
        point[0], point[1], point[2] = points[i, 0], points[i, 1], points[i, 2]
        rises[i] = dot(point, plane)
        x, y, level = x + flat[i].x, y + flat[i].y, level + rises[i]
    x, y, level = x / count, y / count, level / count
    for i in range(count):
        flat[i].x -= x
        flat[i].y -= y
        rises[i] -= level
        a, b, c = a + flat[i].x * flat[i].x, b + flat[i].x * flat[i].y, c + flat[i].y * flat[i].y
        u, v = u + flat[i].x * rises[i], v + flat[i].y * rises[i]
    det, square = a * c - b * b, a + c
    if count == 2:
        along, across = u / square, v / square  # both offsets are on one line
    elif det > _WIDE * square * square:
        along, across = (c * u - b * v) / det, (a * v - b * u) / det
    else:
        offsets = [(flat[i].x, flat[i].y) for i in range(count)]
        along, across = np.linalg.lstsq(np.array(offsets), np.array([rises[i] for i in range(count)]), rcond=None)[0]
    for i in range(corners.count):
        out[i] = level + ((corners.corners[i].x - x) * along + (corners.corners[i].y - y) * across)
    return 0
