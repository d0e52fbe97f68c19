"""Neighbouring pieces whose union is convex become one: a partition cuts through places where nothing needs it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.polytope import Polytope, box

_Plane = tuple[float, ...]
"""Normal and offset of a plane, in that sense whose numbers come later in order: the same for the pieces on both sides."""


class _Pieces:
    """Pieces by number, and by the planes of their faces and the side of these that they are on."""

    def __init__(self, pieces: Sequence[Polytope], level_m: float) -> None:
        self.pieces, self._level_m, self._number = dict[int, Polytope](), level_m, 0
        self._on: dict[_Plane, tuple[set[int], set[int]]] = {}
        self._waiting = deque[tuple[int, int, _Plane]]()
        for piece in pieces:
            self._add(piece)

    def _add(self, piece: Polytope) -> None:
        """Add a piece, and compare it with those on the other sides of its planes."""
        number, self._number = self._number, self._number + 1
        self.pieces[number] = piece
        for plane, side in _planes(piece):
            sides = self._on.setdefault(plane, (set(), set()))
            self._waiting += [(number, other, plane) for other in sorted(sides[1 - side])]
            sides[side].add(number)

    def merge(self) -> None:
        """Unite pieces until no two neighbours have a convex union."""
        while self._waiting:
            one, other, plane = self._waiting.popleft()
            if one in self.pieces and other in self.pieces:
                united = self._united(self.pieces[one], self.pieces[other], plane)
                if united is not None:
                    for number in (one, other):
                        for of_piece, side in _planes(self.pieces.pop(number)):
                            self._on[of_piece][side].discard(number)
                    self._add(united)

    def _united(self, one: Polytope, other: Polytope, plane: _Plane) -> Polytope | None:
        """The union of two pieces on both sides of a plane if it is convex, else None.

        If each piece is on the inner side of all planes of the other but that one, the union is what all these bound: on
        either side of the plane it is one of the pieces.
        """
        low, high = np.minimum(one.bounds[0], other.bounds[0]), np.maximum(one.bounds[1], other.bounds[1])
        bounds = dict[tuple[float, ...], None]()
        for piece, beside in ((one, other), (other, one)):
            kept = [k for k, (of_piece, _) in enumerate(_planes(piece)) if of_piece != plane]
            rows = np.column_stack((piece.normals[kept], piece.offsets[kept]))
            if _greatest(rows, beside.vertices) > self._level_m:
                return None
            bounds.update(dict.fromkeys(map(tuple, rows.tolist())))
        united: Polytope | None = box((high - low).max() * np.ones(3), 0.5 * (low + high), np.eye(3))
        for *normal, offset in bounds:
            united = united.cut(np.array(normal), offset)[0] if united is not None else None
        return united


def _greatest(planes: FloatArray, points: FloatArray) -> float:
    """Greatest height of points, (n, 3), above planes, (m, 4), m."""
    return float((planes[:, :3] @ points.T - planes[:, 3:]).max())


def _planes(piece: Polytope) -> Iterator[tuple[_Plane, int]]:
    """Plane of each face in its common sense, and 1 where that is the sense of the face, else 0."""
    for normal, offset in zip(piece.normals.tolist(), piece.offsets.tolist(), strict=True):
        plane, opposite = (tuple(sense * value + 0.0 for value in (*normal, offset)) for sense in (1.0, -1.0))
        yield (plane, 1) if plane > opposite else (opposite, 0)


def merged(pieces: Sequence[Polytope], level_m: float) -> list[Polytope]:
    """Pieces of a partition, of which those with a convex union are one.

    Args:
        pieces: Pieces that share planes bit for bit.
        level_m: Height of a corner above a plane that counts as in it, m.

    Raises:
        ValueError: Rounding leaves no consistent polytope.
    """
    of_solid = _Pieces(pieces, level_m)
    of_solid.merge()
    return list(of_solid.pieces.values())
