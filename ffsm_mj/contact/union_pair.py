"""Contact of two rigid bodies as unions of convex pieces: one constraint, whose normals are decided on the unions.

Apart from each other, the distance of two unions is the least of their pieces, and its normal is one of the unions. Where
they touch, a pair of pieces may touch along a face that another piece covers, as the next box of a floor does. At each
contact point the cells of all pieces that meet there say which normals there are (:mod:`ffsm_mj.contact.cells`), and points
with one normal in one plane are one patch, whose corners are those of its hull: seams leave no trace.

Which pieces belong to the union does not change what a pair of them does while it is apart: event location follows each pair
of pieces by itself, and asks here only where it touches.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.cells import cells, chosen_cell, intersection, nearest_in_cone, separating_normals
from ffsm_mj.contact.normal import NormalSearch, separation
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact.patch import in_plane
from ffsm_mj.contact.probe import PartSearch, Probe
from ffsm_mj.contact.proximity import FAR_M, Proximity, SecondRate
from ffsm_mj.contact.shape import Shape
from ffsm_mj.contact.sides import Piece, Side
from ffsm_mj.hull import hull
from ffsm_mj.model.system import System
from ffsm_mj.tolerances import CONTACT_GAP_M, DISTANCE_QUERY_M, MERGED_M, STRAIGHT

_AT_POINT_M = 2.0 * CONTACT_GAP_M
"""Pieces within this of a contact point meet there: the point is midway of a gap of CONTACT_GAP_M, on faces that the
weld has made one."""
_ONE_NORMAL = 1e-9
"""Unit normals that differ by less are one: those of coplanar faces of one body differ by rounding."""
_ROUND = (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CAPSULE)
_CURVED = tuple(
    map(int, (*_ROUND, mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_ELLIPSOID))
)


@dataclass(frozen=True)
class UnionProximity(Proximity):
    """One patch of a contact of unions: all its points have one normal, and lie in one plane.

    Attributes:
        pieces: Pairs of pieces that touch in it.
        owners: The pair of pieces of each point.
        patch: Name of the patch among those of its pair.
    """

    pieces: tuple[PiecePair, ...]
    owners: tuple[PiecePair, ...]
    patch: str


class PiecePair(ContactPair):
    """Two pieces of a union pair, followed by themselves while they are apart.

    Attributes:
        union: The pair of unions.
        pieces: Pieces of a and b.
    """

    def __init__(self, system: System, union: UnionPair, a: Piece, b: Piece) -> None:
        """Resolve two pieces; see :class:`ContactPair`."""
        self.union, self.pieces = union, (a, b)
        self.parts = a.part, b.part
        super().__init__(system, union.name, a.geom, b.geom, union.restitution, union.mu, rule=union.rule)
        self.position_tolerance = 0.0

    def _normal_search(self) -> NormalSearch:
        if self.parts == (None, None):
            return super()._normal_search()
        self._query_scatters = True  # of single precision
        self.size = min(piece.half_width for piece in self.pieces)
        return PartSearch(self.ids, self.parts, self.size, self.flush_offset, self.union.probe)

    def shapes(self, model: Any, data: Any) -> tuple[Shape, Shape]:
        """Shapes of a and b at the state in ``data``."""
        (a, b), (one, other) = self.ids, self.parts
        return Shape(model, data, a, one), Shape(model, data, b, other)

    def proximity(self, model: Any, data: Any) -> Proximity:
        """Gap, normal, points and rates: those of the unions where both pieces touch."""
        alone = self.alone(model, data)
        return self.union.at_pieces(model, data, self, alone) if abs(alone.gap) <= CONTACT_GAP_M else alone

    def alone(self, model: Any, data: Any) -> Proximity:
        """Gap, normal, points and rates of these two pieces as if there were no others."""
        return super().proximity(model, data)

    @property
    def is_curved(self) -> bool:
        """Whether one of the pieces is round."""
        return any(piece.part is None and piece.kind in _CURVED for piece in self.pieces)


class UnionPair(ContactPair):
    """Contact of the pieces of two rigid bodies under one contact rule.

    Attributes:
        sides: The rigid bodies a and b.
        joined: Pairs of pieces that touch at the start of a step while persistent contact holds the pair: these are
            watched by their contact points, all others by their distance.
    """

    def __init__(
        self,
        system: System,
        name: str,
        sides: tuple[Side, Side],
        geoms: Collection[tuple[int, int]],
        restitution: float,
        mu: float,
        rule: str,
    ) -> None:
        """Resolve the pieces.

        Args:
            system: The system.
            name: Name of the pair.
            sides: The rigid bodies a and b.
            geoms: Ids of the geoms of a and b that the rule pairs.
            restitution: Coefficient of restitution.
            mu: Coefficient of friction.
            rule: Name of the rule.
        """
        self._system, self.sides, self._geoms = system, sides, frozenset(geoms)
        first = min(geoms)
        super().__init__(system, name, *first, restitution, mu, rule=rule)
        self.body_a, self.body_b = (side.body for side in sides)
        chosen = [(a, b) for a in sides[0].pieces for b in sides[1].pieces if (a.geom, b.geom) in self._geoms]
        self._pieces, self._made = chosen, dict[int, PiecePair]()
        self._first, self._second = (np.array([pair[k].number for pair in chosen]) for k in (0, 1))
        self._reach: FloatArray = np.array([a.radius + b.radius for a, b in chosen])
        self.probe = Probe(max(side.most_vertices for side in sides)) if any(s.has_parts for s in sides) else None
        self.joined: frozenset[int] = frozenset()
        self.radii = tuple(side.radius_about(geom) for side, geom in zip(sides, first, strict=True))

    @property
    def geom_pairs(self) -> tuple[frozenset[int], ...]:
        """Ids of both geoms of every two geoms that can touch."""
        return tuple(map(frozenset, sorted(self._geoms)))

    @property
    def is_union(self) -> bool:
        return True
