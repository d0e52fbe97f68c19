"""Points of one pair that all stick, not on a line: they hold the whole twist of two bodies.

Where all three axes of each of k points are held, and moments are about the middle of the points,

    W^T W = diag(S, k),   S = sum(|r|^2 - r r^T) over the arms r

which does not change in axes of b while they stick.

Bodies that stick have no relative twist. Where stages have one, of the order of the step, its rate is zero all the same: the
motion differs from that with rows of points by less than the error of the method.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.body_motion import Vector, shifted, turned
from ffsm_mj.contact_models.persistent.friction.linear_systems import cholesky_factor
from ffsm_mj.dynamics.body_twists import PairTwist

_UNIT: FloatArray = np.eye(3)
_FLAT = 1e-6
"""Points are on a line where a pivot of S is below this share of the largest."""


class StuckPatch:
    """At least three points.

    Attributes:
        count: See :class:`~.hold.Hold`.
    """

    count = 6

    def __init__(self, body_b: int, data: Any) -> None:
        """Take views of the arrays of ``data``, that of the logged system, for its body b; MuJoCo does not move them."""
        self._origin, self._flat_axes = data.xpos[body_b], data.xmat[body_b]
        self._axes = self._flat_axes.reshape(3, 3)
        self._middle: Vector
        self._turns: FloatArray
        self._springs: FloatArray
        self._displaced: FloatArray
        self._place: Vector
        self._root = 0.0

    def begin(self, points: FloatArray) -> bool:
        """See :class:`~.hold.Hold`: points on a line do not hold the twist."""
        k = len(points)
        places = (points - self._origin).dot(self._axes)
        middle, self._root = places.sum(axis=0) / k, math.sqrt(k)
        self._middle, self._displaced = tuple(middle.tolist()), self._root * _UNIT
        arms = places - middle
        squares = arms.T.dot(arms)
        factor = cholesky_factor((squares[0, 0] + squares[1, 1] + squares[2, 2]) * _UNIT - squares, _FLAT)
        if factor is None:
            return False
        self._turns, self._springs = factor.T, np.asarray(np.linalg.inv(factor.T), dtype=np.float64)
        return True

    def write(self, twist: PairTwist, rows: FloatArray, bias: FloatArray) -> None:
        """See :class:`~.hold.Hold`: factor of S times the angular velocity, sqrt(k) times the velocity at the middle."""
        root, (x, y, z) = self._root, self._origin.tolist()
        u, v, w = self._place = shifted((x, y, z), 1.0, turned(self._flat_axes.tolist(), self._middle))
        i, j, k = twist.b.centre
        a, b, c = root * (u - i), root * (v - j), root * (w - k)
        rows[:3, :3], rows[3:, 3:] = self._turns.dot(self._axes.T), self._displaced
        rows[3:, :3] = (0.0, c, -b), (-c, 0.0, a), (b, -a, 0.0)
        np.dot(rows, twist.alpha + twist.acceleration, out=bias)

    def forces_at(self, points: Sequence[Vector], forces: FloatArray) -> list[Vector]:
        """See :class:`~.hold.Hold`: those of springs at the points under a turn and a displacement at the middle."""
        a, b, c = self._axes.dot(self._springs.dot(forces[:3])).tolist()
        x, y, z = (forces[3:] / self._root).tolist()
        # Those of the points are a shift of that at the origin of the turn.
        i, j, k = self._place
        x, y, z = x - b * k + c * j, y - c * i + a * k, z - a * j + b * i
        return [(x + b * w - c * v, y + c * u - a * w, z + a * v - b * u) for u, v, w in points]
