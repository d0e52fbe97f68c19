"""Conditions that contact points put on the relative twist of two bodies, with as few rows as they have."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.body_motion import Vector
from ffsm_mj.dynamics.body_twists import PairTwist


class Hold(Protocol):
    """Points of one pair that are held together.

    With the rows B of the hold and W of the points, all about one place, B^T B = W^T W: forces of least norm along B are the
    resultants of those of least norm at the points.

    Attributes:
        count: Number of rows, m.
    """

    count: int

    def begin(self, points: FloatArray) -> bool:
        """Begin a step with the points at the current state, m, (k, 3); returns whether the rows hold them."""
        ...

    def write(self, twist: PairTwist, rows: FloatArray, bias: FloatArray) -> None:
        """Write what is held at the current state.

        Args:
            twist: Twists of both bodies there.
            rows: Rows over the relative twist about the centre of b: moments and forces of unit forces, (m, 6).
            bias: Their accelerations at zero joint accelerations, (m,).
        """
        ...

    def forces_at(self, points: Sequence[Vector], forces: FloatArray) -> list[Vector]:
        """Forces of least norm on b at the points, world axes, N, at the state of the rows.

        Args:
            points: The points, m, k of them.
            forces: Forces along the rows, N, (m,).
        """
        ...
