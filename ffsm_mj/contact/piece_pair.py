"""Two pieces of two rigid bodies as if there were no others: gap, normal and points.

No direction parts two pieces better than one along which their features face each other. Faces, and the nearest points of a
polytope and of the segment that is the core of a sphere or capsule, give it in closed form; else it is searched.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from ffsm_mj._core.gap_bounds import Instant, stay_apart
from ffsm_mj._core.polygons import opposite
from ffsm_mj._core.polytopes import outward_vectors
from ffsm_mj._core.shapes import separation
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.near_pieces import face_normal, local_gap
from ffsm_mj.contact.normal import ContactNormal, HalfSpaceNormal, NormalSearch
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact.patch import facing
from ffsm_mj.contact.probe import PartSearch, Probe
from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.contact.shape import Shape
from ffsm_mj.contact.sides import Piece, Side
from ffsm_mj.model.system import System
from ffsm_mj.tolerances import CONTACT_GAP_M, DISTANCE_QUERY_M, DRIFT_M, MERGED_M

_PLANE = mujoco.mjtGeom.mjGEOM_PLANE
_ROD_KINDS = (int(mujoco.mjtGeom.mjGEOM_SPHERE), int(mujoco.mjtGeom.mjGEOM_CAPSULE))
"""Geoms that are a segment with a radius."""


class TwoPieces(ContactPair):
    """Two pieces by themselves.

    Attributes:
        pieces: Pieces of a and b.
        is_curved: Whether one of them is round.
    """

    def __init__(
        self,
        system: System,
        whole: ContactPair,
        sides: tuple[Side, Side],
        pieces: tuple[Piece, Piece],
        probe: Callable[[], Probe],
    ) -> None:
        """Resolve two pieces; see :class:`ContactPair`.

        Args:
            system: The system.
            whole: The pair whose name and rule they have.
            sides: The rigid bodies a and b.
            pieces: Pieces of a and b.
            probe: Gives the scratch model for queries of parts.
        """
        a, b = self.pieces = pieces
        self.parts, self._sides, self._probe = (a.part, b.part), sides, probe
        self.is_curved = a.is_curved or b.is_curved
        super().__init__(system, whole.name, a.geom, b.geom, whole.restitution, whole.mu, rule=whole.rule)
        self.position_tolerance, self.may_tie = 0.0, False
        self._rod = next((k for k in (0, 1) if pieces[k].kind in _ROD_KINDS and pieces[1 - k].polytope is not None), None)
        self._known: tuple[bytes, Proximity] | None = None

    def _normal_search(self) -> NormalSearch:
        if self.parts == (None, None):
            return super()._normal_search()
        self.size = min(piece.half_width for piece in self.pieces)
        if self.is_of(_PLANE):
            return HalfSpaceNormal(self.ids, self.size, self.flush_offset, self.parts)
        self._query_scatters = True  # of single precision
        return PartSearch(self.ids, self.parts, self.size, self.flush_offset, self._probe())

    def shapes(self, model: Any, data: Any) -> tuple[Shape, Shape]:
        """Shapes of a and b at the state in ``data``."""
        (a, b), (one, other) = self.ids, self.parts
        return Shape(model, data, a, one), Shape(model, data, b, other)

    def stays_apart(self, before: Instant, after: Instant) -> bool:
        """Whether they certainly do not touch from the start of a step to its end, given the states there."""
        (a, b), (one, other) = self._sides, self.pieces
        return stay_apart(a.bounding, one.number, b.bounding, other.number, before, after, DISTANCE_QUERY_M)

    def alone(self, model: Any, data: Any) -> Proximity:
        """Gap, normal, points and rates of these two pieces as if there were no others."""
        # What is in closed form follows from the pose alone, and the same pose is asked for again and again at an event.
        pose = b"".join(part.tobytes() for side in self._sides for part in (data.xpos[side.body], data.xmat[side.body]))
        if self._known is not None and self._known[0] == pose:
            return self.at_velocities(data, self._known[1])
        near = self._alone(model, data)
        self._known = (pose, near) if self._is_exact and not self.is_of(mujoco.mjtGeom.mjGEOM_CYLINDER) else None
        return near

    def _alone(self, model: Any, data: Any) -> Proximity:
        near = self._of_features(model, data)
        if near.gap >= -DRIFT_M or self.gap(model, data) < -DISTANCE_QUERY_M:
            return near
        # Deeper than a contact drifts, and no overlap: a body that slides over a seam touches the next piece on top, where
        # it approached its covered side. The normal turns at once, and the search does not find it from the last one.
        if (face := face_normal(self.pieces, self._sides, data, self.shapes(model, data))) is not None:
            self._search.start_from(face)
        return self._of_features(model, data)

    def _of_features(self, model: Any, data: Any) -> Proximity:
        """The proximity along the normal of the search, with the gap at its points, of what is level to PARALLEL only."""
        near = super().proximity(model, data)
        if near.gap > CONTACT_GAP_M or self.is_curved:
            return near
        gap = local_gap(self.shapes(model, data), near.normal, near.points)
        return replace(near, gap=gap) if gap > near.gap + MERGED_M else near

    def _contact_normal(self, model: Any, data: Any, shapes: tuple[Shape, Shape]) -> ContactNormal:
        self._is_exact = True
        if self.is_of(_PLANE):
            return super()._contact_normal(model, data, shapes)
        for normal in self._candidates(data, shapes):
            if (gap := separation(*shapes, normal)) >= -CONTACT_GAP_M:
                features = facing(*shapes, normal)
                if opposite(*features, normal, self.flush_offset):
                    self._search.start_from(normal)
                    middle = 0.5 * (features[0].mean(axis=0) + features[1].mean(axis=0))
                    return ContactNormal(normal, features, middle, gap)
        self._is_exact = False
        return super()._contact_normal(model, data, shapes)

    def _candidates(self, data: Any, shapes: tuple[Shape, Shape]) -> Iterator[FloatArray]:
        """Normals that the features may have in closed form."""
        if self._rod is None:
            if (face := face_normal(self.pieces, self._sides, data, shapes)) is not None:
                yield face
            return
        rod, side = shapes[self._rod], self._sides[1 - self._rod]
        polytope, axes = self.pieces[1 - self._rod].polytope, data.xmat[side.body].reshape(3, 3)
        assert polytope is not None
        for outward in outward_vectors(polytope, (rod.core() - data.xpos[side.body]) @ axes):
            yield np.asarray((-1.0 if self._rod == 0 else 1.0) * axes @ outward)

    def gap_to_rounding(self, model: Any, data: Any, gap: float) -> float:
        """The gap at the state in ``data``, to rounding; see :class:`ContactPair`."""
        # An overlap that a query shows may be that of a search which has not turned to the next piece.
        exact = gap > 0.0 or not self._query_scatters
        return super().gap_to_rounding(model, data, gap) if exact else self.alone(model, data).gap
