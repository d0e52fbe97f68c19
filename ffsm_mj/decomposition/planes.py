"""Exact partition of a solid by the planes of its own faces: for machined parts.

A binary space partition (Fuchs, Kedem & Naylor 1980): a convex cell of space is cut by the plane of one of the faces in it
until the solid in it is convex. A face that no other face of the cell is beyond never has to cut: it bounds the piece at the
end. What is cut are faces, so a cell knows its own ones only.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from time import monotonic
from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray, IntArray
from ffsm_mj.decomposition.merging import merged
from ffsm_mj.decomposition.surface import Surface
from ffsm_mj.errors import InputError
from ffsm_mj.polytope import Polytope, box, plane_of
from ffsm_mj.tolerances import MERGED_M

MOST_PLANES = 6_000
MOST_PIECES = 4_000
LONGEST_S = 300.0
"""Limits of a partition: beyond them the shape is no machined part, and a decomposition by CoACD has fewer pieces."""
_COSINE = 0.99
"""Least cosine of the angle between a face and the plane that it joins: thin triangles have no reliable normal."""
_VOLUME = 1e-9
"""Greatest relative difference between the volumes of pieces and mesh, beside that of faces that joined a plane."""
_INSTEAD = "use 'method: coacd', or a tolerance_m that takes faces together which are meant to be one"


class Planes(NamedTuple):
    """Planes of the faces of a surface.

    Attributes:
        normals: Unit normals, (p, 3).
        offsets: Distances from the origin along them, (p,), m.
        of_face: Plane of each triangle, -1 for one without area, (m,).
        senses: 1 where the normal points out of the solid there, -1 where it points inwards, (m,).
    """

    normals: FloatArray
    offsets: FloatArray
    of_face: IntArray
    senses: IntArray


def planes_of(surface: Surface, tolerance_m: float, name: str) -> Planes:
    """Planes of a surface, one for all faces in it in either sense; the largest face leads.

    Args:
        surface: The surface.
        tolerance_m: A face joins a plane if all its corners are this close to it, m.
        name: Name of the mesh in messages.

    Raises:
        InputError: There are too many.
    """
    triangles, doubled = surface.triangles, np.linalg.norm(surface.areas, axis=1)
    sides = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
    directions = surface.areas / np.where(doubled > 0.0, doubled, 1.0)[:, None]
    of_face, senses = np.full(len(triangles), -1), np.zeros(len(triangles), dtype=np.intp)
    # What is lower than the tolerance is a line: the faces around it have its corners.
    waiting = np.flatnonzero(doubled > tolerance_m * sides)
    waiting = waiting[np.argsort(-doubled[waiting], kind="stable")]
    normals, offsets = list[FloatArray](), list[float]()
    while len(waiting):
        normal, offset = plane_of(triangles[waiting[0]])
        cosines = directions[waiting] @ normal
        level = np.abs(triangles[waiting] @ normal - offset).max(axis=1) <= tolerance_m
        joins = level & (np.abs(cosines) > _COSINE)
        joins[0] = True
        of_face[waiting[joins]], senses[waiting[joins]] = len(normals), np.sign(cosines[joins])
        normals.append(normal)
        offsets.append(offset)
        if len(normals) > MOST_PLANES:
            raise InputError(f"{name}: its faces are in more than {MOST_PLANES} planes; {_INSTEAD}")
        waiting = waiting[~joins]
    return Planes(np.array(normals), np.array(offsets), of_face, senses)


@dataclass
class _Cell:
    """A convex cell of space with the faces in it: of each plane and sense the parts in the cell, as convex polygons.

    Attributes:
        space: The cell.
        faces: Polygons of each face, (k, 3) each.
        planes: Planes of the faces, (f,).
        senses: Their senses, (f,).
        rows: Planes that may have to cut it, (r,).
        above: Which faces have a part above which of these planes, (r, f).
        below: The same below, (r, f).
    """

    space: Polytope
    faces: list[list[FloatArray]]
    planes: IntArray
    senses: IntArray
    rows: IntArray
    above: BoolArray
    below: BoolArray

    def keep_reflex(self) -> None:
        """Leave the rows of planes that have a face of the cell with another one beyond it."""
        outward, inward = (np.isin(self.rows, self.planes[self.senses == sense]) for sense in (1, -1))
        reflex = (self.above.any(axis=1) & outward) | (self.below.any(axis=1) & inward)
        self.rows, self.above, self.below = self.rows[reflex], self.above[reflex], self.below[reflex]

    def best_row(self) -> int:
        """The row whose plane divides the fewest faces that have to cut themselves, then the fewest of all, and halves best.

        A face that is divided may have to cut on both sides.
        """
        divided = self.above & self.below
        further = divided[:, np.isin(self.planes, self.rows)].sum(axis=1)
        uneven = np.abs(self.above.sum(axis=1) - self.below.sum(axis=1))
        return int(np.lexsort((uneven, divided.sum(axis=1), further))[0])


class _Partition:
    """One partition; its limits and its planes."""

    def __init__(self, surface: Surface, tolerance_m: float, name: str) -> None:
        self._surface, self._name = surface, name
        self._planes = planes_of(surface, tolerance_m, name)
        # Corners of a face that joined a plane are off it by the tolerance, those of cuts by as much again.
        self._level_m = 2.0 * tolerance_m
        self._merged_m = MERGED_M * max(1.0, surface.extent)
        self._end_s = monotonic() + LONGEST_S

    def pieces(self) -> list[Polytope]:
        """All pieces.

        Raises:
            InputError: There are too many, or it takes too long.
        """
        # Where the tolerance is above all faces, there are no planes.
        waiting, pieces = [self._whole()] if len(self._planes.normals) else [], list[Polytope]()
        while waiting:
            cell = waiting.pop()
            cell.keep_reflex()
            if len(cell.rows):
                waiting += self._parts(cell)
            else:
                piece = self._bounded(cell)
                pieces += [] if piece is None else [piece]
            self._refuse_long(len(pieces) + len(waiting))
        return pieces

    def _refuse_long(self, count: int = 0) -> None:
        """Refuse so many pieces, and work that takes too long.

        Raises:
            InputError: The limit is exceeded.
        """
        if count > MOST_PIECES or monotonic() > self._end_s:
            raise InputError(
                f"{self._name}: more than {MOST_PIECES} pieces, or {LONGEST_S:g} s, by its {len(self._planes.normals)} face "
                f"planes; {_INSTEAD}"
            )

    def _whole(self) -> _Cell:
        """A box about the whole surface, wide enough that none of its sides is one of the surface."""
        low, high = self._surface.vertices.min(axis=0), self._surface.vertices.max(axis=0)
        space = box((high - low).max() * np.ones(3), 0.5 * (low + high), np.eye(3))
        of_face, senses = self._planes.of_face, self._planes.senses
        faces: dict[tuple[int, int], list[FloatArray]] = {}
        for triangle in np.flatnonzero(of_face >= 0).tolist():
            faces.setdefault((int(of_face[triangle]), int(senses[triangle])), []).append(self._surface.triangles[triangle])
        polygons, rows = list(faces.values()), np.arange(len(self._planes.normals))
        planes, directions = np.array(list(faces)).T
        return _Cell(space, polygons, planes, directions, rows, *self._sides(rows, polygons))

    def _sides(self, rows: IntArray, faces: Sequence[Sequence[FloatArray]]) -> tuple[BoolArray, BoolArray]:
        """Which faces have a part above, and below, which planes, (r, f) each."""
        above, below = (np.zeros((len(rows), len(faces)), dtype=bool) for _ in range(2))
        corners = [np.concatenate(polygons) for polygons in faces]
        starts = np.cumsum([0, *map(len, corners[:-1])])
        for k in range(0, len(rows) if corners else 0, _ROWS):
            some = rows[k : k + _ROWS]
            heights = self._planes.normals[some] @ np.concatenate(corners).T - self._planes.offsets[some, None]
            above[k : k + _ROWS] = np.maximum.reduceat(heights, starts, axis=1) > self._level_m
            below[k : k + _ROWS] = np.minimum.reduceat(heights, starts, axis=1) < -self._level_m
        return above, below

    def _parts(self, cell: _Cell) -> Iterator[_Cell]:
        """The two cells into which the plane of the best row cuts one.

        One without faces is all inside: on the other side of the plane, beyond a face in it, there is a face.
        """
        row = cell.best_row()
        normal, offset = self._planes.normals[cell.rows[row]], float(self._planes.offsets[cell.rows[row]])
        above, below = cell.above[row], cell.below[row]
        divided = np.flatnonzero(above & below)
        cut = [_split(cell.faces[k], normal, offset, self._level_m) for k in divided.tolist()]
        spaces = self._cut(cell.space, normal, offset)
        for side, (space, whole) in enumerate(zip(spaces, (below & ~above, above & ~below), strict=True)):
            if space is None:
                continue
            kept, parts = np.flatnonzero(whole), [both[side] for both in cut]
            faces = [cell.faces[k] for k in kept.tolist()] + parts
            index, sides = np.concatenate((kept, divided)), self._sides(cell.rows, parts)
            columns = [np.hstack((old[:, kept], new)) for old, new in zip((cell.above, cell.below), sides, strict=True)]
            yield _Cell(space, faces, cell.planes[index], cell.senses[index], cell.rows, *columns)

    def _cut(self, space: Polytope, normal: FloatArray, offset: float) -> tuple[Polytope | None, Polytope | None]:
        """The parts of a polytope below and above a plane; None for one no thicker than faces are off their planes.

        Raises:
            ValueError: Rounding leaves no consistent polytopes.
        """
        heights = space.vertices @ normal - offset
        if heights.max() <= self._level_m:
            return space, None
        if heights.min() >= -self._level_m:
            return None, space
        # Rounding decides which corners of a face that is almost in the plane are in it: more or fewer of them may fit.
        for tolerance_m in (self._merged_m, 0.0, 0.1 * self._level_m, self._level_m):
            with suppress(ValueError, KeyError):
                parts = space.cut(normal, offset, tolerance_m)
                if all(part is None or _is_closed(part) for part in parts):
                    return parts
        msg = "rounding leaves no closed piece"
        raise ValueError(msg)

    def _bounded(self, cell: _Cell) -> Polytope | None:
        """The part of a cell on the inner side of all its faces; None if rounding alone is left of it."""
        piece: Polytope | None = cell.space
        for plane, sense in sorted(set(zip(cell.planes.tolist(), cell.senses.tolist(), strict=True))):
            if piece is None:
                break
            self._refuse_long()
            parts = self._cut(piece, self._planes.normals[plane], float(self._planes.offsets[plane]))
            piece = parts[0] if sense > 0 else parts[1]
        return piece


_ROWS = 200
"""Planes compared with all corners at once."""


def _is_closed(piece: Polytope) -> bool:
    """Whether the faces of a polytope bound it: every edge is one of two faces, by Euler's formula without holes.

    Raises:
        KeyError: An edge is one of a single face.
    """
    return len(piece.vertices) + len(piece.faces) == len(piece.edges) + 2


def _split(
    polygons: Sequence[FloatArray], normal: FloatArray, offset: float, level_m: float
) -> tuple[list[FloatArray], list[FloatArray]]:
    """The parts of convex polygons below and above a plane by more than a distance in m."""
    below, above = list[FloatArray](), list[FloatArray]()
    for polygon in polygons:
        heights = polygon @ normal - offset
        if heights.min() < -level_m and heights.max() > level_m:
            for side, part in zip((below, above), _halves(polygon, heights), strict=True):
                side.append(part)
        elif heights.min() < -level_m or heights.max() > level_m:
            (above if heights.max() > level_m else below).append(polygon)
    return below, above


def _halves(polygon: FloatArray, heights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The parts of a convex polygon, (k, 3), below and above a plane, by the heights of its corners, (k,)."""
    below, above = [], []
    for k, height in enumerate(heights.tolist()):
        before = float(heights[k - 1])
        if before * height < 0.0:
            crossing = polygon[k - 1] + before / (before - height) * (polygon[k] - polygon[k - 1])
            below.append(crossing)
            above.append(crossing)
        if height <= 0.0:
            below.append(polygon[k])
        if height >= 0.0:
            above.append(polygon[k])
    return np.array(below), np.array(above)


def partition(surface: Surface, tolerance_m: float, name: str) -> list[Polytope]:
    """Convex pieces of a solid, which share planes bit for bit and have no volume in common.

    Args:
        surface: Its surface, beyond the gate.
        tolerance_m: Faces whose corners are this close to a plane are in it, m.
        name: Name of the mesh in messages.

    Raises:
        InputError: There are too many planes or pieces, or the pieces do not fill the solid.
    """
    try:
        pieces = merged(_Partition(surface, tolerance_m, name).pieces(), 2.0 * tolerance_m)
    except ValueError as error:
        raise InputError(f"{name}: its faces do not bound pieces ({error}); {_INSTEAD}") from error
    volume = sum(piece.volume for piece in pieces)
    allowed = _VOLUME * surface.volume + tolerance_m * np.linalg.norm(surface.areas, axis=1).sum()
    if not pieces or abs(volume - surface.volume) > allowed:  # what is allowed may be more than the whole volume
        raise InputError(
            f"{name}: the pieces have {volume:.9g} m3, the mesh has {surface.volume:.9g}: faces closer to each other than "
            f"tolerance_m = {tolerance_m:.3g} m; {_INSTEAD}"
        )
    return pieces
