"""The contact patch of two convex geoms: a point, an edge or a face, given by its extreme points; caps of cylinders.

The witness point of a distance query is not defined for a flat contact: it jumps from corner to corner at a tilt of 1e-9
rad. The contact patch is therefore built from the features of the geoms: the extreme points of each geom along the normal
span a polygon, and the patch is the intersection of the two polygons.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.shape import Shape
from ffsm_mj.dynamics.rigid_body import cross
from ffsm_mj.hull import hull, turn
from ffsm_mj.tolerances import CONTACT_GAP_M, CROSSING, FLUSH_M, MERGED_M, PARALLEL, STRAIGHT

_NONE, _AXES = np.empty((0, 3)), np.eye(3)
_DECIMALS = 12
"""Decimals of places of contact points in m that are no rounding."""


@dataclass(frozen=True)
class Cap:
    """The flat end of a cylinder.

    Attributes:
        centre: Centre in world axes, m, (3,).
        axes: Two orthonormal vectors in its plane, world axes, (2, 3).
        radius: Radius in m.
    """

    centre: FloatArray
    axes: FloatArray
    radius: float

    def rise(self, point: FloatArray, normal: FloatArray) -> float:
        """Cosine of the angle between a direction and the radial direction, in the plane of the cap, towards a point."""
        outward = (self.axes @ (point - self.centre)) @ self.axes
        return float(normal @ outward) / float(np.linalg.norm(outward))

    def towards(self, direction: FloatArray) -> FloatArray | None:
        """The extreme point of the rim along a direction, (3,); None if the direction is perpendicular to the cap."""
        along = self.axes @ direction
        length = float(np.linalg.norm(along))
        return np.asarray(self.centre + self.radius / length * along @ self.axes) if length > 0.0 else None

    def covered(self, points: FloatArray) -> FloatArray:
        """Projections onto the cap of those points that are over it, (k, 3)."""
        flat = (points - self.centre) @ self.axes.T
        return np.asarray(self.centre + flat[np.linalg.norm(flat, axis=1) <= self.radius + CONTACT_GAP_M] @ self.axes)

    def crossings(self, other: Cap) -> FloatArray:
        """Points where the rim of another, level cap crosses this rim, (2, 3); (0, 3) if it misses it or is parallel."""
        offset = self.axes @ (other.centre - self.centre)
        distance = math.hypot(*offset)
        if not abs(self.radius - other.radius) < distance < self.radius + other.radius:
            return _NONE
        # The crossings are on the line on which the powers of a point with respect to both circles are equal.
        along = 0.5 * (distance + (self.radius**2 - other.radius**2) / distance)
        x, y = offset / distance
        height = math.sqrt(max(self.radius**2 - along**2, 0.0))
        if height * distance <= CROSSING * self.radius * other.radius:  # the sine of the angle between the rims
            return _NONE
        flat = np.array([[along * x - side * y, along * y + side * x] for side in (height, -height)])
        return np.asarray(self.centre + flat @ self.axes)


def caps_of(first: Shape, second: Shape, normal: FloatArray) -> tuple[Cap | None, Cap | None]:
    """The caps of two geoms that face each other along a normal; None for other geoms and for tilted cylinders."""
    tolerance = first.position_tolerance + second.position_tolerance
    one, other = first.cap(normal, tolerance), second.cap(-normal, tolerance)
    return Cap(*one) if one else None, Cap(*other) if other else None


def onto_caps(one: Cap, other: Cap, points: FloatArray, other_points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points of two level caps whose hulls have as intersection that of the points of each rim over the other cap.

    Args:
        one: A cap.
        other: The opposite cap.
        points: Points of the rim of the first, (m, 3).
        other_points: Points of the rim of the other, (n, 3).

    Returns:
        Both sets, with the points where the rims cross and those points of the other rim that are over the cap.
    """
    return (
        np.vstack((points, one.crossings(other), one.covered(other_points))),
        np.vstack((other_points, other.crossings(one), other.covered(points))),
    )


_KINDS = {1: "point", 2: "edge"}

_WIDE = 1e-6
"""Ratio of the moments of places across and along their longest direction, above which their plane is known to 1e-10 of
their rises by Cramer's rule: they are level to PARALLEL."""
_Polygon = list[list[float]]
"""Corners of a convex polygon in order, a segment or a point: few numbers, with which lists are faster than arrays."""


def manifold_name(count: int) -> str:
    """Kind of contact patch by the number of its extreme points: ``point``, ``edge`` or ``face``."""
    return _KINDS.get(count, "face")


def facing(first: Shape, second: Shape, normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Extreme points of the first geom along a direction, (m, 3), and of the second geom opposite to it, (n, 3).

    A cap of a cylinder is represented by points of its rim: a fixed few, and those at which the sides of the other geom's
    polygon, extended, cross the rim. The hull of these points then contains every corner of that polygon within the rim. If
    both geoms show a cap, each has its fixed points, those of the other that are over it, and the crossings of the rims.
    A plane has the points opposite to those of the other geom.
    """
    tolerance = first.position_tolerance + second.position_tolerance
    a, b = first.extreme(normal, PARALLEL, tolerance), second.extreme(-normal, PARALLEL, tolerance)
    if first.is_plane or second.is_plane:
        return (first.projected(b), b) if first.is_plane else (a, second.projected(a))
    of_first, of_second = caps_of(first, second, normal)
    if of_first and of_second:
        a, b = onto_caps(of_first, of_second, a, b)
    elif of_first:
        a = np.vstack((a, first.rim_points(normal, b)))
    elif of_second:
        b = np.vstack((b, second.rim_points(-normal, a)))
    return a, b


def flush_offset(radius: float) -> float:
    """Greatest offset across the normal, m, of two lines that lie along each other, with the sum of their radii in m."""
    return math.sqrt(2.0 * FLUSH_M * radius)


def lie_along(sine: float, length: float, flush: float) -> bool:
    """Whether two lines are parallel, or so nearly that round sides around them touch along the length that they share.

    Args:
        sine: Sine of the angle between them.
        length: Length of the shorter one, m.
        flush: Their :func:`flush_offset`, m.
    """
    return sine <= max(PARALLEL, flush / length)


def segments_lie_along(first: FloatArray, second: FloatArray, flush: float) -> bool:
    """The same for two features: whether both are segments, at least one of which is a round side; (n, 2) or (n, 3) each."""
    if not len(first) == len(second) == 2 or flush <= 0.0:
        return False
    one, other = first[1] - first[0], second[1] - second[0]
    lengths = math.hypot(*one), math.hypot(*other)
    sine = math.hypot(*(other / lengths[1] - one / lengths[0] * math.copysign(1.0, one @ other)))
    return lie_along(sine, min(lengths), flush)


def touching_set(
    first: FloatArray, second: FloatArray, normal: FloatArray, level: float = CONTACT_GAP_M, flush: float = 0.0
) -> FloatArray:
    """Extreme points of the intersection of two features, projected onto the plane across the normal, (k, 3).

    Args:
        first: Extreme points of the first geom along the normal, (m, 3).
        second: Extreme points of the second geom opposite to it, (n, 3).
        normal: Unit normal from the first geom to the second.
        level: Points whose gap exceeds the least gap by more than this, in m, are not in contact.
        flush: Offset across the normal, m, within which two lines lie along each other; see :func:`flush_offset`.

    Returns:
        Points midway between the two features; empty if the projections do not overlap within rounding.
    """
    if min(len(first), len(second)) == 1:
        return first if len(first) == 1 else second
    plane, a, b = _flattened(first, second, normal)
    reach = CONTACT_GAP_M + 1e-7 * max(float(np.ptp(a, axis=0).max()), float(np.ptp(b, axis=0).max()))
    along = segments_lie_along(a, b, flush)
    if along:
        reach = max(reach, flush)
    one, other = a.tolist(), b.tolist()
    candidates = [p for p in one if _inside(p, other, reach)] + [p for p in other if _inside(p, one, reach)]
    candidates += [] if along else _crossings(one, other)
    if not candidates:
        return np.empty((0, 3))
    corners = hull(np.array(candidates), merge=reach, straight=STRAIGHT)
    low, high = (_heights(points @ normal, points @ plane.T, corners) for points in (first, second))
    touching = high - low <= (high - low).min() + level
    return np.asarray(corners[touching] @ plane + np.outer(0.5 * (low + high)[touching], normal))


def corners_across(points: FloatArray, normal: FloatArray) -> list[int]:
    """Indices of the points, (k, 3), that are corners of their hull in the plane across a normal, in order around it."""
    if len(points) == 1:
        return [0]
    # Rounded: of three points on a line along the second axis the middle one would else come first by rounding, and the
    # chain of the hull keeps its first.
    flat = np.round(points @ _axes_across(normal).T, _DECIMALS)
    reach = CONTACT_GAP_M + 1e-7 * float(np.ptp(flat, axis=0).max())
    corners = hull(flat, merge=reach, straight=STRAIGHT)
    return [int(np.argmin(np.abs(flat - corner).sum(axis=1))) for corner in corners]


def opposite(first: FloatArray, second: FloatArray, normal: FloatArray, flush: float = 0.0) -> bool:
    """Whether two features overlap in projection along a direction; if not, the direction is not the contact normal.

    Args:
        first: Extreme points of the first geom along the direction, (m, 3).
        second: Extreme points of the second geom opposite to it, (n, 3).
        normal: Unit vector from the first geom to the second.
        flush: See :func:`touching_set`.
    """
    if len(first) == len(second) == 1:  # the most frequent case
        offset = second[0] - first[0]
        return bool(np.linalg.norm(offset - offset @ normal * normal) <= MERGED_M)
    _, a, b = _flattened(first, second, normal)
    one, other = a.tolist(), b.tolist()
    corners = [(p, other) for p in one] + [(p, one) for p in other]
    reach = max(MERGED_M, flush) if segments_lie_along(a, b, flush) else MERGED_M
    return any(_inside(p, polygon, reach) for p, polygon in corners) or bool(_crossings(one, other))


def _flattened(first: FloatArray, second: FloatArray, normal: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Two axes across the normal, (2, 3), and the hulls of both features in the plane of these axes."""
    plane = _axes_across(normal)
    a, b = (hull(points @ plane.T, merge=MERGED_M, straight=STRAIGHT) for points in (first, second))
    return plane, a, b


def _axes_across(normal: FloatArray) -> FloatArray:
    """Two axes across a normal, (2, 3)."""
    u = cross(normal, _AXES[int(np.argmin(np.abs(normal)))])
    u /= np.linalg.norm(u)
    return np.array((u, cross(normal, u)))


def _heights(heights: FloatArray, places: FloatArray, corners: FloatArray) -> FloatArray:
    """Heights at the corners of the line or plane fitted to places of known height, (k,)."""
    middle, level = places.mean(axis=0), heights.mean()
    offsets, rises = places - middle, heights - level
    ((a, b), (_, c)), (u, v) = (offsets.T @ offsets).tolist(), (offsets.T @ rises).tolist()
    det, square = a * c - b * b, a + c
    if len(places) == 2:
        slope = np.array((u / square, v / square))  # both offsets are on one line
    elif det > _WIDE * square * square:
        slope = np.array(((c * u - b * v) / det, (a * v - b * u) / det))
    else:
        slope = np.linalg.lstsq(offsets, rises, rcond=None)[0]
    return np.asarray(level + (corners - middle) @ slope)


def _inside(p: list[float], polygon: _Polygon, reach: float) -> bool:
    """Whether a point lies in a convex polygon, on a segment or at a point, within the distance ``reach``."""
    if len(polygon) == 1:
        return math.dist(p, polygon[0]) <= reach
    if len(polygon) == 2:
        (x, y), (u, v) = polygon[0], (polygon[1][0] - polygon[0][0], polygon[1][1] - polygon[0][1])
        t = min(max(((p[0] - x) * u + (p[1] - y) * v) / (u * u + v * v), 0.0), 1.0)
        return math.hypot(p[0] - x - t * u, p[1] - y - t * v) <= reach
    return all(turn(a, b, p) >= -reach * math.dist(a, b) for a, b in _edges(polygon))


def _crossings(a: _Polygon, b: _Polygon) -> _Polygon:
    """Points at which an edge of one polygon crosses an edge of the other."""
    crossings = []
    for p, q in _edges(a):
        dx, dy = q[0] - p[0], q[1] - p[1]
        for r, s in _edges(b):
            ex, ey = s[0] - r[0], s[1] - r[1]
            cross = dx * ey - dy * ex
            if abs(cross) <= PARALLEL * math.hypot(dx, dy) * math.hypot(ex, ey):
                continue
            x, y = r[0] - p[0], r[1] - p[1]
            t, v = (x * ey - y * ex) / cross, (x * dy - y * dx) / cross
            if 0.0 <= t <= 1.0 and 0.0 <= v <= 1.0:
                crossings.append([p[0] + t * dx, p[1] + t * dy])
    return crossings


def _edges(polygon: _Polygon) -> list[tuple[list[float], list[float]]]:
    """Sides of a polygon in order; one of a segment, none of a point."""
    return list(pairwise([*polygon, polygon[0]] if len(polygon) > 2 else polygon))
