"""The union of the convex polytopes of one rigid body: its common planes, its faces and its edges.

Planes are made common at once. Features are evaluated where they are asked for, piece by piece, and kept: those of a cone of
64 sectors would take a second at the start of a run, which touches a few of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ffsm_mj._core.boxes import BoxTree
from ffsm_mj.cached_property import cached_property
from ffsm_mj.contact.solid.edges import UnionEdges
from ffsm_mj.contact.solid.faces import UnionFaces
from ffsm_mj.contact.solid.welding import weld
from ffsm_mj.polytope import Polytope
from ffsm_mj.tolerances import MERGED_M


class Solid:
    """A union of polytopes, in the axes of its body.

    Attributes:
        pieces: The pieces, on common planes.
        planes: Plane of each face of each piece.
        report: What welding merged and moved.
        tolerance: Distance within which points and planes are one, m: that of welding, or rounding if it is larger.
    """

    def __init__(self, pieces: Sequence[Polytope], weld_m: float, sources: Sequence[int] | None = None) -> None:
        """Weld the pieces; see :func:`.welding.weld`.

        Raises:
            TooThinError: The tolerance exceeds a tenth of the thickness of a piece.
        """
        self._welded = weld(pieces, weld_m, sources)
        self.pieces, self.planes, self.report = self._welded.pieces, self._welded.planes, self._welded.report
        self.tolerance = max(weld_m, MERGED_M)
        self._parts: dict[frozenset[int], UnionFaces] = {}

    @cached_property
    def tree(self) -> BoxTree:
        """Tree of the boxes around the pieces."""
        return BoxTree(np.array([piece.bounds for piece in self.pieces]))

    @cached_property
    def faces(self) -> UnionFaces:
        """Its faces, by plane and sense."""
        return UnionFaces(self._welded, self.tolerance)

    def faces_of(self, pieces: frozenset[int]) -> UnionFaces:
        """Faces of some pieces alone, as those that one contact rule names: another one ends at their outline."""
        if len(pieces) == len(self.pieces):
            return self.faces
        if pieces not in self._parts:
            planes = tuple(of if k in pieces else () for k, of in enumerate(self.planes))
            self._parts[pieces] = UnionFaces(replace(self._welded, planes=planes), self.tolerance)
        return self._parts[pieces]

    @cached_property
    def edges(self) -> UnionEdges:
        """Its convex edges, by piece."""
        return UnionEdges(self._welded, self.tree, self.tolerance)
