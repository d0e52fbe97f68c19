"""Rigid bodies as unions of convex pieces: the geoms of a body and of those welded to it, and the parts of its meshes.

Bodies welded together are one rigid body, and so are all bodies of a fixed object. Positions are in the axes of its first
body.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.body_motion import Vector
from ffsm_mj.contact.patch import corners_across
from ffsm_mj.contact.shape import Part
from ffsm_mj.model.system import System
from ffsm_mj.polytope import Polytope, box, hull_of
from ffsm_mj.tolerances import MESH_PRECISION

_BOX, _MESH = int(mujoco.mjtGeom.mjGEOM_BOX), int(mujoco.mjtGeom.mjGEOM_MESH)
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
        centre: Centre of a sphere around it, axes of the body, m, (3,).
        radius: Radius of that sphere, m.
        half_width: Half its thinnest extent, m.
        polytope: It as a polytope, axes of the body; None for round geoms.
    """

    number: int
    geom: int
    part: Part | None
    kind: int
    centre: FloatArray
    radius: float
    half_width: float
    polytope: Polytope | None

    @property
    def is_curved(self) -> bool:
        """Whether it is round."""
        return self.polytope is None


@dataclass(frozen=True, eq=False)
class Side:
    """A rigid body as the union of its pieces.

    Attributes:
        body: Body whose axes are those of the pieces.
        pieces: Its pieces.
    """

    body: int
    pieces: tuple[Piece, ...]

    @cached_property
    def centres(self) -> FloatArray:
        """Centres of the spheres around the pieces, axes of the body, m, (n, 3)."""
        return np.array([piece.centre for piece in self.pieces])

    @cached_property
    def radii(self) -> FloatArray:
        """Radii of these spheres, m, (n,)."""
        return np.array([piece.radius for piece in self.pieces])

    @cached_property
    def most_vertices(self) -> int:
        """Largest number of vertices of a part; 0 without parts."""
        return max((len(piece.part.polytope.vertices) for piece in self.pieces if piece.part is not None), default=0)

    def outline(self, normal: Sequence[float], level: float) -> tuple[tuple[Vector, float], ...]:
        """Sides of the face of the union in a plane, axes of the body; see :class:`.features.cores.Face`."""
        corners = [
            piece.polytope.vertices[list(face)]
            for piece in self.pieces
            if piece.polytope is not None
            for face, n, d in zip(piece.polytope.faces, piece.polytope.normals, piece.polytope.offsets, strict=True)
            if n @ normal > 1.0 - 1e-12 and abs(d - level) <= 1e-9
        ]
        points = np.vstack(corners)
        points = points[corners_across(points, np.array(normal))]
        out = []
        for start, end in zip(points, np.roll(points, -1, axis=0), strict=True):
            inwards = np.cross(normal, end - start)
            inwards /= np.linalg.norm(inwards)
            x, y, z = inwards.tolist()
            out.append(((x, y, z), float(inwards @ start)))
        return tuple(out)

    def radius_about(self, geom: int) -> float:
        """Radius of the sphere around the middle of a geom that contains all pieces, m."""
        middle = next(piece.centre for piece in self.pieces if piece.geom == geom)
        return max(float(np.linalg.norm(piece.centre - middle)) + piece.radius for piece in self.pieces)


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

    def body_of(self, geom: int) -> int:
        """The body that stands for the rigid body of a geom."""
        system, body = self._system, int(self._system.mj.geom_bodyid[geom])
        # All fixed objects are welded to the world: each is a solid of its own, in the axes of its file.
        if body in system.fixed_bodies:
            return next(fixed.root for fixed in system.fixed if body in fixed.bodies)
        return int(system.mj.body_weldid[body])

    def is_union(self, geom: int) -> bool:
        """Whether the rigid body of a geom has pieces that touch each other, or a mesh that is not convex."""
        geoms = self._geoms[self.body_of(geom)]
        if any(one in self._system.pieces for one in geoms):
            return True
        return len(geoms) > 1 and self._touch(geoms)

    def _touch(self, geoms: Sequence[int]) -> bool:
        """Whether some of the geoms of one rigid body touch: their distances are the same in every configuration."""
        model = self._system.mj
        for k, one in enumerate(geoms):
            for other in geoms[:k]:
                reach = float(model.geom_rbound[one] + model.geom_rbound[other]) + self._weld_m
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
        model = self._system.mj
        parts: list[Piece] = []
        for geom in geoms:
            rotation, position = _pose_in(model, body, geom)
            kind = int(model.geom_type[geom])
            for polytope in _polytopes(model, geom, self._system.pieces):
                placed = polytope.moved(position, rotation)
                # A box that stays where it is remains a geom: its planes are exact, and its queries are MuJoCo's.
                part = Part.of(body, placed) if geom in self._system.pieces or kind == _MESH else None
                centre = placed.vertices.mean(axis=0)
                radius = float(np.linalg.norm(placed.vertices - centre, axis=1).max())
                parts.append(Piece(len(parts), geom, part, kind, centre, radius, 0.5 * placed.thickness, placed))
            if not parts or parts[-1].geom != geom:
                radius, half = float(model.geom_rbound[geom]), float(model.geom_aabb[geom, 3:].min())
                parts.append(Piece(len(parts), geom, None, kind, position, radius, half, None))
        return Side(body, tuple(parts))


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
