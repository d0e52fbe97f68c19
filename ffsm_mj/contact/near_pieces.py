"""Which pieces of two rigid bodies may be near each other, and the normals of pieces whose features are faces.

Queries of pairs of pieces are what unions cost. A pair is queried only if lower bounds of its gap leave it open: distances
of spheres around the pieces, and heights of a piece over the faces of the other, which are the gap itself over a face.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import product
from typing import Any

import numpy as np

from ffsm_mj._core.gap_bounds import PieceBounds
from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.contact.features.gap_function import Feature
from ffsm_mj.contact.shape import Shape
from ffsm_mj.contact.sides import Piece, Side
from ffsm_mj.tolerances import PARALLEL

_FEW = 1024
"""Up to so many pairs of pieces the spheres around all of them are compared: that takes less time than the tree."""


class NearPieces:
    """Pairs of pieces of two rigid bodies, a and b, by their places: number in a times pieces of b plus number in b."""

    def __init__(self, sides: tuple[Side, Side]) -> None:
        """Take the bodies."""
        self._sides, self._bounds = sides, PieceBounds(*(side.bounding for side in sides))

    def _between(self, data: Any) -> tuple[FloatArray, FloatArray]:
        """Rotation and position of the axes of b in those of a."""
        (a, b), axes = self._sides, data.xmat[self._sides[0].body].reshape(3, 3)
        return axes.T @ data.xmat[b.body].reshape(3, 3), (data.xpos[b.body] - data.xpos[a.body]) @ axes

    def within(self, among: BoolArray, data: Any, reach: float, without: int = -1) -> list[tuple[float, int]]:
        """Pairs that may be within a reach: a lower bound of the gap of each, m, and its place, the least bound first.

        Args:
            among: Which pairs count, (pieces of a, pieces of b).
            data: MuJoCo's data, kinematics current.
            reach: The reach, m.
            without: Place of a pair that does not count; -1: all do.
        """
        a, b = self._sides
        pairs = None if among.size <= _FEW else a.tree.pairs(b.tree, *self._between(data), max(reach, 0.0))
        return self._bounds.within(among.view(np.uint8), pairs, data, reach, without)

    def first_guess(self, among: BoolArray, data: Any) -> int:
        """Place of that of some pairs whose centres are nearest to each other; -1 if there is none."""
        (a, b), (rotation, position) = self._sides, self._between(data)
        if not among.any():
            return -1
        apart = np.linalg.norm(a.centres[:, None] - (b.centres @ rotation.T + position), axis=2)
        return int(np.argmin(np.where(among, apart, math.inf)))

    def parted_by(self, face: Feature, model: Any, data: Any, tolerance: float) -> tuple[BoolArray, BoolArray]:
        """Which pieces of a are below the plane of a face, and which of b above; they may cross it by a tolerance, m."""
        at, (a, b) = face.at(data), self._sides
        normal = np.array(at.normal)
        level = float(normal @ at.point)
        highest, lowest = a.extents(model, data, normal), -b.extents(model, data, -normal)
        return highest <= level + tolerance, lowest >= level - tolerance

    def on_planes_of(self, pairs: Iterable[int], points: Sequence[FloatArray], data: Any, reach: float) -> BoolArray:
        """Which pairs of pieces go on in the planes in which some pairs have contact points, (pieces of a, pieces of b).

        Args:
            pairs: Places of pairs that touch; they count too.
            points: Contact points, world axes, m, (3,) each.
            data: MuJoCo's data, kinematics current.
            reach: A plane passes a point within this, m.
        """
        chosen = np.zeros([len(side.pieces) for side in self._sides], dtype=bool)
        for place, point in product(pairs, points):
            pieces = zip(self._sides, np.unravel_index(place, chosen.shape), strict=True)
            chosen[np.ix_(*(side.on_planes_of(side.pieces[k], side.local(data, point), reach) for side, k in pieces))] = True
        return chosen


def local_gap(shapes: tuple[Shape, Shape], normal: FloatArray, points: FloatArray) -> float:
    """Least gap of two polytopes at their contact points, m, of faces and edges that are level to PARALLEL only.

    Their separation is that of a corner which may be over the next piece: 1e-7 m lower, that is no touch of this one.

    Args:
        shapes: The polytopes, a and b.
        normal: Normal from a to b, that of a face on one side, (3,).
        points: Points midway of the gap, (k, 3), m.
    """
    a, b = shapes
    if min(len(a.extreme(normal, PARALLEL)), len(b.extreme(-normal, PARALLEL))) == 1:
        return -math.inf  # a corner: its separation is its gap
    heights = points @ normal
    return 2.0 * float(np.maximum(heights - a.extents(normal[None]), -b.extents(-normal[None]) - heights).min())


def face_normal(
    pieces: tuple[Piece, Piece], sides: tuple[Side, Side], data: Any, shapes: tuple[Shape, Shape]
) -> FloatArray | None:
    """Normal from a to b of the face of either piece that parts them best, world axes, (3,); None of two round pieces."""
    faces = [
        sense * piece.polytope.normals @ data.xmat[side.body].reshape(3, 3).T
        for piece, side, sense in zip(pieces, sides, (1.0, -1.0), strict=True)
        if piece.polytope is not None
    ]
    if not faces:
        return None
    normals, (a, b) = np.concatenate(faces), shapes
    return np.asarray(normals[int(np.argmin(a.extents(normals) + b.extents(-normals)))])
