"""Unit forces at contact points as wrenches: velocities at the points are these times the relative twist of two bodies.

The velocity along an axis d at the arm r from the centre of the twist (omega, v) is d . (v + omega x r) = (r x d) . omega +
d . v: the row (r x d, d) is the moment and the force of a unit force along d there. The same rows take the rates of a twist
to accelerations and, transposed, forces at points to their resultant.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.body_twists import Vector

Wrench = tuple[float, float, float, float, float, float]
"""Force, and moment about the world origin."""


class WrenchRows(NamedTuple):
    """Wrench rows of all contact points at one state.

    Attributes:
        rows: Moment and force of a unit force along each row, (r, 6).
        parts: Rows of each group of points.
        centres: Point about which the moments of each group are, m.
    """

    rows: FloatArray
    parts: Sequence[slice]
    centres: Sequence[Vector]

    def resultants(self, forces: FloatArray) -> list[Wrench]:
        """Resultant on geom b of each group of points, for forces along the rows, N, (r,)."""
        found = []
        for part, (i, j, k) in zip(self.parts, self.centres, strict=True):
            a, b, c, x, y, z = forces[part].dot(self.rows[part]).tolist()
            found.append((x, y, z, a + j * z - k * y, b + k * x - i * z, c + i * y - j * x))
        return found


def _of_unit_axes() -> FloatArray:
    """Rows of unit axes at the three unit arms, and at the centre, (3, 4, 6)."""
    rows = np.zeros((3, 4, 6))
    rows[:, :3, :3] = np.cross(np.eye(3), np.eye(3)[:, None])
    rows[:, 3, 3:] = np.eye(3)
    return rows


_UNIT: FloatArray = _of_unit_axes().reshape(3, 24)


def normal_wrench_rows(normal: Vector, places: FloatArray) -> FloatArray:
    """Rows along one axis at several places, (m, 6): :func:`wrench_rows` for a single axis."""
    rows: FloatArray = places.dot(np.array(normal).dot(_UNIT).reshape(4, 6))
    return rows


def wrench_rows(axes: FloatArray, places: FloatArray) -> FloatArray:
    """Rows along the same axes at several places, (m, n, 6).

    Args:
        axes: Axes, (n, 3).
        places: Arms from the centre, m, and a one, (m, 4).
    """
    n = len(axes)
    per_place = axes.dot(_UNIT).reshape(n, 4, 6).transpose(1, 0, 2).reshape(4, 6 * n)
    rows: FloatArray = places.dot(per_place).reshape(-1, n, 6)
    return rows
