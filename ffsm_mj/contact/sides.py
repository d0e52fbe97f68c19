"""Rigid bodies as unions of convex pieces: the geoms of a body and of those welded to it, and the parts of its meshes.

Bodies welded together are one rigid body, and so are all bodies of a fixed object. Positions are in the axes of its first
body.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from ffsm_mj._core.boxes import BoxTree
from ffsm_mj._core.gap_bounds import PiecesOfBody
from ffsm_mj._core.polytopes import normals_at
from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.cached_property import cached_property
from ffsm_mj.contact.features.body_motion import Vector
from ffsm_mj.contact.features.cores import Circle, Core, Face, Line, Point, RegionFace
from ffsm_mj.contact.shape import Part, Shape
from ffsm_mj.contact.solid.rods import Ends, Rod, covered_ends
from ffsm_mj.contact.solid.solid import Solid
from ffsm_mj.contact.solid.welding import Plane
from ffsm_mj.model.system import System
from ffsm_mj.polytope import Polytope, box, hull_of
from ffsm_mj.tolerances import FEATURE_BOUND_M, MERGED_M, MESH_PRECISION

_BOX, _MESH = int(mujoco.mjtGeom.mjGEOM_BOX), int(mujoco.mjtGeom.mjGEOM_MESH)
_PLANE = int(mujoco.mjtGeom.mjGEOM_PLANE)
_CAPSULE, _CYLINDER = int(mujoco.mjtGeom.mjGEOM_CAPSULE), int(mujoco.mjtGeom.mjGEOM_CYLINDER)
_FACES = 8
"""Faces of a piece over which heights of points are measured: cells of a partition have few more."""
_TOUCHING_M, _NEAR_M = 1e-6, 1e-3
"""Geoms of one body within the first distance touch each other; the limit of the queries that tell."""


@dataclass(frozen=True, eq=False)
class Piece:
    """A convex piece of a rigid body.

    Attributes:
        number: Place among the pieces of the body.
        geom: Id of the geom that it is, or is a part of.
        part: The part, for pieces of meshes and for boxes that the weld has moved; None for a geom as it is.
        kind: Type of the geom.
        middle: Middle of the geom, axes of the body, m, (3,).
        centre: Centre of a sphere around it, axes of the body, m, (3,).
        radius: Radius of that sphere, m; infinite of a plane.
        core: Start and end of a segment, axes of the body, m, (2, 3): the axis of a long round geom, else the centre twice.
        width: Radius around that segment within which all of it is, m.
        half_width: Half its thinnest extent, m.
        polytope: It as a polytope, axes of the body; None for round geoms and planes.
    """

    number: int
    geom: int
    part: Part | None
    kind: int
    middle: FloatArray
    centre: FloatArray
    radius: float
    core: FloatArray
    width: float
    half_width: float
    polytope: Polytope | None

    @property
    def is_curved(self) -> bool:
        """Whether it is round."""
        return self.polytope is None and self.kind != _PLANE


class Side:
    """A rigid body as the union of its pieces.

    Attributes:
        body: Body whose axes are those of the pieces.
        pieces: Its pieces.
        tree: Boxes around them.
        solid: Those of them that are polytopes; None without any.
    """

    def __init__(
        self,
        body: int,
        pieces: tuple[Piece, ...],
        bounds: FloatArray,
        solid: Solid | None,
        rods: Mapping[int, Ends],
    ) -> None:
        """Take the pieces.

        Args:
            body: Body whose axes are those of the pieces.
            pieces: The pieces.
            bounds: Their boxes, (n, 2, 3), m.
            solid: Those of them that are polytopes; None without any.
            rods: Ends of cylinders and capsules that others continue, by piece.
        """
        self.body, self.pieces, self.tree, self.solid = body, pieces, BoxTree(bounds), solid
        self._rods = rods
        self.centres: FloatArray = np.array([piece.centre for piece in pieces])
        self.radii: FloatArray = np.array([piece.radius for piece in pieces])

    @cached_property
    def _polytopes(self) -> frozenset[int]:
        return frozenset(piece.number for piece in self.pieces if piece.polytope is not None)

    @cached_property
    def most_vertices(self) -> int:
        """Largest number of vertices of a part; 0 without parts."""
        return max((len(piece.part.polytope.vertices) for piece in self.pieces if piece.part is not None), default=0)

    def radius_about(self, geom: int) -> float:
        """Radius of the sphere around the middle of a geom that contains all pieces, m."""
        middle = next(piece.middle for piece in self.pieces if piece.geom == geom)
        return float((np.linalg.norm(self.centres - middle, axis=1) + self.radii).max())

    @cached_property
    def bounding(self) -> PiecesOfBody:
        """Spheres, segments and up to _FACES faces of each piece."""
        normals, offsets = np.zeros((len(self.pieces), _FACES, 3)), np.full((len(self.pieces), _FACES), np.inf)
        for piece in self.pieces:
            if piece.polytope is not None:
                count = min(len(piece.polytope.offsets), _FACES)
                normals[piece.number, :count] = piece.polytope.normals[:count]
                offsets[piece.number, :count] = piece.polytope.offsets[:count]
        cores, widths = (np.array([getattr(piece, name) for piece in self.pieces]) for name in ("core", "width"))
        return PiecesOfBody(self.body, self.centres, self.radii, cores, widths, normals, offsets)

    @cached_property
    def _corners(self) -> tuple[FloatArray, IntArray]:
        """Vertices of all polytopes, the first pieces, axes of the body, m, (v, 3), and where each begins, (n,)."""
        vertices = [piece.polytope.vertices for piece in self.pieces if piece.polytope is not None]
        return np.concatenate(vertices), np.cumsum([0, *map(len, vertices[:-1])])

    def extents(self, model: Any, data: Any, direction: FloatArray) -> FloatArray:
        """Greatest coordinates of the pieces along a unit vector, world axes, m, (n,)."""
        shapes = [Shape(model, data, piece.geom) for piece in self.pieces if piece.polytope is None]
        extents = [shape.extents(direction[None]) for shape in shapes]
        if self.solid is not None:
            corners, starts = self._corners
            heights = corners @ (direction @ data.xmat[self.body].reshape(3, 3)) + direction @ data.xpos[self.body]
            extents.insert(0, np.maximum.reduceat(heights, starts))
        return np.concatenate(extents)

    def at(self, point: FloatArray, reach: float) -> list[Piece]:
        """Pieces whose boxes are within a reach of a point, axes of the body, m; without others the one that there is."""
        if len(self.pieces) == 1:
            return list(self.pieces)
        return [self.pieces[k] for k in self.tree.near(point, point, reach)]

    def local(self, data: Any, point: FloatArray) -> FloatArray:
        """A point of world axes in the axes of the body, m, (3,)."""
        return np.asarray((point - data.xpos[self.body]) @ data.xmat[self.body].reshape(3, 3))

    def surfaces_at(self, model: Any, data: Any, point: FloatArray, reach: float) -> dict[Piece, FloatArray]:
        """Pieces that have a point, world axes, on their surface, within a reach in m, with the normals there."""
        rotation, local, there = data.xmat[self.body].reshape(3, 3), self.local(data, point), {}
        for piece in self.at(local, reach):
            if piece.polytope is None:
                normals = Shape(model, data, piece.geom).normals_at(point, reach)
            elif (normals := normals_at(piece.polytope, local, reach)) is not None:
                normals = normals @ rotation.T
            if normals is not None and piece.number in self._rods:
                normals = normals[[not self.is_covered(piece, normal @ rotation) for normal in normals]]
            if normals is not None and len(normals):
                there[piece] = normals
        return there

    @cached_property
    def _sharing(self) -> dict[Plane, list[int]]:
        """Numbers of the pieces with a face in each plane, looking to the same side."""
        sharing: dict[Plane, list[int]] = {}
        for number, planes in enumerate(self.solid.planes if self.solid is not None else ()):
            for plane in planes:
                sharing.setdefault(plane, []).append(number)
        return sharing

    def on_planes_of(self, piece: Piece, point: FloatArray, reach: float) -> list[int]:
        """Numbers of the pieces with a face in a plane of a piece that passes a point, axes of the body, and its own.

        Args:
            piece: The piece.
            point: The point, m, (3,).
            reach: A plane passes the point within this, m.
        """
        if self.solid is None or piece.polytope is None:
            return [piece.number]
        heights = np.abs(piece.polytope.normals @ point - piece.polytope.offsets)
        planes = (self.solid.planes[piece.number][k] for k in np.flatnonzero(heights <= reach).tolist())
        return sorted({piece.number, *(number for plane in planes for number in self._sharing[plane])})

    def is_covered(self, piece: Piece, normal: FloatArray) -> bool:
        """Whether an outward normal, axes of the body, is that of an end which another cylinder or capsule continues."""
        return piece.number in self._rods and self._rods[piece.number].cover(normal)

    def is_covered_end(self, core: Core, piece: Piece) -> bool:
        """Whether a core of a piece, axes of the body, is such an end: a rim, a cap or a round end."""
        if piece.number not in self._rods or not isinstance(core, Circle | Face | Point):
            return False
        outward = core.axis if isinstance(core, Circle) else core.normal if isinstance(core, Face) else None
        offset = np.array(core.centre) - self._rods[piece.number].rod.centre
        return self.is_covered(piece, offset if outward is None else np.array(outward))

    def are_one_surface(self, piece: Piece, other: Piece) -> bool:
        """Whether two pieces are one round surface: cylinders and capsules end to end."""
        one, two = self._rods.get(piece.number), self._rods.get(other.number)
        return one is not None and two is not None and one.run == two.run

    def face(self, face: Face, piece: Piece, place: Vector, among: frozenset[int]) -> Face:
        """A face of a piece with the outline of that of the union; axes of the body.

        Args:
            face: The face of the piece.
            piece: The piece.
            place: A point on it.
            among: Numbers of the pieces that count.
        """
        if piece.polytope is None:
            return face
        assert self.solid is not None
        k = int(np.argmax(piece.polytope.normals @ face.normal))
        united = self.solid.faces_of(among & self._polytopes).at(self.solid.planes[piece.number][k])
        region = max(united, key=lambda one: one.inside(np.array(place)))
        x, y, z = (region.offset * region.normal).tolist()
        a, b, c = region.normal.tolist()
        if region.sides:
            return replace(face, centre=(x, y, z), normal=(a, b, c), sides=region.sides)
        return RegionFace(face.name, face.body, (x, y, z), (a, b, c), (), region=region)

    def edge(self, line: Line, piece: Piece, place: Vector) -> Line | None:
        """An edge of a piece, or a round side, as far as it is one of the union, None: it is none; axes of the body.

        Args:
            line: The edge of the piece.
            piece: The piece.
            place: A point on it: where other pieces meet the edge, several edges of the union are on its line.
        """
        if line.radius > 0.0 and piece.number in self._rods:
            return _along(line, self._rods[piece.number].whole)
        if piece.polytope is None or line.radius > 0.0:
            return line
        assert self.solid is not None
        for edge in self.solid.edges.of(piece.number):
            offset = np.array(line.centre) - edge.start
            apart = float(np.linalg.norm(offset - float(offset @ edge.direction) * edge.direction))
            along = float((np.array(place) - edge.start) @ edge.direction)
            length = float((edge.end - edge.start) @ edge.direction)
            # A contact point may be beyond the end of its edge by the bound of features.
            if apart <= self.solid.tolerance and -FEATURE_BOUND_M <= along <= length + FEATURE_BOUND_M:
                x, y, z = (edge.start + 0.5 * length * edge.direction).tolist()
                sense = math.copysign(1.0, float(edge.direction @ line.direction))
                a, b, c = (sense * edge.direction).tolist()
                wedge = tuple((u, v, w) for u, v, w in edge.into.tolist()) if line.wedge else ()
                cone = np.array(wedge).reshape(-1, 3)
                ends = tuple(
                    Point("vertex", line.body, _vector(place), 0.0, cone) for place in (edge.start, edge.end)[:: int(sense)]
                )
                centre, direction = (x, y, z), (a, b, c)
                return replace(line, centre=centre, direction=direction, half=0.5 * length, wedge=wedge, ends=ends)
        return None


def _along(line: Line, rod: Rod) -> Line:
    """A round side as that of a whole rod, with rims at the ends of it."""
    sense = math.copysign(1.0, float(np.array(line.direction) @ rod.axis))
    axis = sense * rod.axis
    outward = (sorted(line.ends, key=lambda end: float(np.array(end.centre) @ axis)), (-1.0, 1.0))
    ends = tuple(replace(end, centre=_vector(rod.centre + s * rod.half * axis)) for end, s in zip(*outward, strict=True))
    return replace(line, centre=_vector(rod.centre), direction=_vector(axis), half=rod.half, ends=ends)


def _vector(array: FloatArray) -> Vector:
    x, y, z = array.tolist()
    return x, y, z


class Sides:
    """The rigid bodies of a system, each made once."""

    def __init__(self, system: System, geoms: Iterable[int], weld_m: float) -> None:
        """Group geoms by the rigid bodies that they are on.

        Args:
            system: The system.
            geoms: Ids of the geoms that can be in contact.
            weld_m: Faces of one body that are coplanar within this are one, m.
        """
        self._system, self._weld_m = system, weld_m
        self._geoms: dict[int, list[int]] = {}
        for geom in sorted(geoms):
            self._geoms.setdefault(self.body_of(geom), []).append(geom)
        self._known: dict[int, Side] = {}
        self._united: dict[int, bool] = {}

    def body_of(self, geom: int) -> int:
        """The body that stands for the rigid body of a geom."""
        system, body = self._system, int(self._system.mj.geom_bodyid[geom])
        # All fixed objects are welded to the world: each is a solid of its own, in the axes of its file.
        if body in system.fixed_bodies:
            return next(fixed.root for fixed in system.fixed if body in fixed.bodies)
        return int(system.mj.body_weldid[body])

    def is_union(self, geom: int) -> bool:
        """Whether the rigid body of a geom has pieces that touch each other, or a mesh that is not convex."""
        body = self.body_of(geom)
        if body not in self._united:  # each pair of geoms asks
            geoms = self._geoms[body]
            self._united[body] = any(one in self._system.pieces for one in geoms) or self._touch(geoms)
        return self._united[body]

    def _touch(self, geoms: Sequence[int]) -> bool:
        """Whether some of the geoms of one rigid body touch: their distances are the same in every configuration."""
        model = self._system.mj
        for k, one in enumerate(geoms):
            for other in geoms[:k]:
                reach = _radius(model, one) + _radius(model, other) + self._weld_m
                near = np.linalg.norm(self._at_rest.geom_xpos[one] - self._at_rest.geom_xpos[other]) <= reach
                if near and mujoco.mj_geomDistance(model, self._at_rest, one, other, _NEAR_M, None) <= _TOUCHING_M:
                    return True
        return False

    @cached_property
    def _at_rest(self) -> Any:
        data = mujoco.MjData(self._system.mj)
        mujoco.mj_kinematics(self._system.mj, data)
        return data

    def of(self, geom: int) -> Side:
        """The rigid body of a geom."""
        body = self.body_of(geom)
        if body not in self._known:
            self._known[body] = self._side(body, self._geoms[body])
        return self._known[body]

    def _side(self, body: int, geoms: Sequence[int]) -> Side:
        model, pieces = self._system.mj, self._system.pieces
        poses = {geom: _pose_in(model, body, geom) for geom in geoms}
        # Polytopes first: their numbers are those of the welded pieces.
        sources = [geom for geom in geoms for _ in range(_count(model, geom, pieces))]
        polytopes = [
            polytope.moved(position, rotation)
            for geom, (rotation, position) in poses.items()
            for polytope in _polytopes(model, geom, pieces)
        ]
        solid = Solid(polytopes, self._weld_m, sources) if polytopes else None
        parts: list[Piece] = []
        for geom, before, after in zip(sources, polytopes, solid.pieces if solid else (), strict=True):
            parts.append(self._polytope(body, geom, poses[geom][1], len(parts), before, after))
        bounds = [piece.polytope.bounds for piece in parts if piece.polytope is not None]
        for geom, pose in poses.items():
            if geom not in sources:
                piece, box_around = _whole(model, geom, pose, len(parts))
                parts.append(piece)
                bounds.append(box_around)
        return Side(body, tuple(parts), np.array(bounds), solid, self._rods(parts, poses))

    def _rods(self, parts: Sequence[Piece], poses: Mapping[int, tuple[FloatArray, FloatArray]]) -> dict[int, Ends]:
        """Ends of cylinders and capsules that others continue, by piece; of those alone that have any."""
        sizes, rods = self._system.mj.geom_size, dict[int, Rod]()
        for piece in parts:
            if piece.kind in (_CYLINDER, _CAPSULE):
                rotation, position = poses[piece.geom]
                radius, half = sizes[piece.geom, :2].tolist()
                rods[piece.number] = Rod(position, rotation[:, 2], half, radius)
        ends = covered_ends(list(rods.values()), max(self._weld_m, MERGED_M))
        return {number: end for number, end in zip(rods, ends, strict=True) if end.senses}

    def _polytope(self, body: int, geom: int, middle: FloatArray, number: int, before: Polytope, after: Polytope) -> Piece:
        kind = int(self._system.mj.geom_type[geom])
        # A box that stays where it is remains a geom: its planes are exact, and its queries are MuJoCo's.
        stays = kind == _BOX and float(np.abs(after.vertices - before.vertices).max()) <= MERGED_M
        part = None if stays else Part.of(body, after)
        centre = after.vertices.mean(axis=0)
        radius = float(np.linalg.norm(after.vertices - centre, axis=1).max())
        core = np.stack((centre, centre))
        return Piece(number, geom, part, kind, middle, centre, radius, core, radius, 0.5 * after.thickness, after)


def _radius(model: Any, geom: int) -> float:
    """Radius of the sphere around a geom, m; MuJoCo says 0 of a plane, which has none."""
    return math.inf if model.geom_type[geom] == _PLANE else float(model.geom_rbound[geom])


def _whole(model: Any, geom: int, pose: tuple[FloatArray, FloatArray], number: int) -> tuple[Piece, FloatArray]:
    """A round geom or a plane as a piece, by its pose in the axes of the body, and a box around it there, (2, 3), m."""
    (rotation, position), kind, size = pose, int(model.geom_type[geom]), model.geom_size[geom]
    radius, half, long = _radius(model, geom), model.geom_aabb[geom, 3:], kind in (_CYLINDER, _CAPSULE)
    if kind == _PLANE:  # 1e10 m all round: its own box ends at the plane, to the rounding of such numbers
        middle, reach = position, np.full(3, half.max())
    else:
        middle, reach = position + rotation @ model.geom_aabb[geom, :3], np.abs(rotation) @ half
    core = position + np.outer((-size[1], size[1]) if long else (0.0, 0.0), rotation[:, 2])
    width = float(size[0]) if long else radius
    piece = Piece(number, geom, None, kind, position, position, radius, core, width, float(half.min()), None)
    return piece, np.stack((middle - reach, middle + reach))


def _count(model: Any, geom: int, pieces: Mapping[int, tuple[Polytope, ...]]) -> int:
    """Number of polytopes of a geom."""
    return len(pieces[geom]) if geom in pieces else int(model.geom_type[geom] in (_BOX, _MESH))


def _polytopes(model: Any, geom: int, pieces: Mapping[int, tuple[Polytope, ...]]) -> tuple[Polytope, ...]:
    """Polytopes of a geom in its axes: its pieces, or itself; none for a round geom."""
    if geom in pieces:
        return pieces[geom]
    if model.geom_type[geom] == _BOX:
        return (box(model.geom_size[geom], np.zeros(3), np.eye(3)),)
    if model.geom_type[geom] == _MESH:
        mesh = int(model.geom_dataid[geom])
        first = int(model.mesh_vertadr[mesh])
        vertices = model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])].astype(np.float64)
        return (hull_of(vertices, MESH_PRECISION * float(model.geom_rbound[geom])),)
    return ()


def _pose_in(model: Any, body: int, geom: int) -> tuple[FloatArray, FloatArray]:
    """Rotation and position of a geom in the axes of a body that it does not move against."""
    rotation, position = _matrix(model.geom_quat[geom]), np.array(model.geom_pos[geom])
    at = int(model.geom_bodyid[geom])
    while at != body:
        turn = _matrix(model.body_quat[at])
        rotation, position = turn @ rotation, turn @ position + model.body_pos[at]
        at = int(model.body_parentid[at])
    return rotation, position


def _matrix(quaternion: FloatArray) -> FloatArray:
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)
