"""Outlines of geoms: the cores of the features by which they can touch, of polytopes and of round geoms.

Spheres, capsules, boxes and meshes are polytopes with a radius around them; cylinders and ellipsoids are round.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from ffsm_mj._core.polygons import hull_indices
from ffsm_mj._core.shapes import lies_flat
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.body_motion import Body, Vector, cross, dot, minus, shifted, unit
from ffsm_mj.contact.features.cores import Circle, Core, Curve, Ellipsoid, Face, Line, Point
from ffsm_mj.contact.shape import Part, Shape
from ffsm_mj.dynamics.rigid_body import cross as cross_product
from ffsm_mj.tolerances import CONTACT_GAP_M, MERGED_M, PARALLEL, STRAIGHT


class Outline:
    """The extreme features of a geom along a direction.

    Attributes:
        position_tolerance: Tolerance to which its points are known, in m: 0 except for meshes.
        flat: Whether it has a face perpendicular to the direction.
    """

    position_tolerance = 0.0
    flat = False

    def __init__(
        self,
        model: Any,
        data: Any,
        geom: int,
        outward: FloatArray,
        tolerance: float,  # noqa: ARG002
        body: Body | None = None,
        part: Part | None = None,
    ) -> None:
        """Find the features.

        Args:
            model: MuJoCo model.
            data: Its data, positions and velocities current.
            geom: Id of the geom.
            outward: Unit vector out of the geom, world axes, (3,).
            tolerance: Tolerance to which points of both geoms are known, m.
            body: Body in whose axes the cores are; None: that of the geom.
            part: Part of the geom that is meant; None: the whole geom.
        """
        self._body, self._part = body or Body(model, int(model.geom_bodyid[geom])), part
        self._motion = self._body.motion(data)
        self._rotation: FloatArray = data.geom_xmat[geom].reshape(3, 3)
        self._position: FloatArray = data.geom_xpos[geom]
        self._size: list[float] = model.geom_size[geom].tolist()
        self._outward = outward

    def points(self) -> list[Core]:
        """Cores that can be in contact with a face of the other geom, without bounds."""
        return self.corners()

    def rim_points(self, places: FloatArray) -> list[Core]:  # noqa: ARG002
        """Those of some places in the world, (k, 3), that are on the rim of a cap."""
        return []

    def corners(self) -> list[Core]:
        """Corners, or round parts, each with its bounds."""
        raise NotImplementedError

    def edges(self, *, bounded: bool) -> Iterator[Line]:
        """Straight edges or sides; with their bounds towards the adjacent faces if ``bounded``."""
        raise NotImplementedError

    def curves(self, *, bounded: bool) -> Iterator[Curve]:
        """Edges, or the rim around a cap."""
        yield from self.edges(bounded=bounded)

    def face(self) -> Face | None:
        """The face, or None."""
        return None

    def direction(self, curve: Curve) -> Vector:
        """Direction of a line, or tangent of a circle at its initial contact point, world axes."""
        return self._motion.turned(curve.direction if isinstance(curve, Line) else cross(curve.axis, curve.start))

    def centre(self, curve: Curve) -> Vector:
        """Centre of a curve in the world."""
        return shifted(self._motion.origin, 1.0, self._motion.turned(curve.centre))

    def crossings(self, circle: Circle, centre: Vector, direction: Vector) -> Iterator[Circle]:
        """Copies of a circle with angle 0 where a line (world axes) crosses it in projection; none if it misses."""
        raise NotImplementedError

    def aligned(self, core: Core) -> Core:
        """The core, made perpendicular to the contact normal if it is a face or line."""
        return core.aligned(self._turned(self._outward)) if isinstance(core, Face | Line) else core

    def _place(self, point: FloatArray) -> Vector:
        """Transform a point from the world to body axes, relative to the body's origin."""
        return self._turned(point - self._motion.origin)

    def _turned(self, vector: FloatArray) -> Vector:
        """Transform a vector from world axes to body axes."""
        x, y, z = vector.tolist()
        return self._motion.local((x, y, z))


class PlaneOutline(Outline):
    """Outline of a half-space along its normal, the only direction in which it ends: a face without sides.

    Contact with it is at the corners of the other geom, or at its lowest point where that is round.
    """

    flat = True

    def __init__(self, model: Any, data: Any, geom: int, outward: FloatArray, tolerance: float, *at: Any) -> None:
        """Find the face; see :class:`Outline`."""
        super().__init__(model, data, geom, outward, tolerance, *at)
        self._normal: FloatArray = self._rotation[:, 2]

    def corners(self) -> list[Core]:
        """None."""
        return []

    def edges(self, *, bounded: bool) -> Iterator[Line]:  # noqa: ARG002
        """None."""
        yield from ()

    def face(self) -> Face | None:
        """The plane, without bounds."""
        return Face("face", self._body, self._place(self._position), self._turned(self._normal), ())


_NO_CONE = np.empty((0, 3))
_SIGNS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])

_SPHERE, _CAPSULE = int(mujoco.mjtGeom.mjGEOM_SPHERE), int(mujoco.mjtGeom.mjGEOM_CAPSULE)
_BOX, _MESH = int(mujoco.mjtGeom.mjGEOM_BOX), int(mujoco.mjtGeom.mjGEOM_MESH)
_NAMES = {_SPHERE: "sphere", _CAPSULE: "end"}


class PolytopeOutline(Outline):
    """Outline of a polytope with a radius around it."""

    def __init__(
        self,
        model: Any,
        data: Any,
        geom: int,
        outward: FloatArray,
        tolerance: float,
        body: Body | None = None,
        part: Part | None = None,
    ) -> None:
        """Find the features; see :class:`Outline`."""
        super().__init__(model, data, geom, outward, tolerance, body, part)
        self._model, self._geom, self._kind = model, geom, int(model.geom_type[geom]) if part is None else -1
        self._name = _NAMES.get(self._kind, "vertex")
        self._radius = self._size[0] if self._kind in _NAMES else 0.0
        shape = Shape(model, data, geom, part)
        self.position_tolerance = shape.position_tolerance
        level = shape.extreme(outward, PARALLEL) - self._radius * outward
        self._corners = self._ordered(level)
        self.flat = len(self._corners) > 2
        # Facets of a mesh that are level within its precision are one face, with a fitted plane: edges and corners around it
        # are bounded by that plane, not by the facets. Otherwise a contact between the two bounds would have no feature.
        self._merged = level if self.flat and self._kind == _MESH else _NO_CONE

    def _ordered(self, points: FloatArray) -> FloatArray:
        """Corners of the convex hull of points in the plane across the normal, in order around it."""
        if len(points) < 3:
            return points
        u = np.linalg.svd(self._outward[None])[2][1]
        flat = points @ np.stack((u, cross_product(self._outward, u))).T
        return np.asarray(points[hull_indices(flat, merge=MERGED_M, straight=STRAIGHT)])

    def points(self) -> list[Core]:
        """Corners, without bounds."""
        return [self._point(corner, _NO_CONE) for corner in self._corners]

    def corners(self) -> list[Core]:
        """Corners, bounded by the directions to all other points of the geom."""
        if not len(self._merged):
            return [self._point(corner, self._towards(self._all() - corner)) for corner in self._corners]
        return [
            self._point(corner, self._towards(np.vstack((self._beyond(), before, after)) - corner))
            for before, corner, after in zip(
                np.roll(self._corners, 1, axis=0), self._corners, np.roll(self._corners, -1, axis=0), strict=True
            )
        ]

    def edges(self, *, bounded: bool) -> Iterator[Line]:
        """The edge between two corners, or the edges around a face."""
        count = len(self._corners)
        for k in range(count if count > 2 else count - 1):
            yield self._line(self._corners[k], self._corners[(k + 1) % count], bounded)

    def face(self) -> Face | None:
        """The polygon of its corners, if there are more than two."""
        if not self.flat:
            return None
        corners, normal = self._corners, self._normal()
        sides = []
        for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            inwards = cross_product(normal, end - start)
            inwards /= np.linalg.norm(inwards)
            sides.append((self._turned(inwards), float(inwards @ (start - self._motion.origin))))
        return Face("face", self._body, self._place(corners.mean(axis=0)), self._turned(normal), tuple(sides))

    def _normal(self) -> FloatArray:
        """Normal of the face: for a box its axis, for a mesh the normal of the plane fitted to the corners."""
        if self._kind == _BOX:
            axis = self._rotation[:, int(np.argmax(np.abs(self._outward @ self._rotation)))]
        elif self._part is not None:
            normals = self._part.polytope.normals @ np.array(self._motion.axes).reshape(3, 3).T
            axis = normals[int(np.argmax(normals @ self._outward))]
        else:
            axis = np.linalg.svd(self._corners - self._corners.mean(axis=0))[2][2]
        return np.asarray(axis if axis @ self._outward > 0.0 else -axis)

    def _point(self, point: FloatArray, cone: FloatArray) -> Point:
        return Point(self._name, self._body, self._place(point), self._radius, cone)

    def _towards(self, offsets: FloatArray) -> FloatArray:
        """Unit vectors along offsets, body axes, (k, 3)."""
        lengths = np.linalg.norm(offsets, axis=1)
        kept = lengths > MERGED_M
        rotation = np.array(self._motion.axes).reshape(3, 3)
        return np.asarray(offsets[kept] / lengths[kept, None] @ rotation)

    def _line(self, start: FloatArray, end: FloatArray, bounded: bool) -> Line:
        span = end - start
        length = float(np.linalg.norm(span))
        wedge = self._wedge(start, span / length) if bounded else ()
        cone = np.array(wedge).reshape(-1, 3)
        ends = (self._point(start, cone), self._point(end, cone))
        name, centre = "side" if self._radius > 0.0 else "edge", self._place(0.5 * (start + end))
        return Line(name, self._body, centre, self._turned(span / length), 0.5 * length, self._radius, wedge, ends)

    def _wedge(self, start: FloatArray, direction: FloatArray) -> tuple[Vector, ...]:
        """Unit vectors perpendicular to an edge into its two faces: the outermost directions to all other points."""
        across = self._all() - start
        across -= np.outer(across @ direction, direction)
        lengths = np.linalg.norm(across, axis=1)
        kept = lengths > max(MERGED_M, self.position_tolerance)
        if not kept.any():
            return ()
        across = across[kept] / lengths[kept, None]
        # All points of a convex body lie within the angle between the faces: measured from the mean, they need no wrapping.
        middle = across.mean(axis=0)
        turned = np.arctan2(across @ np.cross(direction, middle), across @ middle)
        sides = across[[np.argmin(turned), np.argmax(turned)]]
        if len(self._merged):
            into = cross_product(self._normal(), direction)
            sides[np.argmax(sides @ into)] = into / np.linalg.norm(into)
        return self._turned(sides[0]), self._turned(sides[1])

    def _beyond(self) -> FloatArray:
        """All points but those of the merged face, (n, 3)."""
        points = self._all()
        apart = np.linalg.norm(points[:, None] - self._merged, axis=2).min(axis=1)
        return np.asarray(points[apart > MERGED_M])

    def _all(self) -> FloatArray:
        """All points of the polytope (for a capsule both ends of its axis) in the world, (n, 3)."""
        model, size = self._model, self._size
        if self._part is not None:
            axes: FloatArray = np.array(self._motion.axes).reshape(3, 3)
            return np.asarray(self._motion.origin + self._part.polytope.vertices @ axes.T)
        if self._kind == _BOX:
            local = _SIGNS * size
        elif self._kind == _CAPSULE:
            local = np.array([[0.0, 0.0, -size[1]], [0.0, 0.0, size[1]]])
        elif self._kind == _MESH:
            mesh = int(model.geom_dataid[self._geom])
            first = int(model.mesh_vertadr[mesh])
            local = model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])].astype(np.float64)
        else:
            local = np.zeros((1, 3))
        return np.asarray(self._position + local @ self._rotation.T)


class EllipsoidOutline(Outline):
    """Outline of an ellipsoid, the same along any direction."""

    def corners(self) -> list[Core]:
        """The ellipsoid."""
        (a, b, c), (x, y, z) = self._size, (self._turned(axis) for axis in self._rotation.T)
        return [Ellipsoid("ellipsoid", self._body, self._place(self._position), (x, y, z), (a * a, b * b, c * c))]

    def edges(self, *, bounded: bool) -> Iterator[Line]:  # noqa: ARG002
        """No straight edges."""
        yield from ()


class CylinderOutline(Outline):
    """Outline of a cylinder: its side, a cap, or the rim between them."""

    def __init__(self, model: Any, data: Any, geom: int, outward: FloatArray, tolerance: float, *at: Any) -> None:
        """Find the features; see :class:`Outline`."""
        super().__init__(model, data, geom, outward, tolerance, *at)
        axis: FloatArray = self._rotation[:, 2]
        up = float(outward @ axis)
        across = outward - up * axis
        self._radius, self._half = self._size[0], self._size[1]
        self._side = abs(up) <= PARALLEL
        self.flat = lies_flat(float(np.linalg.norm(across)), self._radius, tolerance)
        self._axis = axis if up > 0.0 else -axis
        self._start = self._rotation[:, 0] if self.flat else across / np.linalg.norm(across)
        self._rim_points = Shape(model, data, geom).extreme(outward, PARALLEL, tolerance) if self.flat else None

    def points(self) -> list[Core]:
        """The rims, or points of the rim of a cap."""
        if self._rim_points is None:
            return self.corners()
        return [self._rim_point(point) for point in self._rim_points]

    def rim_points(self, places: FloatArray) -> list[Core]:
        """Those of some places in the world, (k, 3), that are on the rim of a cap."""
        if not self.flat:
            return []
        centre = self._position + self._half * self._axis
        offsets = places - centre
        across = offsets - np.outer(offsets @ self._axis, self._axis)
        lengths = np.linalg.norm(across, axis=1)
        on_rim = np.abs(lengths - self._radius) <= CONTACT_GAP_M
        return [self._rim_point(centre + point) for point in self._radius * across[on_rim] / lengths[on_rim, None]]

    def _rim_point(self, place: FloatArray) -> Point:
        return Point("rim", self._body, self._place(place), 0.0, np.empty((0, 3)))

    def corners(self) -> list[Core]:
        """The rim, or the rims at both ends of the side; none for a cap."""
        if self.flat:
            return []
        return [*self._rims()] if self._side else [self._rim(self._axis)]

    def edges(self, *, bounded: bool) -> Iterator[Line]:  # noqa: ARG002
        """The side: the axis with the radius around it."""
        if self._side:
            centre, axis = self._place(self._position), self._turned(self._axis)
            one, other = (replace(rim, bounded=False) for rim in self._rims())
            yield Line("side", self._body, centre, axis, self._half, self._radius, (), (one, other))

    def curves(self, *, bounded: bool) -> Iterator[Curve]:
        """The side, or the rim around a cap."""
        if self.flat:
            yield self._rim(self._axis)
        yield from self.edges(bounded=bounded)

    def face(self) -> Face | None:
        """The cap."""
        if not self.flat:
            return None
        centre = self._place(self._position + self._half * self._axis)
        return Face("cap", self._body, centre, self._turned(self._axis), (), self._radius)

    def crossings(self, circle: Circle, centre: Vector, direction: Vector) -> Iterator[Circle]:
        """Copies of a circle with angle 0 where a line (world axes) crosses it in projection; none if it misses."""
        axis = self._motion.turned(circle.axis)
        offset = minus(centre, self.centre(circle))
        offset = shifted(offset, -dot(offset, axis), axis)
        along = shifted(direction, -dot(direction, axis), axis)
        square, half = dot(along, along), dot(offset, along)
        under = half * half - square * (dot(offset, offset) - circle.size**2)
        if under > 0.0:
            for root in (math.sqrt(under), -math.sqrt(under)):
                towards = unit(shifted(offset, (root - half) / square, along))
                yield replace(circle, start=self._motion.local(towards), bounded=False)

    def _rims(self) -> tuple[Circle, Circle]:
        return self._rim(self._axis), self._rim(-self._axis)

    def _rim(self, axis: FloatArray) -> Circle:
        centre = self._place(self._position + self._half * axis)
        return Circle("rim", self._body, centre, self._turned(axis), self._turned(self._start), self._radius)
