"""Cores of contact features: a point, line, face, circle or ellipsoid fixed to a body, with a radius around it.

A sphere is a point with a radius, the side of a capsule a line with a radius; boxes and meshes have points, lines and faces
with radius 0. Lengths are in m; positions and directions are in body axes, relative to the origin of the body.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.body_motion import Body, BodyMotion, Vector, cross, dot, minus, scaled, shifted, unit


@dataclass(frozen=True)
class Point:
    """A point: centre of a sphere or of the end of a capsule, or a vertex.

    Attributes:
        name: Name of the feature.
        body: Body that it is fixed to.
        centre: Position.
        radius: Radius around it.
        cone: Unit directions to the other points of the geom, (k, 3): a point in one of these directions is nearer to
            another core.
    """

    name: str
    body: Body
    centre: Vector
    radius: float
    cone: FloatArray

    def inside(self, motion: BodyMotion, offset: Vector) -> float:
        """Margin in m by which a point at an offset (world axes) is nearest to this core rather than to another one."""
        return -float((self.cone @ motion.local(offset)).max()) if len(self.cone) else math.inf


@dataclass(frozen=True)
class Line:
    """A straight segment: the side of a capsule or cylinder, or an edge.

    Attributes:
        name: Name of the feature.
        body: Body that it is fixed to.
        centre: Midpoint.
        direction: Unit vector along it.
        half: Half its length.
        radius: Radius around it.
        wedge: Unit vectors perpendicular to it into the two faces that it bounds.
        ends: Cores at its ends.
    """

    name: str
    body: Body
    centre: Vector
    direction: Vector
    half: float
    radius: float
    wedge: tuple[Vector, ...]
    ends: tuple[Point | Circle, ...]

    def foot(self, motion: BodyMotion, arm: Vector) -> tuple[Vector, Vector, Vector]:
        """Nearest point to a given one (arms), tangent there, and minus the curvature vector; world axes."""
        along, middle = motion.turned(self.direction), motion.turned(self.centre)
        return shifted(middle, dot(minus(arm, middle), along), along), along, _STRAIGHT

    def inside(self, motion: BodyMotion, foot: Vector, offset: Vector) -> float:
        """Margin in m of the foot (its arm) to the nearer end, and of a point at an offset from it to the faces."""
        along = minus(motion.local(foot), self.centre)
        least = self.half - abs(dot(along, self.direction))
        if self.wedge:
            local = motion.local(offset)
            for into in self.wedge:
                least = min(least, -dot(into, local))
        return least

    def aligned(self, normal: Vector) -> Line:
        """The line, made perpendicular to a normal (body axes)."""
        return replace(self, direction=unit(shifted(self.direction, -dot(self.direction, normal), normal)))


_STRAIGHT = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Face:
    """A bounded plane: a polygon or a disc.

    Attributes:
        name: Name of the feature.
        body: Body that it is fixed to.
        centre: A point in the plane; the centre of a disc.
        normal: Outward unit normal.
        sides: Sides of a polygon: inward unit vector perpendicular to the side, and the position of the side along it.
        disc: Radius of a disc; 0 for a polygon.
        radius: Radius around it, 0.
    """

    name: str
    body: Body
    centre: Vector
    normal: Vector
    sides: tuple[tuple[Vector, float], ...]
    disc: float = 0.0
    radius: float = 0.0

    def inside(self, point: Vector) -> float:
        """Distance in m by which the projection of a point (body axes) is inside the nearest side."""
        if self.disc > 0.0:
            offset = minus(point, self.centre)
            return self.disc - math.hypot(*shifted(offset, -dot(offset, self.normal), self.normal))
        x, y, z = point
        return min([p * x + q * y + r * z - side for (p, q, r), side in self.sides], default=math.inf)

    def aligned(self, normal: Vector) -> Face:
        """The face with another normal (body axes)."""
        return replace(self, normal=normal)


@dataclass(frozen=True)
class RegionFace(Face):
    """A face of a union that is not convex.

    Attributes:
        region: The face.
    """

    region: Any = None

    def inside(self, point: Vector) -> float:
        """Distance in m by which the projection of a point (body axes) is inside the outline."""
        return float(self.region.inside(np.array(point)))


@dataclass(frozen=True)
class Circle:
    """The rim of a cap of a cylinder.

    Attributes:
        name: Name of the feature.
        body: Body that it is fixed to.
        centre: Centre of the circle.
        axis: Unit vector along the axis of the cylinder, outwards.
        start: Unit vector perpendicular to the axis, towards the initial contact point: angle 0.
        size: Radius of the circle.
        radius: Radius around it, 0.
        bounded: Whether the normal must lie between those of the cap and of the side; not on a level cap or along a side.
    """

    name: str
    body: Body
    centre: Vector
    axis: Vector
    start: Vector
    size: float
    radius: float = 0.0
    bounded: bool = True

    def at_angle(self, motion: BodyMotion, angle: float) -> tuple[Vector, Vector, Vector]:
        """Arm of the point at an angle from the start, the tangent there, and the unit vector outwards; world axes."""
        axis, start = motion.turned(self.axis), motion.turned(self.start)
        outward = shifted(scaled(math.cos(angle), start), math.sin(angle), cross(axis, start))
        return shifted(motion.turned(self.centre), self.size, outward), cross(axis, outward), outward

    def foot(self, motion: BodyMotion, arm: Vector) -> tuple[Vector, Vector, Vector]:
        """Nearest point to a given one (arms), tangent there, and minus the curvature vector; world axes."""
        axis, middle = motion.turned(self.axis), motion.turned(self.centre)
        offset = minus(arm, middle)
        outward = unit(shifted(offset, -dot(offset, axis), axis))
        return shifted(middle, self.size, outward), cross(axis, outward), scaled(1.0 / self.size, outward)

    def inside(self, motion: BodyMotion, foot: Vector, offset: Vector) -> float:
        """Margin in m by which a point at an offset from the foot (its arm) is nearest to the rim, not to cap or side."""
        axis, outward = motion.turned(self.axis), minus(foot, motion.turned(self.centre))
        return min(dot(offset, axis), dot(offset, outward) / self.size)

    def extreme(self, motion: BodyMotion, direction: Vector) -> Vector:
        """Arm of the extreme point along a direction, world axes."""
        axis = motion.turned(self.axis)
        outward = unit(shifted(direction, -dot(direction, axis), axis))
        # Close to the axis the difference is small, and rounding over it would lift the point off the plane of the circle.
        outward = unit(shifted(outward, -dot(outward, axis), axis))
        return shifted(motion.turned(self.centre), self.size, outward)

    def extreme_rate(self, motion: BodyMotion, direction: Vector, vector: Vector) -> Vector:
        """Rate of the extreme point along a unit direction that turns at the rate ``vector``, world axes."""
        axis = motion.turned(self.axis)
        across = shifted(direction, -dot(direction, axis), axis)
        radial = math.hypot(*across)
        tangent = scaled(1.0 / radial, cross(axis, across))
        return scaled(self.size / radial * dot(tangent, vector), tangent)


@dataclass(frozen=True)
class Ellipsoid:
    """A whole ellipsoid.

    Attributes:
        name: Name of the feature.
        body: Body that it is fixed to.
        centre: Centre.
        axes: Unit vectors along the principal axes.
        squares: Squares of the semi-axes.
        radius: Radius around it, 0.
    """

    name: str
    body: Body
    centre: Vector
    axes: tuple[Vector, Vector, Vector]
    squares: Vector
    radius: float = 0.0

    def extreme(self, motion: BodyMotion, direction: Vector) -> Vector:
        """Arm of the extreme point along a unit direction, world axes."""
        squared = self._squared(motion.local(direction))
        reach = math.sqrt(dot(squared, motion.local(direction)))
        return motion.turned(shifted(self.centre, 1.0 / reach, squared))

    def extreme_rate(self, motion: BodyMotion, direction: Vector, vector: Vector) -> Vector:
        """Rate of the extreme point along a unit direction that turns at the rate ``vector``, world axes."""
        local, turn = motion.local(direction), motion.local(vector)
        squared = self._squared(local)
        reach_squared = dot(squared, local)
        moved = shifted(self._squared(turn), -dot(squared, turn) / reach_squared, squared)
        return motion.turned(scaled(1.0 / math.sqrt(reach_squared), moved))

    def _squared(self, vector: Vector) -> Vector:
        """Product of the matrix with the squares of the semi-axes as eigenvalues and a vector."""
        total = _STRAIGHT
        for axis, square in zip(self.axes, self.squares, strict=True):
            total = shifted(total, square * dot(axis, vector), axis)
        return total


Curve = Line | Circle
Core = Point | Line | Face | Circle | Ellipsoid
