"""Support function of a convex geom: extreme points, edges and radii of curvature along a direction, in world axes.

The support function h(n) is the extent of a geom along n. Its gradient is the extreme point, and its Hessian R holds the
radii of curvature there: if the normal turns by dn, the extreme point moves by R dn. R is the radius of a sphere across the
normal, 0 at a vertex, and 0 across an edge. Along an edge and within a face the extreme point is not unique: these flat
directions have no finite radius and are 0 in R. A plane bounds a half-space, whose support function is finite along its
normal only, where every point of it is extreme.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj._core.polygons import hull
from ffsm_mj._core.shapes import PosedGeom, lies_flat
from ffsm_mj.arrays import FloatArray
from ffsm_mj.cached_property import cached_property
from ffsm_mj.polytope import Polytope
from ffsm_mj.tolerances import MERGED_M, MESH_PRECISION, STRAIGHT

_ON_AXIS = 1e-9
"""A direction within this angle of the axis of a cylinder, in rad, has no radius of curvature around the axis."""
_AXES = np.eye(3)

_TYPE = mujoco.mjtGeom
_PLANE, _SPHERE, _ELLIPSOID = int(_TYPE.mjGEOM_PLANE), int(_TYPE.mjGEOM_SPHERE), int(_TYPE.mjGEOM_ELLIPSOID)
_BOX, _CAPSULE, _CYLINDER, _MESH = map(
    int, (_TYPE.mjGEOM_BOX, _TYPE.mjGEOM_CAPSULE, _TYPE.mjGEOM_CYLINDER, _TYPE.mjGEOM_MESH)
)


@dataclass(frozen=True, eq=False)
class Part:
    """A convex part of a rigid body that is a polytope outside MuJoCo, in double precision.

    Attributes:
        body: Body in whose axes it is.
        polytope: The polytope, m.
        corners: Its vertices, each once and sorted, m, (n, 3).
        centre: Mean of its vertices, m, (3,).
        radius: Greatest distance of its vertices from there, m.
    """

    body: int
    polytope: Polytope
    corners: FloatArray
    centre: FloatArray
    radius: float

    @classmethod
    def of(cls, body: int, polytope: Polytope) -> Part:
        """The part of a body that is a polytope."""
        corners, centre = np.unique(polytope.vertices, axis=0), polytope.vertices.mean(axis=0)
        return cls(body, polytope, corners, centre, float(np.linalg.norm(polytope.vertices - centre, axis=1).max()))


class Shape(PosedGeom):
    """One convex geom at its pose in MuJoCo's data."""

    @cached_property
    def _size(self) -> FloatArray:
        return np.asarray(self._model.geom_size[self._geom])

    @cached_property
    def _rotation(self) -> FloatArray:
        matrix = self._data.geom_xmat[self._geom] if self._part is None else self._data.xmat[self._part.body]
        return np.asarray(matrix.reshape(3, 3))

    @cached_property
    def _position(self) -> FloatArray:
        return np.asarray(self._data.geom_xpos[self._geom] if self._part is None else self._data.xpos[self._part.body])

    def projected(self, points: FloatArray) -> FloatArray:
        """Feet of the perpendiculars from points, (k, 3), to a plane."""
        return np.asarray(points - np.outer((points - self._position) @ self.axis, self.axis))

    @cached_property
    def position_tolerance(self) -> float:
        """Tolerance to which its points are known, m: 0 except for meshes."""
        return position_tolerance(self._model, self._geom) if self._part is None else 0.0

    @cached_property
    def side_radius(self) -> float:
        """Radius of the side of a capsule or cylinder, m; 0 for other geoms."""
        return side_radius(self._model, self._geom)

    def cap(self, direction: FloatArray, tolerance: float) -> tuple[FloatArray, FloatArray, float] | None:
        """Centre, two axes in its plane (2, 3) and radius in m of the cap along a unit vector; None if there is none."""
        if not self.shows_cap(direction, tolerance):
            return None
        axis, (radius, half) = self._rotation[:, 2], self._size[:2].tolist()
        return self._position + np.copysign(half, axis @ direction) * axis, self._rotation.T[:2], radius

    def shows_cap(self, direction: FloatArray, tolerance: float = 0.0) -> bool:
        """Whether it is a cylinder and the unit vector is parallel to its axis; see :meth:`extreme`."""
        if self._kind != _CYLINDER:
            return False
        x, y, _ = (self._rotation.T @ direction).tolist()
        return lies_flat(math.hypot(x, y), float(self._size[0]), tolerance)

    def rim_points(self, direction: FloatArray, places: FloatArray) -> FloatArray:
        """Points at which the sides of a convex polygon, extended, cross the rim of the cap along a direction, (m, 3).

        A corner within the rim lies between two such points, so the hull of these and of the fixed points of the rim
        contains it. For a single corner the line from the centre through it is used.

        Args:
            direction: Unit vector along which the cap faces.
            places: Corners of the polygon, (k, 3), m.
        """
        seen = hull(((places - self._position) @ self._rotation)[:, :2], merge=MERGED_M, straight=STRAIGHT)
        radius, z = float(self._size[0]), float(np.copysign(self._size[1], self._rotation[:, 2] @ direction))
        starts = np.zeros((1, 2)) if len(seen) == 1 else np.roll(seen, 1, axis=0)
        points = [point for sides in zip(starts, seen, strict=True) for point in _on_circle(radius, *sides)]
        rim = np.array([[x, y, z] for x, y in points]).reshape(-1, 3)
        return np.asarray(self._position + rim @ self._rotation.T)

    @property
    def ball(self) -> tuple[FloatArray, float] | None:
        """Centre, (3,), and radius of a sphere, m; None for other geoms."""
        return (self._position, float(self._size[0])) if self._kind == _SPHERE else None

    def edges(self, direction: FloatArray, width: float) -> FloatArray:
        """Directions of straight edges within ``width`` rad of perpendicular to a unit vector, (k, 3); a face has many."""
        local = self._rotation.T @ direction
        if self._kind in (_SPHERE, _ELLIPSOID):
            return np.empty((0, 3))
        if self._kind == _BOX:
            axes = np.eye(3)[np.abs(local) <= width]
        elif self._kind == _CYLINDER and np.hypot(local[0], local[1]) <= width:
            axes = np.eye(3)[:2]
        elif self._kind in (_CAPSULE, _CYLINDER):
            axes = np.eye(3)[2:] if abs(local[2]) <= width else np.empty((0, 3))
        else:
            axes = _directions(self.local_extreme(direction, width))
        return np.asarray(axes @ self._rotation.T)

    def hull_edges(self, direction: FloatArray, width: float) -> FloatArray:
        """The same as :meth:`edges`, but for a mesh all edges of its convex hull, (k, 3); a face has all that bound it."""
        model, mesh = self._model, int(self._model.geom_dataid[self._geom])
        if self._kind != _MESH or self._part is not None or not model.mesh_polynum[mesh]:
            return self.edges(direction, width)
        polygons = slice(int(model.mesh_polyadr[mesh]), int(model.mesh_polyadr[mesh]) + int(model.mesh_polynum[mesh]))
        starts, counts = model.mesh_polyvertadr[polygons], model.mesh_polyvertnum[polygons]
        first, count = int(starts[0]), int(counts.sum())
        following = np.arange(1, count + 1)
        following[starts - first + counts - 1] = starts - first
        corners = model.mesh_polyvert[first : first + count]
        ends = np.unique(np.sort(np.stack((corners, corners[following]), axis=1), axis=1), axis=0)
        first = int(model.mesh_vertadr[mesh])
        vertices = model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])].astype(np.float64)
        heights = vertices @ (self._rotation.T @ direction)
        near = heights >= heights.max() - width * float(model.geom_rbound[self._geom])
        a, b = vertices[ends[near[ends].all(axis=1)]].swapaxes(0, 1)
        return np.asarray((b - a) / np.linalg.norm(b - a, axis=1)[:, None] @ self._rotation.T)

    def radii(self, direction: FloatArray) -> FloatArray:
        """Radii of curvature at the extreme point along a unit vector, a symmetric matrix (3, 3), m; flat directions 0."""
        if self._kind in (_SPHERE, _CAPSULE):
            return np.asarray(self._size[0] * (_AXES - direction[:, None] * direction))
        local = self._rotation.T @ direction
        if self._kind == _ELLIPSOID:
            radii = _ellipsoid_radii(self._size, local)
        elif self._kind == _CYLINDER:
            radii = _cylinder_radii(self._size[0], local)
        else:
            return np.zeros((3, 3))  # vertices and edges of a polytope
        return np.asarray(self._rotation @ radii @ self._rotation.T)


def position_tolerance(model: Any, geom: int) -> float:
    """Tolerance to which the points of a geom are known, m: 0 except for meshes, whose vertices are in single precision."""
    return MESH_PRECISION * float(model.geom_rbound[geom]) if model.geom_type[geom] == _MESH else 0.0


def side_radius(model: Any, geom: int) -> float:
    """Radius of the side of a capsule or cylinder (id), m; 0 for other geoms."""
    return float(model.geom_size[geom, 0]) if model.geom_type[geom] in (_CAPSULE, _CYLINDER) else 0.0


def _on_circle(radius: float, one: FloatArray, other: FloatArray) -> list[FloatArray]:
    """Points at which the line through two points, (2,), crosses a circle around the origin; empty if it misses."""
    (x, y), (u, v) = one.tolist(), (other - one).tolist()
    square, half = u * u + v * v, x * u + y * v
    under = half * half - square * (x * x + y * y - radius * radius)
    if under <= 0.0 or square == 0.0:
        return []
    return [one + (root - half) / square * (other - one) for root in (math.sqrt(under), -math.sqrt(under))]


def _directions(points: FloatArray) -> FloatArray:
    """Directions between a few points; for many (a face of a fine mesh) two directions that span them."""
    spread = points[1:] - points[0]
    if len(spread) > 3:
        return np.asarray(np.linalg.svd(spread, full_matrices=False)[2][:2])
    spans = [b - a for i, a in enumerate(points) for b in points[i + 1 :]]
    return np.array([span / np.linalg.norm(span) for span in spans]).reshape(-1, 3)


def _ellipsoid_radii(size: FloatArray, local: FloatArray) -> FloatArray:
    """Hessian of h = |S n| with the semi-axes S, in the axes of the geom."""
    squared = size**2
    reach = float(np.linalg.norm(size * local))
    return np.asarray((np.diag(squared) - np.outer(squared * local, squared * local) / reach**2) / reach)


def _cylinder_radii(radius: float, local: FloatArray) -> FloatArray:
    """Hessian of h = r |(n_x, n_y)| + l |n_z|, in the axes of the geom: curved around the axis only."""
    radial = float(np.hypot(local[0], local[1]))
    if radial <= _ON_AXIS:
        return np.zeros((3, 3))
    around = np.array([-local[1], local[0], 0.0]) / radial
    return np.asarray(radius / radial * np.outer(around, around))
