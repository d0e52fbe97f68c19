"""The contact patch of two convex geoms: a point, an edge or a face, given by its extreme points; caps of cylinders.

The witness point of a distance query is not defined for a flat contact: it jumps from corner to corner at a tilt of 1e-9
rad. The contact patch is therefore built from the features of the geoms: the extreme points of each geom along the normal
span a polygon, and the patch is the intersection of the two polygons.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.shape import Shape
from ffsm_mj.tolerances import CONTACT_GAP_M, CROSSING, FLUSH_M, PARALLEL

_NONE = np.empty((0, 3))


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
