"""The union of the convex polytopes of one rigid body: its common planes, and its faces, edges and vertices near a place.

Planes are made common at once. Features are evaluated where they are asked for, piece by piece, and kept: those of a cone of
64 sectors would take a second at the start of a run, which touches a few of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.cached_property import cached_property
from ffsm_mj.contact.solid.edges import UnionEdge, UnionEdges
from ffsm_mj.contact.solid.faces import UnionFace, UnionFaces
from ffsm_mj.contact.solid.tree import BoxTree
from ffsm_mj.contact.solid.vertices import UnionVertex, UnionVertices
from ffsm_mj.contact.solid.welding import Plane, weld
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

    @cached_property
    def vertices(self) -> UnionVertices:
        """Its vertices, by piece."""
        return UnionVertices(self._welded, self.tree, self.tolerance)

    def normal(self, plane: Plane) -> FloatArray:
        """Outward unit normal of the faces of a plane in one sense, (3,): the same numbers for all pieces."""
        index, sense = plane
        return np.asarray(sense * self._welded.normals[index] + 0.0)

    def planes_at(self, point: FloatArray, reach: float) -> dict[int, tuple[Plane, ...]]:
        """Pieces that a point is on or in, with the planes of theirs that it is on: none if it is inside.

        Args:
            point: A point, (3,).
            reach: Distance from planes within which it is on them, m.
        """
        there = {}
        for k in self.tree.near(point, point, reach).tolist():
            heights = self.pieces[k].normals @ point - self.pieces[k].offsets
            if heights.max() <= reach:
                on = (self.planes[k][face] for face in np.flatnonzero(heights >= -reach).tolist())
                there[k] = tuple(dict.fromkeys(on))
        return there

    def faces_at(self, point: FloatArray, reach: float) -> tuple[UnionFace, ...]:
        """Its faces that a point is on; with faces that another piece covers there."""
        planes = dict.fromkeys(plane for on in self.planes_at(point, reach).values() for plane in on)
        faces = (face for plane in planes for face in self.faces.at(plane))
        return tuple(face for face in faces if face.inside(point) >= -reach)

    def edges_near(self, lower: FloatArray, upper: FloatArray, reach: float) -> tuple[UnionEdge, ...]:
        """Its convex edges along pieces whose box is within a reach in m of a box."""
        near = self.tree.near(lower, upper, reach).tolist()
        return tuple(dict.fromkeys(edge for k in near for edge in self.edges.of(k)))

    def vertices_near(self, lower: FloatArray, upper: FloatArray, reach: float) -> tuple[UnionVertex, ...]:
        """Its vertices among those of pieces whose box is within a reach in m of a box."""
        near = self.tree.near(lower, upper, reach).tolist()
        return tuple(dict.fromkeys(vertex for k in near for vertex in self.vertices.of(k)))
