"""Vertices of a union: those vertices of its pieces that stand out of all pieces together.

A point of a union can touch a plane from above if all pieces there are below the plane. It is a vertex if this holds for
planes all around some direction: not where other pieces cover it, nor within a face or along an edge of the union.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.solid.tree import BoxTree
from ffsm_mj.contact.solid.welding import Welded
from ffsm_mj.tolerances import PARALLEL


@dataclass(frozen=True, eq=False)
class UnionVertex:
    """A vertex of a union.

    Attributes:
        position: Its position, (3,), m.
        cone: Unit directions to the other corners of all pieces there, (k, 3).
        pieces: Pieces that it belongs to, as a corner or otherwise.
    """

    position: FloatArray
    cone: FloatArray
    pieces: tuple[int, ...]


class UnionVertices:
    """The vertices of a union, evaluated piece by piece when they are asked for."""

    def __init__(self, welded: Welded, tree: BoxTree, tolerance: float) -> None:
        """Take the pieces of a solid.

        Args:
            welded: The pieces.
            tree: Tree of their boxes.
            tolerance: Distance within which a point is on a plane, and within which points are one, m.
        """
        self._pieces, self._tree = welded.pieces, tree
        # Corners of meshes in single precision are off the planes of their faces.
        self._tolerances = [max(tolerance, flaw) for flaw in welded.flaws]
        self._known: dict[tuple[int, int], UnionVertex | None] = {}

    def of(self, piece: int) -> tuple[UnionVertex, ...]:
        """The vertices of the union among those of a piece: the same objects for all pieces with this corner."""
        for k in range(len(self._pieces[piece].vertices)):
            if (piece, k) not in self._known:
                self._evaluate(self._pieces[piece].vertices[k], self._tolerances[piece])
        known = (self._known[piece, k] for k in range(len(self._pieces[piece].vertices)))
        return tuple(vertex for vertex in known if vertex)

    def _evaluate(self, place: FloatArray, tolerance: float) -> None:
        """Find out about a corner of a piece, for all pieces that have it."""
        cones, pieces, corners, covered = [], [], [], False
        for k in self._tree.near(place, place, tolerance).tolist():
            piece = self._pieces[k]
            normals = piece.normals_at(place, max(tolerance, self._tolerances[k]))
            if normals is None:
                continue
            offsets = piece.vertices - place
            lengths = np.linalg.norm(offsets, axis=1)
            far = lengths > tolerance
            cones.append(offsets[far] / lengths[far, None])
            pieces.append(k)
            corners += [(k, i) for i in np.flatnonzero(~far).tolist()]
            covered |= not len(normals)
        cone = np.concatenate(cones)
        stands_out = not covered and (len(pieces) == 1 or _pointed(cone))
        # Residuals of welding tell the corners of pieces apart: the order of coordinates decides, not that of pieces.
        position = min(self._pieces[k].vertices[i].tolist() for k, i in corners)
        vertex = UnionVertex(np.array(position), cone, tuple(pieces)) if stands_out else None
        self._known.update(dict.fromkeys(corners, vertex))


def _pointed(directions: FloatArray) -> bool:
    """Whether all unit vectors, (k, 3), are on one side of a plane through the origin, by more than PARALLEL.

    If not, zero is a convex combination of them; the residual of this problem of least squares is the distance.
    """
    from scipy.optimize import nnls  # takes long to import: only unions pay

    system = np.vstack((directions.T, np.ones(len(directions))))
    _, residual = nnls(system, np.array((0.0, 0.0, 0.0, 1.0)))
    return bool(residual > PARALLEL)
