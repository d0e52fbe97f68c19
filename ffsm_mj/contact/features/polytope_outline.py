"""Outlines of spheres, capsules, boxes and meshes: polytopes with a radius around them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.body_motion import Vector
from ffsm_mj.contact.features.cores import Core, Face, Line, Point
from ffsm_mj.contact.features.outline import Outline
from ffsm_mj.contact.shape import Shape, position_tolerance
from ffsm_mj.dynamics.rigid_body import cross
from ffsm_mj.hull import hull
from ffsm_mj.tolerances import MERGED_M, PARALLEL, STRAIGHT

_NO_CONE = np.empty((0, 3))
_SIGNS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])

_SPHERE, _CAPSULE = int(mujoco.mjtGeom.mjGEOM_SPHERE), int(mujoco.mjtGeom.mjGEOM_CAPSULE)
_BOX, _MESH = int(mujoco.mjtGeom.mjGEOM_BOX), int(mujoco.mjtGeom.mjGEOM_MESH)
_NAMES = {_SPHERE: "sphere", _CAPSULE: "end"}


class PolytopeOutline(Outline):
    """Outline of a polytope with a radius around it."""

    def __init__(self, model: Any, data: Any, geom: int, outward: FloatArray, tolerance: float) -> None:
        """Find the features; see :class:`Outline`."""
        super().__init__(model, data, geom, outward, tolerance)
        self._model, self._geom, self._kind = model, geom, int(model.geom_type[geom])
        self._name = _NAMES.get(self._kind, "vertex")
        self._radius = self._size[0] if self._kind in _NAMES else 0.0
        self.position_tolerance = position_tolerance(model, geom)
        level = Shape(model, data, geom).extreme(outward, PARALLEL) - self._radius * outward
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
        flat = points @ np.stack((u, cross(self._outward, u))).T
        corners = hull(flat, merge=MERGED_M, straight=STRAIGHT)
        return np.asarray(points[[int(np.argmin(np.abs(flat - corner).sum(axis=1))) for corner in corners]])

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
            inwards = cross(normal, end - start)
            inwards /= np.linalg.norm(inwards)
            sides.append((self._turned(inwards), float(inwards @ (start - self._motion.origin))))
        return Face("face", self._body, self._place(corners.mean(axis=0)), self._turned(normal), tuple(sides))

    def _normal(self) -> FloatArray:
        """Normal of the face: for a box its axis, for a mesh the normal of the plane fitted to the corners."""
        if self._kind == _BOX:
            axis = self._rotation[:, int(np.argmax(np.abs(self._outward @ self._rotation)))]
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
            into = cross(self._normal(), direction)
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
