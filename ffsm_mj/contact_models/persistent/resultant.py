"""Resultant contact force of a pair at one state, and its centre of pressure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from ffsm_mj.contact_models.persistent.point_rows import PointRows


class Resultant(NamedTuple):
    """Resultant contact force of a pair at one state.

    Attributes:
        force: Force on geom b, N, (3,).
        centre: Centre of pressure; mean of the contact points if none carries force, m, (3,).
        normal: Mean unit normal, (3,).
        contact_points: The contact points.
    """

    force: FloatArray
    centre: FloatArray
    normal: FloatArray
    contact_points: Sequence[ContactPoint] = ()

    @property
    def points(self) -> int:
        """Number of contact points."""
        return len(self.contact_points)

    @property
    def mode(self) -> str:
        """Their features."""
        return " + ".join(dict.fromkeys(contact.feature.name for contact in self.contact_points))

    @property
    def size(self) -> float:
        """Norm of the force, N."""
        return math.hypot(*self.force.tolist())


def resultant(
    contact_points: Sequence[ContactPoint],
    rows: PointRows,
    forces: FloatArray,
    part: slice,
    friction: FloatArray | None = None,
) -> Resultant:
    """Resultant over the contact points of one pair, of normal forces (k,) and friction forces (k, 3)."""
    return Resultant(*rows.resultant(part, forces, friction), contact_points[part])


def points_of(pair: UnilateralConstraint, contact_points: Sequence[ContactPoint]) -> slice:
    """The contact points of one pair, which are consecutive."""
    start = next((i for i, contact in enumerate(contact_points) if contact.pair is pair), 0)
    end = start
    while end < len(contact_points) and contact_points[end].pair is pair:
        end += 1
    return slice(start, end)
