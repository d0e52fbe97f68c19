"""Convex edges of a union: where the pieces around an edge of one of them leave less than a half-space of solid.

Every convex edge of a union lies on edges of its pieces. Such an edge is cut where planes of neighbours cross it; between
two cuts the pieces around it are sectors of angles, the same all along. Together they fill the full angle (the edge is
covered), half of it (it is within a face), more (a concave edge) or less: this alone is an edge that others can touch.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ffsm_mj._core.boxes import BoxTree
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.solid.welding import Plane, Welded
from ffsm_mj.dynamics.rigid_body import cross

_ANGLE = 1e-9
"""Angles within this, in rad, are equal: above the rounding of normals, and 1 nm over 1 m."""
_SHORTEST = 10.0
"""Parts of an edge shorter than this many tolerances are none: they come of cuts that differ by residuals of welding."""
_TURN = 2.0 * math.pi

Planes = tuple[Plane, Plane]
"""The two faces at an edge, in ascending order."""


@dataclass(frozen=True, eq=False)
class UnionEdge:
    """A convex edge of a union, across all pieces that it runs along.

    Attributes:
        planes: Its two faces, in ascending order.
        start: Its beginning, (3,), m.
        end: Its end, (3,), m.
        direction: Unit vector from start to end, computed from the two planes alone, (3,).
        into: Unit vectors perpendicular to it into the two faces, (2, 3).
        pieces: Pieces that it runs along.
    """

    planes: Planes
    start: FloatArray
    end: FloatArray
    direction: FloatArray
    into: FloatArray
    pieces: tuple[int, ...]


@dataclass(frozen=True)
class Sector:
    """Angles around an edge that are filled with solid, counter-clockwise from one face to another.

    Attributes:
        start: Angle of the first face, rad.
        width: Angle from there to the last face, rad: a full turn where there is no face.
        first: The first face.
        last: The last face.
    """

    start: float
    width: float
    first: Plane
    last: Plane

    @property
    def convex(self) -> bool:
        """Whether it is less than a half-space."""
        return self.width < math.pi - _ANGLE and self.first != self.last


@dataclass(frozen=True, eq=False)
class _Part:
    """A part of an edge of one piece that is a convex edge of the union."""

    piece: int
    planes: Planes
    start: FloatArray
    end: FloatArray


class UnionEdges:
    """The convex edges of a union, evaluated piece by piece when they are asked for."""

    def __init__(self, welded: Welded, tree: BoxTree, tolerance: float) -> None:
        """Take the pieces of a solid.

        Args:
            welded: The pieces.
            tree: Tree of their boxes.
            tolerance: Distance within which a point is on a plane, m.
        """
        self._welded, self._tree, self._tolerance = welded, tree, tolerance
        self._parts: dict[int, tuple[_Part, ...]] = {}
        self._edges: dict[tuple[int, Planes], tuple[UnionEdge, ...]] = {}

    def of(self, piece: int) -> tuple[UnionEdge, ...]:
        """The edges of the union along a piece: the same objects for all pieces along them."""
        edges: list[UnionEdge] = []
        for planes in dict.fromkeys(part.planes for part in self._of_piece(piece)):
            if (piece, planes) not in self._edges:
                self._join(piece, planes)
            edges += self._edges[piece, planes]
        return tuple(edges)

    def _join(self, piece: int, planes: Planes) -> None:
        """Join the parts of edges between two planes, from a piece to those at its ends and so on."""
        parts, waiting, seen = list[_Part](), [piece], {piece}
        for k in waiting:  # grows meanwhile
            along = [part for part in self._of_piece(k) if part.planes == planes]
            parts += along
            for end in (end for part in along for end in (part.start, part.end)):
                adjacent = set(self._tree.near(end, end, self._tolerance)) - seen
                seen |= adjacent
                waiting += adjacent
        direction, into = self._frame(planes)
        edges = []
        for group in _joined(parts, direction, _SHORTEST * self._tolerance):
            last = max(group, key=lambda part: float(part.end @ direction))
            pieces = tuple(sorted({part.piece for part in group}))
            edges.append(UnionEdge(planes, group[0].start, last.end, direction, into, pieces))
        for k in {part.piece for part in parts}:
            self._edges[k, planes] = tuple(edge for edge in edges if k in edge.pieces)

    def _frame(self, planes: Planes) -> tuple[FloatArray, FloatArray]:
        """Direction of the line of two planes, (3,), and the unit vectors into their faces, (2, 3)."""
        one, other = (sense * self._welded.normals[plane] for plane, sense in planes)
        direction = cross(other, one)
        direction /= np.linalg.norm(direction)
        return direction, np.stack((cross(direction, one), cross(other, direction)))

    def _of_piece(self, piece: int) -> tuple[_Part, ...]:
        if piece not in self._parts:
            self._parts[piece] = tuple(self._convex_parts(piece))
        return self._parts[piece]

    def _convex_parts(self, piece: int) -> Iterator[_Part]:
        """Those parts of the edges of a piece that are convex edges of the union."""
        solid, planes = self._welded.pieces[piece], self._welded.planes[piece]
        tolerance = max(self._tolerance, self._welded.flaws[piece])
        near = self._tree.near(solid.bounds[0], solid.bounds[1], tolerance)
        around = Surroundings(self._welded, near, tolerance)
        heights = solid.vertices @ around.normals.T - around.offsets
        for a, b, left, right in solid.edges:
            if planes[left] == planes[right]:  # welded into one plane
                continue
            start, end = solid.vertices[a], solid.vertices[b]
            length = float(np.linalg.norm(end - start))
            cuts = [0.0, *around.cuts(heights[a], heights[b]), 1.0]
            for low, high in pairwise(cuts):
                if (high - low) * length <= _SHORTEST * self._tolerance:
                    continue
                ends = [(1.0 - t) * heights[a] + t * heights[b] for t in (low, high)]
                for sector in around.sectors((end - start) / length, *ends):
                    if sector.convex:
                        # The ends of the edge stay as they are, bit for bit.
                        places = [start if t == 0.0 else end if t == 1.0 else start + t * (end - start) for t in (low, high)]
                        one, other = sorted((sector.first, sector.last))
                        yield _Part(piece, (one, other), *places)


class Surroundings:
    """Some pieces of a solid that are near each other, with all their planes as rows of arrays.

    Attributes:
        normals: Outward normals of all faces, (k, 3).
        offsets: Their offsets, (k,), m.
    """

    def __init__(self, welded: Welded, pieces: Sequence[int], tolerance: float) -> None:
        """Gather the planes.

        Args:
            welded: All pieces of the solid.
            pieces: Indices of those that are near, not empty.
            tolerance: Distance within which a point is on a plane, m.
        """
        near = [welded.pieces[k] for k in pieces]
        self.normals = np.concatenate([piece.normals for piece in near])
        self.offsets = np.concatenate([piece.offsets for piece in near])
        self._planes = [plane for k in pieces for plane in welded.planes[k]]
        counts = [len(piece.offsets) for piece in near]
        self._starts = np.cumsum([0, *counts[:-1]])
        self._owner = np.repeat(np.arange(len(counts)), counts)
        # Corners of a piece are this far off its own planes, and thus off those that it shares with others.
        self._tolerances = np.maximum(tolerance, np.array(welded.flaws)[pieces])[self._owner]

    def cuts(self, start: FloatArray, end: FloatArray) -> list[float]:
        """Where a segment crosses planes of the pieces on their surface, ascending, as shares of its length.

        Args:
            start: Heights of its start above all planes, (k,).
            end: Those of its end.
        """
        crossing = np.flatnonzero((np.minimum(start, end) < 0.0) & (np.maximum(start, end) > 0.0))
        shares = start[crossing] / (start[crossing] - end[crossing])
        highest = np.maximum.reduceat(start + shares[:, None] * (end - start), self._starts, axis=1)
        on_surface = highest[np.arange(len(crossing)), self._owner[crossing]] <= self._tolerances[crossing]
        return sorted(set(shares[on_surface].tolist()))

    def sectors(self, direction: FloatArray, start: FloatArray, end: FloatArray) -> list[Sector]:
        """Union of the sectors that the pieces fill around a segment which none of their planes crosses.

        Args:
            direction: Unit vector along it, (3,): angles are counter-clockwise about it.
            start: Heights of its start above all planes, (k,).
            end: Those of its end.
        """
        along = (np.abs(start) <= self._tolerances) & (np.abs(end) <= self._tolerances)
        # No plane crosses it: what is above a plane that it is not along is above it in the middle.
        highest = np.maximum.reduceat(np.where(along, -np.inf, 0.5 * (start + end)), self._starts)
        touching = (highest < 0.0) & (np.logical_or.reduceat(along, self._starts))
        if ((highest < 0.0) & ~touching).any():  # strictly inside a piece
            return []
        e = cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
        e /= np.linalg.norm(e)
        f = cross(direction, e)
        sectors: dict[int, Sector | None] = {}
        for row in np.flatnonzero(along & touching[self._owner]).tolist():
            angle = math.atan2(float(self.normals[row] @ f), float(self.normals[row] @ e))
            half = Sector((angle + 0.5 * math.pi) % _TURN, math.pi, self._planes[row], self._planes[row])
            owner = int(self._owner[row])
            sectors[owner] = _common(sectors[owner], half) if owner in sectors else half
        return united([sector for sector in sectors.values() if sector])


def _common(one: Sector | None, half: Sector) -> Sector | None:
    """Intersection of a sector of at most half a turn with one of half a turn; None if they touch at most."""
    if one is None:
        return None
    ahead = _between(one.start, half.start)
    if ahead <= 0.0:
        width = min(one.width, ahead + math.pi)
        last = half.last if ahead + math.pi < one.width - _ANGLE else one.last
        common = Sector(one.start, width, one.first, last)
    else:
        first = half.first if ahead > _ANGLE else one.first
        common = Sector(half.start, one.width - ahead, first, one.last)
    return common if common.width > _ANGLE else None


def united(sectors: Sequence[Sector]) -> list[Sector]:
    """Union of sectors: disjoint ones, none where it is a full turn."""
    ordered = sorted(sectors, key=lambda sector: (sector.start, -sector.width, sector.first))
    union = []
    for k, sector in enumerate(ordered):
        if any(_continues(other, sector, earlier=i < k) for i, other in enumerate(ordered) if i != k):
            continue
        # It is grown from its start, which no other sector contains, over all that begin before its end.
        grown = sector
        while longer := [other for other in ordered if _reach(grown, other) > grown.width + _ANGLE]:
            farthest = max(longer, key=lambda other: _reach(grown, other))
            grown = Sector(grown.start, _reach(grown, farthest), grown.first, farthest.last)
        union.append(grown)
    return union


def _continues(one: Sector, other: Sector, *, earlier: bool) -> bool:
    """Whether the start of another sector is in a sector or at its end, or at its start and this one comes first."""
    ahead = _between(one.start, other.start)
    if abs(ahead) <= _ANGLE:
        return earlier
    return ahead % _TURN <= one.width + _ANGLE


def _reach(one: Sector, other: Sector) -> float:
    """Angle from the start of a sector to the end of another that begins in it or at its end; 0 if it does not."""
    ahead = _between(one.start, other.start)
    ahead = max(ahead, 0.0) if abs(ahead) <= _ANGLE else ahead % _TURN
    return ahead + other.width if ahead <= one.width + _ANGLE else 0.0


def _between(one: float, other: float) -> float:
    """Angle from one direction to another, in [-pi, pi]."""
    return math.remainder(other - one, _TURN)


def _joined(parts: Sequence[_Part], direction: FloatArray, gap: float) -> list[list[_Part]]:
    """Groups of connected parts of one line, turned to its direction and in order; gaps in m up to a width are closed."""
    turned = [
        replace(part, start=part.end, end=part.start) if (part.end - part.start) @ direction < 0.0 else part
        for part in parts
    ]
    groups: list[list[_Part]] = []
    reached = -math.inf
    for part in sorted(turned, key=lambda part: (float(part.start @ direction), part.piece)):
        if part.start @ direction > reached + gap:
            groups.append([])
        groups[-1].append(part)
        reached = max(reached, float(part.end @ direction))
    return groups
