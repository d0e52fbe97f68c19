"""Surfaces of pieces that meet at a contact point of unions: seams, ties, round normals, and faces that go on beside it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

import numpy as np

from ffsm_mj._core.polygons import corners_across
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.cells import intersection, nearest_in_cone
from ffsm_mj.contact.shape import Shape
from ffsm_mj.contact.sides import Piece, Side
from ffsm_mj.tolerances import CONTACT_GAP_M, MERGED_M, PARALLEL

AT_POINT_M = 2.0 * CONTACT_GAP_M
"""Pieces within this of a contact point meet there: the point is midway of a gap of CONTACT_GAP_M, on faces that the
weld has made one."""
ONE_NORMAL = 1e-9
"""Unit normals that differ by less are one: those of coplanar faces of one body differ by rounding."""


class AmongOthers(Shape):
    """A piece of a union at a contact point, with what the pieces next to it add to its face there."""

    def __init__(self, model: Any, data: Any, piece: Piece, there: Sequence[Piece], point: FloatArray, body: int) -> None:
        """Take the pieces that have a point, world axes, on their surface."""
        super().__init__(model, data, piece.geom, piece.part)
        axes = data.xmat[body].reshape(3, 3).T
        self._others = [
            data.xpos[body] + other.polytope.vertices @ axes
            for other in there
            if other is not piece and other.polytope is not None
        ]
        self._point = point

    def extreme(self, direction: FloatArray, width: float = 0.0, tolerance: float = 0.0) -> FloatArray:
        """Extreme points of the piece along a unit vector, and those of pieces beside it that go on there or rise above.

        At a seam a face goes on in the next piece, and where another piece stands on it, it ends at no edge of the union.
        """
        points, level = [super().extreme(direction, width, tolerance)], float(self._point @ direction)
        if width > 0.0:
            heights = [(vertices @ direction - level, vertices) for vertices in self._others]
            points += [vertices[height >= -AT_POINT_M] for height, vertices in heights]
        every = np.concatenate(points)
        return every[corners_across(every, direction)] if len(points) > 1 else every


_Owner = TypeVar("_Owner")
"""A pair of pieces."""


@dataclass(frozen=True)
class Meeting:
    """What meets at a contact point of two unions.

    Attributes:
        point: The point, world axes, (3,), m.
        cells: Sets of normals that a contact may have there, (k, 3) each; see :mod:`ffsm_mj.contact.cells`.
        clauses: Separating normals of each two pieces there; empty if the two that touch have the normal by themselves.
    """

    point: FloatArray
    cells: Sequence[FloatArray]
    clauses: Mapping[tuple[Piece, Piece], FloatArray] = field(default_factory=dict)

    def chooses_with(self, other: Meeting) -> bool:
        """Whether both are of one edge on an edge, or the same: all points of it must have a normal along which they part.

        Decided by themselves, its ends could have two normals, between which points would overlap.
        """
        offset = other.point - self.point
        return len(self.cells) == len(other.cells) and all(
            len(one) == len(two)
            and float(np.abs(one - two).max()) <= ONE_NORMAL
            and float(np.abs(one @ offset).max()) <= AT_POINT_M
            for one, two in zip(self.cells, other.cells, strict=True)
        )


@dataclass
class PointGroup(Generic[_Owner]):
    """Points of one patch, each with its normal and pair of pieces."""

    normals: list[FloatArray] = field(default_factory=list)
    points: list[FloatArray] = field(default_factory=list)
    owners: list[_Owner] = field(default_factory=list)

    def has(self, normal: FloatArray, point: FloatArray) -> bool:
        """Whether a point belongs to it: its normal is parallel, and it is in the plane of the others."""
        first, there = self.normals[0], self.points[0]
        return math.dist(first, normal) <= PARALLEL and abs(float(first @ (there - point))) <= 10.0 * CONTACT_GAP_M

    def add(self, normal: FloatArray, point: FloatArray, owner: _Owner) -> None:
        """Take a point."""
        self.normals.append(normal)
        self.points.append(point)
        self.owners.append(owner)

    def distinct(self) -> list[FloatArray]:
        """Its normals, each once."""
        kept: list[FloatArray] = []
        for normal in self.normals:
            if all(math.dist(normal, other) > MERGED_M for other in kept):
                kept.append(normal)
        return kept


def may_tie(a: Mapping[Piece, FloatArray], b: Mapping[Piece, FloatArray]) -> bool:
    """Whether two single pieces meet by an edge or corner each: if one lies exactly on the other, there is no one normal."""
    polytopes = all(piece.polytope is not None for piece in (*a, *b))
    return polytopes and min((len(normals) for normals in (*a.values(), *b.values())), default=0) > 1


def crosses_seam(
    shapes: tuple[Shape, Shape],
    point: FloatArray,
    normal: FloatArray,
    there: tuple[Mapping[Piece, FloatArray], Mapping[Piece, FloatArray]],
) -> bool:
    """Whether a point is there only because a rim crosses the seam of two faces in one plane: it would share the load."""
    for k, sense in ((0, 1.0), (1, -1.0)):
        outward = sense * normal
        level = [any(math.dist(one, outward) <= ONE_NORMAL for one in normals) for normals in there[k].values()]
        if sum(level) > 1:
            corners = shapes[1 - k].extreme(-outward, PARALLEL, CONTACT_GAP_M)
            return float(np.linalg.norm(corners - point, axis=1).min()) > AT_POINT_M
    return False


def levelled(
    sides: tuple[Side, Side],
    paired: tuple[Piece, Piece],
    normal: FloatArray,
    there: tuple[Mapping[Piece, FloatArray], Mapping[Piece, FloatArray]],
) -> FloatArray | None:
    """The normal of the union that the normal of a round piece is off by rounding; None if it is off by more.

    A sphere that has sunk by rounding meets the edge of the next box before its face, with a normal that is tilted by
    sqrt(2 depth / radius). The normals of a union are the intersection of those of its pieces: there is only the face.
    """
    cone: FloatArray | None = None
    for sense, pieces, side, of_pair in zip((1.0, -1.0), there, sides, paired, strict=True):
        for piece, normals in pieces.items():
            if not piece.is_curved or (piece is not of_pair and not side.are_one_surface(piece, of_pair)):
                cone = sense * normals if cone is None else intersection(cone, sense * normals)
    if cone is None:  # nothing but the round surfaces of both pieces
        return normal
    if not len(cone):
        return None
    level = nearest_in_cone(cone, normal)
    radius = min(piece.radius for piece in paired if piece.is_curved)
    return level if math.dist(level, normal) <= math.sqrt(2.0 * AT_POINT_M / radius) else None
