"""Pairs that touch at one instant, and the points at which they do: in one order for resolution, rest and record."""

from __future__ import annotations

from collections.abc import Sequence

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact.proximity import Proximity

Touching = Sequence[tuple[ContactPair, Proximity]]


def touching_points(touching: Touching) -> list[tuple[ContactPair, Proximity, FloatArray]]:
    """Every point at which a pair touches, with its pair, in m and world axes."""
    return [(pair, near, point) for pair, near in touching for point in near.points]
