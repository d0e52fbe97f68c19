"""Planes that the faces of several pieces share: coplanar faces of one solid have one plane, bit for bit, in either sense.

Pieces that were written or decomposed apart from each other are off by rounding: a face that is 1e-16 m proud of its
neighbour has an edge, which tilts the normal of a sphere on it by 4.5e-8. Welding moves such faces onto one plane, that of
the largest, and their vertices with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.polytope import Polytope, area_vector
from ffsm_mj.tolerances import EPSILON

_COPLANAR_COSINE = 0.99
"""Least cosine between normals of coplanar faces. A sliver does not know its normal any better: its vertices decide."""
_ROUNDING = 64.0 * EPSILON
"""Planes that are one in the file differ by less than this share of the coordinates, after a few changes of axes."""
_NEAR_MISS = 10.0
"""Faces that are apart by more than the tolerance, but less than this many times, look like a missed weld."""
_LEAST_THICKNESS = 10.0
"""Least thickness of a piece over the tolerance: opposite faces that share a plane would leave no solid between them."""
_ASKEW = np.array((0.5377, 0.6284, 0.5621))
"""A direction that is not parallel to the faces of machined parts, to tell both senses of a plane apart."""
_MOST_NUMBERS = 2_000_000
"""Size of the arrays in which faces are compared with planes."""
_INDEPENDENT = 1e-4
"""Planes at smaller angles, in rad, do not fix a vertex along their line: it moves across it only."""


Plane = tuple[int, int]
"""Index of a plane of a solid, and the sense in which a face looks: 1 along its normal, -1 against it."""


class TooThinError(ValueError):
    """A welding tolerance above a tenth of the thickness of a piece.

    Attributes:
        source: What the piece comes from.
        sentence: The rest of a sentence that begins with its name.
    """

    def __init__(self, weld_m: float, thickness_m: float, source: int) -> None:
        self.source = source
        self.sentence = (
            f"is {thickness_m:g} m thick: a welding tolerance of {weld_m:g} m is more than a tenth of this, "
            f"at most {thickness_m / _LEAST_THICKNESS:g} m is allowed"
        )
        super().__init__(f"a piece of source {source} {self.sentence}")


@dataclass(frozen=True)
class Step:
    """Two faces that are nearly coplanar and adjacent, but farther apart than the welding tolerance.

    Attributes:
        pieces: Indices of the two pieces.
        height_m: Greatest distance of a corner of one face from the plane of the other, m.
        crack: Whether the faces look towards each other, so that a crack or an overlap is between the pieces.
    """

    pieces: tuple[int, int]
    height_m: float
    crack: bool


@dataclass(frozen=True)
class WeldReport:
    """What welding merged and moved.

    Attributes:
        merged: Number of faces that have the plane of a larger face of another piece.
        greatest_move_m: Greatest move of a vertex, m.
        residual_m: Greatest distance of a moved vertex from one of its planes, m: of those on more than three planes.
        steps: What looks like a missed weld.
    """

    merged: int
    greatest_move_m: float
    residual_m: float
    steps: tuple[Step, ...]

    def __str__(self) -> str:
        """One line for people."""
        moved = f", greatest move {self.greatest_move_m:.1e} m" if self.greatest_move_m else ""
        residual = f", residual {self.residual_m:.1e} m" if self.residual_m else ""
        shared = "1 face shares" if self.merged == 1 else f"{self.merged} faces share"
        return f"{shared} the plane of a larger one{moved}{residual}"


@dataclass(frozen=True, eq=False)
class Welded:
    """The pieces of a solid on common planes.

    Attributes:
        pieces: The pieces with their vertices moved; the planes of their faces are those of ``normals`` and ``offsets``.
        normals: Normals of the planes, (p, 3).
        offsets: Their offsets, (p,), m.
        planes: Plane of each face of each piece.
        flaws: Greatest distances of corners of each piece from planes of its faces, m: of meshes in single precision, and
            residuals.
        report: What was merged and moved.
    """

    pieces: tuple[Polytope, ...]
    normals: FloatArray
    offsets: FloatArray
    planes: tuple[tuple[Plane, ...], ...]
    flaws: tuple[float, ...]
    report: WeldReport


def weld(pieces: Sequence[Polytope], weld_m: float, sources: Sequence[int] | None = None) -> Welded:
    """Bring coplanar faces of the pieces of one solid onto common planes.

    Args:
        pieces: The pieces, all in the same axes.
        weld_m: Welding tolerance, m.
        sources: What the pieces come from. Pieces of one source, such as an exact partition of a mesh, share planes up to
            rounding already and are not welded to each other. By default every piece has a source of its own.

    Raises:
        TooThinError: The tolerance exceeds a tenth of the thickness of a piece.
    """
    sources = range(len(pieces)) if sources is None else sources
    if len(set(sources)) > 1:
        _refuse_thin(pieces, sources, weld_m)
    faces = _Faces(pieces, sources, weld_m)
    planes, senses, leaders = faces.assigned(weld_m)
    normals, offsets = faces.normals[leaders], faces.offsets[leaders]
    merged = int((faces.piece != faces.piece[leaders][planes]).sum())
    bounds = np.cumsum([0, *(len(piece.faces) for piece in pieces)]).tolist()
    moved, moves, residuals, flaws = [], [0.0], [0.0], faces.flaws()
    for k, (piece, (first, last)) in enumerate(zip(pieces, pairwise(bounds), strict=True)):
        new_normals = senses[first:last, None] * normals[planes[first:last]] + 0.0
        new_offsets = senses[first:last] * offsets[planes[first:last]] + 0.0
        vertices = piece.vertices
        if faces.differ(piece, new_normals, new_offsets):
            vertices, move, residual = _onto_planes(piece, new_normals, new_offsets, faces.rounding)
            moves.append(move)
            residuals.append(residual)
            flaws[k] = residual
        moved.append(Polytope(vertices, new_normals, new_offsets, piece.faces))
    report = WeldReport(merged, max(moves), max(residuals), faces.steps(planes, weld_m))
    pairs = [*zip(planes.tolist(), senses.tolist(), strict=True)]
    of_pieces = tuple(tuple(pairs[first:last]) for first, last in pairwise(bounds))
    return Welded(tuple(moved), normals, offsets, of_pieces, tuple(flaws), report)


def _refuse_thin(pieces: Sequence[Polytope], sources: Sequence[int], weld_m: float) -> None:
    thickness, index = min((piece.thickness, i) for i, piece in enumerate(pieces))
    if weld_m * _LEAST_THICKNESS > thickness:
        raise TooThinError(weld_m, thickness, sources[index])


class _Near(NamedTuple):
    """Faces near a plane, (k,), and the greatest distances of their corners from it, (k,), m."""

    faces: IntArray
    heights: FloatArray


class _Faces:
    """All faces of some pieces as arrays."""

    def __init__(self, pieces: Sequence[Polytope], sources: Sequence[int], weld_m: float) -> None:
        self.normals = np.concatenate([piece.normals for piece in pieces])
        self.offsets = np.concatenate([piece.offsets for piece in pieces])
        counts = [len(piece.faces) for piece in pieces]
        self.piece: IntArray = np.repeat(np.arange(len(pieces)), counts)
        self._source: IntArray = np.repeat(np.asarray(sources, dtype=np.intp), counts)
        polygons = [piece.vertices[list(face)] for piece in pieces for face in piece.faces]
        self._corners = np.concatenate(polygons)
        self._starts = np.cumsum([0, *map(len, polygons)])
        self._lower = np.minimum.reduceat(self._corners, self._starts[:-1])
        self._upper = np.maximum.reduceat(self._corners, self._starts[:-1])
        areas = np.array([np.linalg.norm(area_vector(polygon)) for polygon in polygons])
        # The largest face leads, and the order of equal ones is that of their planes: not that of the pieces.
        self._order: list[int] = np.lexsort((*self.normals.T, self.offsets, -areas)).tolist()
        self._extent = max(1.0, float(np.abs(self._corners).max()))
        self.rounding = _ROUNDING * self._extent
        self._groups = self._equal_planes()
        self._near = self._foreign(_NEAR_MISS * weld_m)

    def assigned(self, weld_m: float) -> tuple[IntArray, IntArray, IntArray]:
        """Plane of each face, (F,), its sense, (F,), and the faces that lead the planes, (p,)."""
        planes = np.full(len(self.offsets), -1)
        leaders: list[int] = []
        for leader in self._order:
            if planes[leader] < 0:
                near = self._near[self._group[leader]]
                faces = np.concatenate((self._groups[self._group[leader]], near.faces[near.heights <= weld_m]))
                planes[faces[planes[faces] < 0]] = len(leaders)
                leaders.append(leader)
        cosines = np.einsum("ij,ij->i", self.normals, self.normals[np.array(leaders)[planes]])
        return planes, np.sign(cosines).astype(np.intp), np.array(leaders)

    def steps(self, planes: IntArray, weld_m: float) -> tuple[Step, ...]:
        """Adjacent faces of two sources on two planes that look like a missed weld, the highest of two pieces."""
        reach, steps = _NEAR_MISS * weld_m, dict[tuple[int, int], Step]()
        for leader, near in zip(self._leads, self._near, strict=True):
            missed = planes[near.faces] != planes[leader]
            members = np.flatnonzero(planes == planes[leader]) if missed.any() else near.faces
            for face, height in zip(near.faces[missed].tolist(), near.heights[missed].tolist(), strict=True):
                apart = np.maximum(self._lower[members] - self._upper[face], self._lower[face] - self._upper[members])
                adjacent = members[(apart.max(axis=1) <= reach) & (self._source[members] != self._source[face])]
                for other in adjacent.tolist():
                    low, high = sorted((int(self.piece[face]), int(self.piece[other])))
                    crack = bool(self.normals[face] @ self.normals[other] < 0.0)
                    step = Step((low, high), height, crack)
                    if height > steps.get(step.pieces, Step(step.pieces, self.rounding, crack)).height_m:
                        steps[step.pieces] = step
        return tuple(steps[pair] for pair in sorted(steps))

    def flaws(self) -> list[float]:
        """Greatest distances of corners of the pieces from planes of their faces, m."""
        face = np.repeat(np.arange(len(self.offsets)), np.diff(self._starts))
        distances = np.abs(np.einsum("ij,ij->i", self._corners, self.normals[face]) - self.offsets[face])
        firsts = self._starts[np.flatnonzero(np.diff(self.piece, prepend=-1))]
        flaws: list[float] = np.maximum.reduceat(distances, firsts).tolist()
        return flaws

    def differ(self, piece: Polytope, normals: FloatArray, offsets: FloatArray) -> bool:
        """Whether planes of a piece have moved by more than rounding."""
        turned = self._extent * np.abs(normals - piece.normals).max()
        return bool(max(turned, np.abs(offsets - piece.offsets).max()) > self.rounding)

    def _equal_planes(self) -> list[IntArray]:
        """Groups of the faces whose planes are equal but for rounding, in either sense."""
        from scipy.sparse import coo_array  # takes long to import: only unions pay
        from scipy.sparse.csgraph import connected_components
        from scipy.spatial import cKDTree

        # Of both senses of a plane that along which a vector, parallel to the sides of no part, points.
        signs = np.where(self.normals @ _ASKEW < 0.0, -1.0, 1.0)
        rows = np.column_stack((self._extent * signs[:, None] * self.normals, signs * self.offsets))
        distinct, places = np.unique(rows, axis=0, return_inverse=True)
        pairs = cKDTree(distinct).query_pairs(self.rounding, output_type="ndarray")
        graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(distinct), len(distinct)))
        self._group = connected_components(graph, directed=False)[1][places]
        order = np.argsort(self._group, kind="stable")
        groups = np.split(order, np.flatnonzero(np.diff(self._group[order])) + 1)
        leads = np.full(len(groups), -1)
        leads[self._group[self._order[::-1]]] = self._order[::-1]
        self._leads: list[int] = leads.tolist()
        return groups

    def _foreign(self, reach: float) -> list[_Near]:
        """For each group the faces of other sources within a reach in m of the plane of its largest face."""
        near = [_Near(np.empty(0, dtype=np.intp), np.empty(0))] * len(self._leads)
        sources = self._source[self._leads]
        firsts = self._corners[self._starts[:-1]]
        for source in set(sources.tolist()):
            groups, others = np.flatnonzero(sources == source), np.flatnonzero(self._source != source)
            for some in np.array_split(groups, 1 + len(groups) * len(others) // _MOST_NUMBERS):
                leads = np.array(self._leads)[some]
                heights = np.abs(self.normals[leads] @ firsts[others].T - self.offsets[leads, None])
                cosines = np.abs(self.normals[leads] @ self.normals[others].T)
                hits = (heights <= reach) & (cosines > _COPLANAR_COSINE)
                for k in np.flatnonzero(hits.any(axis=1)).tolist():
                    faces = others[hits[k]]
                    highest = self._heights(int(leads[k]), faces)
                    near[int(some[k])] = _Near(faces[highest <= reach], highest[highest <= reach])
        return near

    def _heights(self, leader: int, faces: IntArray) -> FloatArray:
        """Greatest distances of the corners of some faces from the plane of another one, m, (k,)."""
        polygons = (self._corners[self._starts[face] : self._starts[face + 1]] for face in faces.tolist())
        distances = [np.abs(polygon @ self.normals[leader] - self.offsets[leader]).max() for polygon in polygons]
        return np.array(distances)


def _onto_planes(
    piece: Polytope, normals: FloatArray, offsets: FloatArray, rounding: float
) -> tuple[FloatArray, float, float]:
    """Vertices of a piece moved the shortest way onto other planes of its faces; greatest move and residual, m.

    A vertex on more than three planes is moved by least squares. One that is on its planes but for rounding stays as it is
    in the file.
    """
    around: list[list[int]] = [[] for _ in piece.vertices]
    for k, face in enumerate(piece.faces):
        for i in face:
            around[i].append(k)
    vertices, moves, residuals = piece.vertices.copy(), [0.0], [0.0]
    for i, on in enumerate(around):
        distances = offsets[on] - normals[on] @ vertices[i]
        if np.abs(distances).max() > rounding:
            move = np.linalg.lstsq(normals[on], distances, rcond=_INDEPENDENT)[0]
            vertices[i] += move
            moves.append(float(np.linalg.norm(move)))
            residuals.append(float(np.abs(normals[on] @ move - distances).max()))
    return vertices, max(moves), max(residuals)
