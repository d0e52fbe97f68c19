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
from ffsm_mj.contact.shape import Part
from ffsm_mj.contact.solid.polytope import Polytope
from ffsm_mj.contact.solid.solid import Solid
from ffsm_mj.model.system import System

_BOX, _MESH = int(mujoco.mjtGeom.mjGEOM_BOX), int(mujoco.mjtGeom.mjGEOM_MESH)


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
    """

    number: int
    geom: int
    part: Part | None
    kind: int
    centre: FloatArray
    radius: float
    half_width: float


@dataclass(frozen=True, eq=False)
class Side:
    """A rigid body as the union of its pieces.

    Attributes:
        body: Body whose axes are those of the pieces.
        pieces: Its pieces.
        solid: Faces and edges of the union.
    """

    body: int
    pieces: tuple[Piece, ...]
    solid: Solid

    @cached_property
    def centres(self) -> FloatArray:
        """Centres of the spheres around the pieces, axes of the body, m, (n, 3)."""
        return np.array([piece.centre for piece in self.pieces])

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
        self._made: dict[int, Side] = {}

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
        if body not in self._made:
            self._made[body] = self._side(body, self._geoms[body])
        return self._made[body]

    def _side(self, body: int, geoms: Sequence[int]) -> Side:
        model, pieces = self._system.mj, self._system.pieces
        polytopes = [
            (geom, polytope.moved(*_pose_in(model, body, geom)))
            for geom in geoms
            for polytope in _polytopes(model, geom, pieces)
        ]
        solid = Solid([polytope for _, polytope in polytopes], self._weld_m)
        made: list[Piece] = []
        for (geom, before), after in zip(polytopes, solid.polytopes, strict=True):
            # A box that the weld leaves where it is stays a geom: its planes are exact, and its queries MuJoCo's.
            kept = int(model.geom_type[geom]) == _BOX and geom not in pieces and after is before
            part = None if kept else Part.of(body, after)
            lower, upper = after.bounds
            middle = after.vertices.mean(axis=0)
            radius = float(np.linalg.norm(after.vertices - middle, axis=1).max())
            made.append(Piece(len(made), geom, part, int(model.geom_type[geom]), middle, radius, 0.5 * after.width))
        for geom in geoms:
            if not any(geom == one for one, _ in polytopes):
                _, centre = _pose_in(model, body, geom)
                radius, half = float(model.geom_rbound[geom]), float(model.geom_aabb[geom, 3:].min())
                made.append(Piece(len(made), geom, None, int(model.geom_type[geom]), centre, radius, half))
        return Side(body, tuple(made), solid)
