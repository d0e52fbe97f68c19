"""Conditions that contact points put on the relative twist of two bodies, with as few rows as they have."""

from __future__ import annotations

from typing import Protocol

from ffsm_mj.arrays import FloatArray
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
