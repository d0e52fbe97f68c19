"""Points without friction over a face: held along its normal, at their middle and in their tilts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.body_motion import Vector, cross, dot, scaled
from ffsm_mj.contact.features.point_line_gaps import PointOnFace
from ffsm_mj.contact_models.persistent.holds.face_point import FacePoint
from ffsm_mj.dynamics.body_twists import PairTwist

_LINE = 1e-12
"""Points are on a line, or all at one place, where they spread across by less than this share of their extent, m."""


class FaceHold:
    """Points of one body over a face of another, without friction.

    With the middle m of k points and U^T U = sum(r r^T) over their arms r from there, the rows W of the points, (p x n, n)
    each, have W^T W = B^T B with the rows

        sqrt(k) (m x n, n),   (u x n, 0) for each row u of U.

    Second rates of the gaps are affine in the places of the points, so those of the rows are the same combinations. With the
    singular value decomposition of the arms, W = C B with a constant C of orthonormal columns.

    Attributes:
        count: See :class:`~.hold.Hold`: 1, 2 for points on a line, otherwise 3.
    """

    def __init__(self, features: Sequence[PointOnFace], data: Any) -> None:
        """Store the points; ``data`` is that of the logged system."""
        places = np.array([each.point.centre for each in features])
        middle, self._root = places.mean(axis=0), math.sqrt(len(places))
        self._at = FacePoint(features[0], data, tuple(middle.tolist()))
        left, sizes, axes = np.linalg.svd(places - middle, full_matrices=False)
        # The third direction is that of the normal.
        across = int(np.count_nonzero(sizes[:2] > _LINE * (1.0 + sizes[0])))
        self._spread: list[Vector] = [tuple(each) for each in (sizes[:across, None] * axes[:across]).tolist()]
        self.count = 1 + across
        self._of_points = np.column_stack((np.full(len(places), 1.0 / self._root), left[:, :across]))

    def begin(self, points: FloatArray) -> bool:  # noqa: ARG002
        """See :class:`~.hold.Hold`: nothing depends on the step."""
        return True

    def write(self, twist: PairTwist, rows: FloatArray, bias: FloatArray) -> None:
        """See :class:`~.hold.Hold`."""
        at, root = self._at, self._root
        at.move_to(twist)
        (x, y, z), (u, v, w) = at.normal, cross(at.arm, at.normal)
        constant, gradient = at.second_rate(twist)
        rows[0] = root * u, root * v, root * w, root * x, root * y, root * z
        bias[0] = root * (constant + dot(gradient, at.arm))
        for i, local in enumerate(self._spread, 1):
            out = at.turned(local)
            rows[i] = *cross(out, at.normal), 0.0, 0.0, 0.0
            bias[i] = dot(gradient, out)

    def forces_at(self, points: Sequence[Vector], forces: FloatArray) -> list[Vector]:  # noqa: ARG002
        """See :class:`~.hold.Hold`."""
        return [scaled(size, self._at.normal) for size in self._of_points.dot(forces).tolist()]

    def accelerations(self, G: FloatArray, forces: FloatArray) -> list[float]:
        """How much the force of each point accelerates its own gap, m/s^2, (k,).

        Args:
            G: Delassus matrix of the rows, 1/kg, (m, m).
            forces: Forces along them, N, (m,).
        """
        C = self._of_points
        inverse_masses: list[float] = (C.dot(G) * C).sum(axis=1).tolist()
        sizes: list[float] = C.dot(forces).tolist()
        return [size * each for size, each in zip(sizes, inverse_masses, strict=True)]
