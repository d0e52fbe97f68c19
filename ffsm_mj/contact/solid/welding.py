"""Planes that the faces of several pieces share: coplanar faces of one solid have one plane, bit for bit, in either sense.

Pieces that were written or decomposed apart from each other are off by rounding: a face that is 1e-16 m proud of its
neighbour has an edge, which tilts the normal of a sphere on it by 4.5e-8. Welding moves such faces onto one plane, that of
the largest, and their vertices with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

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
_INDEPENDENT = 1e-4
"""Planes at smaller angles, in rad, do not fix a vertex along their line: it moves across it only."""


Plane = tuple[int, int]
"""Index of a plane of a solid, and the sense in which a face looks: 1 along its normal, -1 against it."""


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
        return (
            f"{self.merged} faces share the plane of a larger one, greatest move {self.greatest_move_m:.1e} m, "
            f"residual {self.residual_m:.1e} m"
        )


@dataclass(frozen=True, eq=False)
class Welded:
    """The pieces of a solid on common planes.

    Attributes:
        pieces: The pieces with their vertices moved; the planes of their faces are those of ``normals`` and ``offsets``.
        normals: Normals of the planes, (p, 3).
        offsets: Their offsets, (p,), m.
        planes: Plane of each face of each piece.
        report: What was merged and moved.
    """

    pieces: tuple[Polytope, ...]
    normals: FloatArray
    offsets: FloatArray
    planes: tuple[tuple[Plane, ...], ...]
    report: WeldReport


def weld(pieces: Sequence[Polytope], weld_m: float, sources: Sequence[int] | None = None) -> Welded:
    """Bring coplanar faces of the pieces of one solid onto common planes.

    Args:
        pieces: The pieces, all in the same axes.
        weld_m: Welding tolerance, m.
        sources: What the pieces come from. Pieces of one source, such as an exact partition of a mesh, share planes up to
            rounding already and are not welded to each other. By default every piece has a source of its own.

    Raises:
        ValueError: The tolerance exceeds a tenth of the thickness of a piece.
    """
    sources = range(len(pieces)) if sources is None else sources
    if len(set(sources)) > 1:
        _refuse_thin(pieces, weld_m)
    faces = _Faces(pieces, sources)
    planes, senses, leaders = faces.assigned(weld_m)
    normals, offsets = faces.normals[leaders], faces.offsets[leaders]
    merged = int((faces.piece != faces.piece[leaders][planes]).sum())
    bounds = np.cumsum([0, *(len(piece.faces) for piece in pieces)]).tolist()
    moved, moves, residuals = [], [0.0], [0.0]
    for piece, (first, last) in zip(pieces, pairwise(bounds), strict=True):
        new_normals = senses[first:last, None] * normals[planes[first:last]] + 0.0
        new_offsets = senses[first:last] * offsets[planes[first:last]] + 0.0
        vertices = piece.vertices.copy()
        for i, off in enumerate(_off_plane(piece, new_normals, new_offsets)):
            # Vertices within rounding of their planes stay as they are in the file.
            if np.abs(off[1]).max() > faces.rounding:
                vertices[i] += _onto(*off)
                moves.append(float(np.linalg.norm(vertices[i] - piece.vertices[i])))
                residuals.append(float(np.abs(off[0] @ (vertices[i] - piece.vertices[i]) - off[1]).max()))
        moved.append(Polytope(vertices, new_normals, new_offsets, piece.faces))
    report = WeldReport(merged, max(moves), max(residuals), faces.steps(planes, leaders, weld_m))
    pairs = [*zip(planes.tolist(), senses.tolist(), strict=True)]
    of_pieces = tuple(tuple(pairs[first:last]) for first, last in pairwise(bounds))
    return Welded(tuple(moved), normals, offsets, of_pieces, report)


def _refuse_thin(pieces: Sequence[Polytope], weld_m: float) -> None:
    thickness, index = min((piece.thickness, i) for i, piece in enumerate(pieces))
    if weld_m * _LEAST_THICKNESS > thickness:
        msg = (
            f"a welding tolerance of {weld_m:g} m is more than a tenth of the thinnest piece: "
            f"number {index} is {thickness:g} m thick; at most {thickness / _LEAST_THICKNESS:g} m is allowed"
        )
        raise ValueError(msg)


class _Faces:
    """All faces of some pieces as arrays."""

    def __init__(self, pieces: Sequence[Polytope], sources: Sequence[int]) -> None:
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
        self._areas = np.array([np.linalg.norm(area_vector(polygon)) for polygon in polygons])
        self.rounding = _ROUNDING * max(1.0, float(np.abs(self._corners).max()))

    def assigned(self, weld_m: float) -> tuple[IntArray, IntArray, IntArray]:
        """Plane of each face, (F,), its sense, (F,), and the faces that lead the planes, (p,).

        The largest face leads, and the order of equal ones is that of their planes: not that of the pieces.
        """
        planes = np.full(len(self.offsets), -1)
        senses = np.ones(len(self.offsets), dtype=np.intp)
        leaders: list[int] = []
        for leader in np.lexsort((*self.normals.T, self.offsets, -self._areas)).tolist():
            if planes[leader] < 0:
                cosines, heights = self._seen_from(leader, np.flatnonzero(planes < 0), weld_m)
                foreign = self._source != self._source[leader]
                joining = heights <= np.where(foreign, max(weld_m, self.rounding), self.rounding)
                joining[leader] = True
                planes[joining] = len(leaders)
                senses[joining] = np.sign(cosines[joining])
                leaders.append(leader)
        return planes, senses, np.array(leaders)

    def steps(self, planes: IntArray, leaders: IntArray, weld_m: float) -> tuple[Step, ...]:
        """Adjacent faces of two sources on two planes that look like a missed weld, the highest of two pieces."""
        reach, steps = _NEAR_MISS * weld_m, dict[tuple[int, int], Step]()
        for plane, leader in enumerate(leaders.tolist()):
            cosines, heights = self._seen_from(leader, np.flatnonzero(planes != plane), reach)
            members = np.flatnonzero(planes == plane)
            for face in np.flatnonzero(heights <= reach).tolist():
                apart = np.maximum(self._lower[members] - self._upper[face], self._lower[face] - self._upper[members])
                adjacent = members[(apart.max(axis=1) <= reach) & (self._source[members] != self._source[face])]
                for other in adjacent.tolist():
                    low, high = sorted((int(self.piece[face]), int(self.piece[other])))
                    crack = bool(cosines[face] * cosines[other] < 0.0)
                    step = Step((low, high), float(heights[face]), crack)
                    if step.height_m > steps.get(step.pieces, Step(step.pieces, self.rounding, crack)).height_m:
                        steps[step.pieces] = step
        return tuple(steps[pair] for pair in sorted(steps))

    def _seen_from(self, leader: int, among: IntArray, reach: float) -> tuple[FloatArray, FloatArray]:
        """Cosines of all normals to that of a face, and greatest distances of corners from its plane (inf: not near it)."""
        normal, offset = self.normals[leader], self.offsets[leader]
        cosines, heights = self.normals @ normal, np.full(len(self.offsets), np.inf)
        first = np.abs(self._corners[self._starts[among]] @ normal - offset) <= max(reach, self.rounding)
        for face in among[first & (np.abs(cosines[among]) > _COPLANAR_COSINE)].tolist():
            corners = self._corners[self._starts[face] : self._starts[face + 1]]
            heights[face] = np.abs(corners @ normal - offset).max()
        return cosines, heights


def _off_plane(piece: Polytope, normals: FloatArray, offsets: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Normals of the planes that a vertex belongs to, (k, 3), and its distances from them, (k,), for all vertices."""
    faces: list[list[int]] = [[] for _ in piece.vertices]
    for k, face in enumerate(piece.faces):
        for i in face:
            faces[i].append(k)
    return [(normals[on], offsets[on] - normals[on] @ x) for on, x in zip(faces, piece.vertices, strict=True)]


def _onto(normals: FloatArray, distances: FloatArray) -> FloatArray:
    """Shortest move of a point onto planes at some distances: least squares for more than three."""
    return np.asarray(np.linalg.lstsq(normals, distances, rcond=_INDEPENDENT)[0])
