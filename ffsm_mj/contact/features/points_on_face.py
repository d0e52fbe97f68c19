"""Several points of one body over one face of another: the corners of a block on a plate, evaluated together.

The gaps of such points, their rates and second rates are affine functions of the places of the points: what depends on the
motion is computed once, and the points enter by products of matrices. Values are those of
:class:`~ffsm_mj.contact.features.point_line_gaps.PointOnFace`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.gap_function import Feature
from ffsm_mj.contact.features.point_line_gaps import PointOnFace

_NARROW = 0.1
"""Points whose spread across their longest direction is below this share are on a line."""


class PointsOnFace:
    """Points of one body over a face of another.

    Attributes:
        face: The face.
        swapped: Whether it belongs to geom b: the normal of the contact is minus that of the face.
        count: Number of points, m.
    """

    def __init__(self, features: Sequence[PointOnFace]) -> None:
        """Store the points; see :meth:`together` for which may be given."""
        self.face, self.swapped, self.count = features[0].face, features[0].swapped, len(features)
        self._bodies = self.face.body.id, features[0].point.body.id
        self._places = np.array([each.point.centre for each in features])
        self._first_radius, self._radius = np.array([each.radii for each in features]).T
        self._normal, self._level = np.array(self.face.normal), float(np.dot(self.face.normal, self.face.centre))
        sides = np.array([(*inwards, level) for inwards, level in self.face.sides]).reshape(-1, 4)
        self._inwards, self._sides = sides[:, :3].T, sides[:, 3]
        self._data: Any = None

    @staticmethod
    def together(one: Feature, other: Feature) -> bool:
        """Whether two features are points of one body over the same face."""
        return (
            isinstance(one, PointOnFace)
            and isinstance(other, PointOnFace)
            and one.point.body is other.point.body
            and one.swapped == other.swapped
            and one.face == other.face
        )

    @staticmethod
    def lie_flat(features: Sequence[Feature]) -> bool:
        """Whether some features are at least three points of one body over the same face, far from being on a line."""
        places = [
            each.point.centre
            for each in features
            if isinstance(each, PointOnFace) and PointsOnFace.together(features[0], each)
        ]
        if len(places) < 3:
            return False
        longest, across, _ = np.linalg.svd(np.array(places) - np.mean(places, axis=0), compute_uv=False)
        return bool(across > _NARROW * longest)

    def place(self, data: Any) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Points in world axes and in those of the body of the face, (m, 3) each, and the normal of the face, (3,)."""
        if data is not self._data:
            self._bind(data)
        points = self._places.dot(self._second_axes.T)
        points += self._second_origin
        return points, (points - self._first_origin).dot(self._first_axes), self._first_axes.dot(self._normal)

    def _bind(self, data: Any) -> None:
        """Take views of the arrays of ``data``, which MuJoCo does not move."""
        first, second = self._bodies
        self._data = data
        self._first_origin, self._first_axes = data.xpos[first], data.xmat[first].reshape(3, 3)
        self._second_origin, self._second_axes = data.xpos[second], data.xmat[second].reshape(3, 3)

    def levels(self, local: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gaps, and how far along the normal of the face the contact points are from the points, m, (m,) each."""
        heights = local.dot(self._normal) - self._level
        gaps = heights - self._radius
        return gaps, self._first_radius + 0.5 * gaps - heights

    def insides(self, local: FloatArray) -> list[float]:
        """Distances by which points are inside the nearest side of the face; see ``Face.inside``."""
        if not len(self._sides):
            return [self.face.inside((x, y, z)) for x, y, z in local.tolist()]
        found: list[float] = (local.dot(self._inwards) - self._sides).min(axis=1).tolist()
        return found
