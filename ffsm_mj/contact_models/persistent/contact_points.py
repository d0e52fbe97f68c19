"""Contact points of pairs and joint limits, and which of them are evaluated together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact.features.gap_function import Feature
from ffsm_mj.contact.features.points_on_face import PointsOnFace


@dataclass(frozen=True, eq=False)
class ContactPoint:
    """One contact feature of a pair, or a joint limit."""

    pair: UnilateralConstraint
    feature: Feature


def point_runs(contact_points: Sequence[ContactPoint]) -> list[slice]:
    """Runs of contact points that are evaluated together."""
    starts = [
        i
        for i, each in enumerate(contact_points)
        if i == 0
        or each.pair is not contact_points[i - 1].pair
        or not PointsOnFace.together(contact_points[i - 1].feature, each.feature)
    ]
    return [slice(start, end) for start, end in pairwise([*starts, len(contact_points)])]
