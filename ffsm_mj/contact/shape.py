"""Support function of a convex geom: extreme points, edges and radii of curvature along a direction, in world axes.

The support function h(n) is the extent of a geom along n. Its gradient is the extreme point, and its Hessian R holds the
radii of curvature there: if the normal turns by dn, the extreme point moves by R dn. R is the radius of a sphere across the
normal, 0 at a vertex, and 0 across an edge. Along an edge and within a face the extreme point is not unique: these flat
directions have no finite radius and are 0 in R. A plane bounds a half-space, whose support function is finite along its
normal only, where every point of it is extreme.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj._core.polygons import hull
from ffsm_mj.arrays import FloatArray
from ffsm_mj.cached_property import cached_property
from ffsm_mj.polytope import Polytope
from ffsm_mj.tolerances import CONTACT_GAP_M, EPSILON, MERGED_M, MESH_PRECISION, PARALLEL, STRAIGHT

_ON_AXIS = 1e-9
"""A direction within this angle of the axis of a cylinder, in rad, has no radius of curvature around the axis."""
_AXES = np.eye(3)
_TINY = 1e-300
"""Divides what is zero only where its quotient does not count."""
_DISC_POINTS = 8
"""Number of fixed points that represent the rim of a cap."""

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


class Shape:
    """One convex geom at its pose in MuJoCo's data."""

    def __init__(self, model: Any, data: Any, geom: int, part: Part | None = None) -> None:
        """Take views of the pose of a geom (id), or of a part of it; kinematics in ``data`` must be current."""
        self._model, self._geom, self._part = model, geom, part
        self._kind = int(model.geom_type[geom]) if part is None else _MESH
        self._size: FloatArray = model.geom_size[geom]
        if part is None:
            self._rotation: FloatArray = data.geom_xmat[geom].reshape(3, 3)
            self._position: FloatArray = data.geom_xpos[geom]
        else:
            self._rotation, self._position = data.xmat[part.body].reshape(3, 3), data.xpos[part.body]

    @property
    def is_plane(self) -> bool:
        """Whether it is a half-space."""
        return self._kind == _PLANE

    @property
    def axis(self) -> FloatArray:
        """Its z axis, world axes, (3,): the outward normal of a plane."""
        return self._rotation[:, 2]

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

    def core(self) -> FloatArray:
        """Ends of the axis of a capsule, the middle of a sphere twice, m, (2, 3)."""
        half = (self._size[1] if self._kind == _CAPSULE else 0.0) * self.axis
        return np.stack((self._position - half, self._position + half))

    def extreme(self, direction: FloatArray, width: float = 0.0, tolerance: float = 0.0) -> FloatArray:
        """All extreme points along a unit vector, (k, 3).

        Edges and faces within ``width`` rad of perpendicular to the vector count with all their corners, and caps of
        cylinders whose whole rim is level within CONTACT_GAP_M and a further ``tolerance`` in m. The origin of a plane
        stands for all of it.
        """
        local, size = self._rotation.T @ direction, self._size
        if self._kind == _SPHERE:
            points = size[0] * local[None]
        elif self._kind == _ELLIPSOID:
            points = (size**2 * local / np.linalg.norm(size * local))[None]
        elif self._kind == _BOX:
            points = np.copysign(size, local)[None]
            for axis, component in enumerate(local.tolist()):
                if abs(component) <= width:
                    other = points.copy()
                    other[:, axis] *= -1.0
                    points = np.concatenate((points, other))
        elif self._kind == _CAPSULE:
            points = np.array([[0.0, 0.0, z] for z in _ends(local[2], size[1], width)]) + size[0] * local
        elif self._kind == _CYLINDER:
            points = _cylinder_points(local, size, width, tolerance)
        elif self._kind == _PLANE:
            points = np.zeros((1, 3))
        else:
            points = self._mesh_points(local, width)
        return np.asarray(self._position + points @ self._rotation.T)

    def extents(self, directions: FloatArray) -> FloatArray:
        """Greatest coordinates of its points along unit vectors, (k, 3), m, (k,); that of a plane is along its normal."""
        local, size = directions @ self._rotation, self._size
        if self._kind == _SPHERE:
            extents = np.full(len(local), size[0])
        elif self._kind == _ELLIPSOID:
            extents = np.linalg.norm(size * local, axis=1)
        elif self._kind == _BOX:
            extents = np.abs(local) @ size
        elif self._kind == _CAPSULE:
            extents = size[0] + size[1] * np.abs(local[:, 2])
        elif self._kind == _CYLINDER:
            extents = size[0] * np.hypot(local[:, 0], local[:, 1]) + size[1] * np.abs(local[:, 2])
        elif self._kind == _PLANE:
            extents = np.where(1.0 - local[:, 2] <= EPSILON, 0.0, math.inf)
        else:
            extents = (self._vertices() @ local.T).max(axis=0)
        return np.asarray(directions @ self._position + extents)

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

    def nearest(self, point: FloatArray) -> tuple[FloatArray, float]:
        """Outward unit normal where the surface of a round geom or box is nearest to a point, (3,), and its height, m.

        A capsule or sphere is a box without width, and a cylinder a box around its axis, each with a radius.
        """
        (x, y, z), (a, b, c) = ((point - self._position) @ self._rotation).tolist(), self._size.tolist()
        if self._kind == _BOX:
            local, height = _over_box((x, y, z), (a, b, c))
        elif self._kind == _CYLINDER:
            radial = math.hypot(x, y)
            (across, along), height = _over_box((radial, z), (a, b))
            # On the axis all directions across it are equal.
            local = (across * x / radial, across * y / radial, along) if radial > 0.0 else (across, 0.0, along)
        else:
            local, height = _over_box((x, y, z), (0.0, 0.0, b if self._kind == _CAPSULE else 0.0))
            height -= a
        return np.asarray(self._rotation @ local), height

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
            axes = _directions(self._mesh_points(local, width))
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
        vertices = self._vertices()
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

    def _mesh_points(self, local: FloatArray, width: float) -> FloatArray:
        vertices = self._vertices()
        heights = vertices @ local
        if self._part is None:
            reach = max(width, MESH_PRECISION) * float(self._model.geom_rbound[self._geom])
        else:
            reach = width * self._part.radius
        reach = reach if width > 0.0 else 0.0
        highest = vertices[heights >= heights.max() - reach]
        return highest if self._part is not None or len(highest) == 1 else np.unique(highest, axis=0)

    def _vertices(self) -> FloatArray:
        """Vertices of the mesh in the axes of the geom or of the body of the part, (n, 3)."""
        if self._part is not None:
            return self._part.corners
        model, mesh = self._model, int(self._model.geom_dataid[self._geom])
        first = int(model.mesh_vertadr[mesh])
        return np.asarray(model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])].astype(np.float64))

    def normals_at(self, point: FloatArray, tolerance: float) -> FloatArray | None:
        """Outward unit normals of the surfaces of a box, plane or round geom that meet at a point, world axes, (k, 3).

        Args:
            point: A point, world axes, m, (3,).
            tolerance: A surface within this of the point, m, is at it.

        Returns:
            Empty if the point is within the geom; None if it is outside by more than the tolerance.
        """
        local, size = (point - self._position) @ self._rotation, self._size
        if self._kind == _BOX:
            normals, depths = np.vstack((np.eye(3), -np.eye(3))), np.concatenate((size - local, size + local))
        elif self._kind in (_SPHERE, _CAPSULE):
            middle = np.array((0.0, 0.0, np.clip(local[2], -size[1], size[1]) if self._kind == _CAPSULE else 0.0))
            normals, depths = _radial(local - middle, size[0])
        elif self._kind == _CYLINDER:
            normals, depths = _radial(local * (1.0, 1.0, 0.0), size[0])
            normals = np.vstack((normals, np.eye(3)[2], -np.eye(3)[2]))
            depths = np.concatenate((depths, (size[1] - local[2], size[1] + local[2])))
        elif self._kind == _PLANE:
            normals, depths = np.eye(3)[2:], -local[2:]
        else:
            # The height over an ellipsoid, to first order in it, is what counts next to its surface.
            gradient = local / size**2
            slope, level = float(np.linalg.norm(gradient)), float(local @ gradient)
            normals, depths = gradient[None] / max(slope, _TINY), np.array([(1.0 - level) / (2.0 * max(slope, _TINY))])
        if (depths < -tolerance).any():
            return None
        return np.asarray(normals[depths <= tolerance] @ self._rotation.T)


def _over_box(point: Sequence[float], half: Sequence[float]) -> tuple[tuple[float, ...], float]:
    """Outward unit normal where a box is nearest to a point, and the height over it, m: negative within the box."""
    beyond = [abs(x) - h for x, h in zip(point, half, strict=True)]
    height = math.hypot(*(max(b, 0.0) for b in beyond))
    if height > 0.0:
        return tuple(math.copysign(max(b, 0.0) / height, x) for b, x in zip(beyond, point, strict=True)), height
    height = max(beyond)
    side = beyond.index(height)  # the nearest face
    return tuple(math.copysign(float(i == side), x) for i, x in enumerate(point)), height


def _radial(offset: FloatArray, radius: float) -> tuple[FloatArray, FloatArray]:
    """Normal of a round surface towards an offset from its middle, (1, 3), and the depth of that point, m, (1,)."""
    length = float(np.linalg.norm(offset))
    return offset[None] / max(length, _TINY), np.array([radius - length])


def position_tolerance(model: Any, geom: int) -> float:
    """Tolerance to which the points of a geom are known, m: 0 except for meshes, whose vertices are in single precision."""
    return MESH_PRECISION * float(model.geom_rbound[geom]) if model.geom_type[geom] == _MESH else 0.0


def side_radius(model: Any, geom: int) -> float:
    """Radius of the side of a capsule or cylinder (id), m; 0 for other geoms."""
    return float(model.geom_size[geom, 0]) if model.geom_type[geom] in (_CAPSULE, _CYLINDER) else 0.0


def lies_flat(sine: float, radius: float, tolerance: float = 0.0) -> bool:
    """Whether a cap is in contact with a face all round its rim, not at the lowest point of it alone.

    Args:
        sine: Sine of the angle between its axis and the normal.
        radius: Its radius, m.
        tolerance: Tolerance to which points of the face are known, m.
    """
    return sine <= PARALLEL and 2.0 * radius * sine <= CONTACT_GAP_M + tolerance


def _ends(component: float, half: float, width: float) -> tuple[float, ...]:
    """Extreme coordinate along one axis; both ends if the direction is perpendicular to it."""
    return (-half, half) if abs(component) <= width else (float(np.copysign(half, component)),)


def _cylinder_points(local: FloatArray, size: FloatArray, width: float, tolerance: float) -> FloatArray:
    """Extreme points of a cylinder, (k, 3): the fixed points of a cap, or one point of a rim, or both ends of the side."""
    radius, half = size[:2].tolist()
    radial = math.hypot(local[0], local[1])
    if radial <= width and lies_flat(radial, radius, tolerance):
        angles = 2.0 * np.pi * np.arange(_DISC_POINTS) / _DISC_POINTS
        rim = np.column_stack((radius * np.cos(angles), radius * np.sin(angles)))
    else:
        rim = radius / radial * local[None, :2]
    return np.array([[x, y, z] for z in _ends(local[2], half, width) for x, y in rim])


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
