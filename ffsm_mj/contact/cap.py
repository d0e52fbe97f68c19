"""Caps of cylinders: discs with a rim, and what two of them that lie on each other have in common."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.shape import Shape
from ffsm_mj.tolerances import CONTACT_GAP_M, CROSSING

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


def on_each_other(one: Cap, other: Cap, points: FloatArray, other_points: FloatArray) -> tuple[FloatArray, FloatArray]:
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
