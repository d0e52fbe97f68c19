"""What geoms are made of where they touch: a core (point, line, face, circle, ellipsoid) on a body, and a radius about it.

A sphere is a point, a capsule's side a line, each with a radius; a box or a mesh has points, lines and faces with none. All
lengths are in m and all vectors in the axes of the body, from its origin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.body_motion import Body, BodyMotion, Vector, cross, dot, minus, scaled, shifted, unit


@dataclass(frozen=True)
class Point:
    """A point: centre of a sphere or of a capsule's end, a vertex.

    Attributes:
        name: What it is.
        body: The body.
        centre: Where it is.
        radius: About it.
        cone: Directions to its geom's other points: what lies towards one of them is nearer to another core, (k, 3).
    """

    name: str
    body: Body
    centre: Vector
    radius: float
    cone: FloatArray

    def inside(self, motion: BodyMotion, offset: Vector) -> float:
        """How far something at an offset (world axes) is from being nearer to another core."""
        return -float((self.cone @ motion.local(offset)).max()) if len(self.cone) else math.inf


@dataclass(frozen=True)
class Line:
    """A straight line with ends: the side of a capsule or cylinder, an edge.

    Attributes:
        name: What it is.
        body: The body.
        centre: Its middle.
        direction: Unit vector along it.
        half: Half its length.
        radius: About it.
        wedge: Directions across it into the two faces that it bounds.
        ends: The cores at its ends.
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
        """Arm of the nearest point to the point at an arm, direction there and minus the curvature vector; world axes."""
        along, middle = motion.turned(self.direction), motion.turned(self.centre)
        return shifted(middle, dot(minus(arm, middle), along), along), along, _STRAIGHT

    def inside(self, motion: BodyMotion, foot: Vector, offset: Vector) -> float:
        """How far the foot (its arm) is from the nearer end and what is at an offset from it from being over a face."""
        along = minus(motion.local(foot), self.centre)
        least = self.half - abs(dot(along, self.direction))
        if self.wedge:
            local = motion.local(offset)
            for into in self.wedge:
                least = min(least, -dot(into, local))
        return least

    def aligned(self, normal: Vector) -> Line:
        """The same, square to a normal (axes of the body)."""
        return replace(self, direction=unit(shifted(self.direction, -dot(self.direction, normal), normal)))


_STRAIGHT = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Face:
    """A plane with bounds: a polygon, or a disc.

    Attributes:
        name: What it is.
        body: The body.
        centre: A point of it, the middle of a disc.
        normal: Unit normal, outwards.
        sides: Of a polygon: unit vector inwards across each side, and where that side is along it.
        disc: Radius of a disc; 0 for a polygon.
    """

    name: str
    body: Body
    centre: Vector
    normal: Vector
    sides: tuple[tuple[Vector, float], ...]
    disc: float = 0.0
    radius: float = 0.0

    def inside(self, point: Vector) -> float:
        """How far the foot of a point (axes of the body) is inside the nearest side."""
        if self.disc > 0.0:
            offset = minus(point, self.centre)
            return self.disc - math.hypot(*shifted(offset, -dot(offset, self.normal), self.normal))
        x, y, z = point
        return min([p * x + q * y + r * z - side for (p, q, r), side in self.sides], default=math.inf)

    def aligned(self, normal: Vector) -> Face:
        """The same with another normal (axes of the body)."""
        return replace(self, normal=normal)


@dataclass(frozen=True)
class Circle:
    """The rim of a cylinder's face.

    Attributes:
        name: What it is.
        body: The body.
        centre: Middle of the circle.
        axis: Unit vector outwards along the cylinder.
        start: Unit vector across the axis from which angles count: towards the contact at the beginning.
        size: Radius of the circle.
    """

    name: str
    body: Body
    centre: Vector
    axis: Vector
    start: Vector
    size: float
    radius: float = 0.0

    def foot(self, motion: BodyMotion, arm: Vector) -> tuple[Vector, Vector, Vector]:
        """Arm of the nearest point to the point at an arm, direction there and minus the curvature vector; world axes."""
        axis, middle = motion.turned(self.axis), motion.turned(self.centre)
        offset = minus(arm, middle)
        outward = unit(shifted(offset, -dot(offset, axis), axis))
        return shifted(middle, self.size, outward), cross(axis, outward), scaled(1.0 / self.size, outward)

    def inside(self, motion: BodyMotion, foot: Vector, offset: Vector) -> float:
        """How far what is at an offset from the foot (its arm) is from being over the face or beside the side."""
        axis, outward = motion.turned(self.axis), minus(foot, motion.turned(self.centre))
        return min(dot(offset, axis), dot(offset, outward) / self.size)

    def extreme(self, motion: BodyMotion, direction: Vector) -> Vector:
        """Arm of the extreme point along a direction; world axes."""
        axis = motion.turned(self.axis)
        outward = unit(shifted(direction, -dot(direction, axis), axis))
        return shifted(motion.turned(self.centre), self.size, outward)

    def extreme_rate(self, motion: BodyMotion, direction: Vector, vector: Vector) -> Vector:
        """How the extreme point along a unit direction moves when that turns by a vector; world axes."""
        axis = motion.turned(self.axis)
        across = shifted(direction, -dot(direction, axis), axis)
        radial = math.hypot(*across)
        tangent = scaled(1.0 / radial, cross(axis, across))
        return scaled(self.size / radial * dot(tangent, vector), tangent)


@dataclass(frozen=True)
class Ellipsoid:
    """All of an ellipsoid.

    Attributes:
        name: What it is.
        body: The body.
        centre: Its centre.
        axes: Unit vectors along its axes.
        squares: Squares of its semi-axes.
    """

    name: str
    body: Body
    centre: Vector
    axes: tuple[Vector, Vector, Vector]
    squares: Vector
    radius: float = 0.0

    def extreme(self, motion: BodyMotion, direction: Vector) -> Vector:
        """Arm of the extreme point along a unit direction; world axes."""
        squared = self._squared(motion.local(direction))
        reach = math.sqrt(dot(squared, motion.local(direction)))
        return motion.turned(shifted(self.centre, 1.0 / reach, squared))

    def extreme_rate(self, motion: BodyMotion, direction: Vector, vector: Vector) -> Vector:
        """How the extreme point along a unit direction moves when that turns by a vector; world axes."""
        local, turn = motion.local(direction), motion.local(vector)
        squared = self._squared(local)
        reach_squared = dot(squared, local)
        moved = shifted(self._squared(turn), -dot(squared, turn) / reach_squared, squared)
        return motion.turned(scaled(1.0 / math.sqrt(reach_squared), moved))

    def _squared(self, vector: Vector) -> Vector:
        """The squares of the semi-axes as a matrix, times a vector."""
        total = _STRAIGHT
        for axis, square in zip(self.axes, self.squares, strict=True):
            total = shifted(total, square * dot(axis, vector), axis)
        return total


Curve = Line | Circle
Core = Point | Line | Face | Circle | Ellipsoid
