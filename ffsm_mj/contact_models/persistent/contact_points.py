"""Contact points, and which of them are evaluated together: points on one face, or a single one.

Two bodies that are held at three points of a flat patch do not tilt relative to each other: their normals turn alike. The
second rates of all gaps of a patch are taken with the normal of body a, so that they are affine in the place to rounding.
The exact second rate at a point that moves over both bodies, as where two edges cross, differs by its speed times their rate
of tilt. To rounding the latter is that of a gap over the width of the patch, and in a patch that slides over the edge of a
face both would grow without bound: a tilt times the width, which is a difference of gaps, would be kept constant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact.features.gap_function import Feature, FeatureState
from ffsm_mj.contact.features.point_line_gaps import PointOnFace


@dataclass(frozen=True, eq=False)
class ContactPoint:
    """One contact feature of a pair, or a joint limit."""

    pair: UnilateralConstraint
    feature: Feature


def over_one_face(one: Feature, other: Feature) -> bool:
    """Whether two features are points of one body over the same face of another."""
    return (
        isinstance(one, PointOnFace)
        and isinstance(other, PointOnFace)
        and one.point.body is other.point.body
        and one.swapped == other.swapped
        and one.face == other.face
    )


def point_runs(contact_points: Sequence[ContactPoint]) -> list[slice]:
    """Runs of contact points that are evaluated together."""
    starts = [
        i
        for i, each in enumerate(contact_points)
        if i == 0
        or each.pair is not contact_points[i - 1].pair
        or not over_one_face(contact_points[i - 1].feature, each.feature)
    ]
    return [slice(start, end) for start, end in pairwise([*starts, len(contact_points)])]


class GroupState(Protocol):
    """The m points of a group at one state.

    Attributes:
        count: Number of points, m.
        states: States of the features.
        gaps: Gaps, m.
        rates: Their rates, m/s.
        scales: Largest terms of the curvature, m/s^2.
        insides: Distances to the bounds of the features, m.
        normals: Normals from a to b, (m, 3).
        points: Points of application of the forces, (m, 3).
    """

    count: int

    @property
    def gaps(self) -> Sequence[float]: ...  # noqa: D102

    @property
    def rates(self) -> Sequence[float]: ...  # noqa: D102

    @property
    def scales(self) -> Sequence[float]: ...  # noqa: D102

    @property
    def insides(self) -> Sequence[float]: ...  # noqa: D102

    @property
    def states(self) -> Sequence[FeatureState]: ...  # noqa: D102

    @property
    def normals(self) -> FloatArray: ...  # noqa: D102

    @property
    def points(self) -> FloatArray: ...  # noqa: D102

    def normal_rows(self, rows: FloatArray, gamma: FloatArray) -> None:
        """Write the wrench rows of the normals, (m, 6), and the second rates of the gaps at qacc = 0, (m,)."""
        ...

    def frictional_rows(self, axes: FloatArray, rows: FloatArray, gamma: FloatArray) -> None:
        """Write the wrench rows of the normals and of two tangents; see ``single_point.py``.

        Args:
            axes: Normal and tangents of all points, (3, 3).
            rows: Rows about the centre of b, (m, 3, 6).
            gamma: Second rates of the gaps, and rates of the relative velocity at the contact points, which move over both
                surfaces, at qacc = 0, (m, 3).
        """
        ...
