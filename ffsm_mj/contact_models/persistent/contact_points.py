"""Contact points, which of them are evaluated together on one face, and rows and rates of a single one.

Two bodies that are held at three points of a flat patch do not tilt relative to each other: their normals turn alike. The
second rates of all gaps of a patch are taken with the normal of body a, so that they are affine in the place to rounding.
The exact second rate at a point that moves over both bodies, as where two edges cross, differs by its speed times their rate
of tilt. To rounding the latter is that of a gap over the width of the patch, and in a patch that slides over the edge of a
face both would grow without bound: a tilt times the width, which is a difference of gaps, would be kept constant.

The velocity along an axis d at the arm r from the centre of the twist (omega, v) is d . (v + omega x r) = (r x d) . omega +
d . v: the row (r x d, d) is the moment and the force of a unit force along d there. The same row takes the rates of a twist
to accelerations and, transposed, a force at the point to its resultant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact.features.body_motion import Vector, cross, dot, minus, shifted
from ffsm_mj.contact.features.gap_function import Feature, FeatureState
from ffsm_mj.contact.features.point_line_gaps import PointOnFace
from ffsm_mj.dynamics.body_twists import BodyTwist, PairTwist


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


class SinglePoint:
    """A contact point by itself, or a joint limit: its normal is zero, and so are the rows that this gives."""

    def __init__(self, feature: Feature, *, in_patch: bool) -> None:
        """Store the feature."""
        self._feature, self._in_patch = feature, in_patch

    def at_state(self, data: Any, twist: PairTwist) -> SingleState:
        """Evaluate at the state in ``data``, with the twist of both bodies there."""
        here = self._feature.at(data)
        return SingleState(_in_patch(here, twist) if self._in_patch else here, twist)


class SingleState:
    """A contact point at one state, as a group of one: m = 1. Points over one face are a group of the core.

    Attributes:
        count: Number of points, m.
        states: States of the features.
        gaps: Gaps, m.
        rates: Their rates, m/s.
        scales: Largest terms of the curvature, m/s^2.
        insides: Distances to the bounds of the features, m.
    """

    def __init__(self, here: FeatureState, twist: PairTwist) -> None:
        """Store its state and the twist of both bodies."""
        self.states, self.count = (here,), 1
        self.gaps, self.rates, self.scales, self.insides = (here.gap,), (here.rate,), (here.scale,), (here.inside,)
        self._here, self._twist = here, twist
        x, y, z = here.point.tolist()
        self._arm = minus((x, y, z), twist.b.centre)

    @property
    def normals(self) -> FloatArray:
        """Normals from a to b, (m, 3)."""
        return self._here.normal[None]

    @property
    def points(self) -> FloatArray:
        """Points of application of the forces, m, (m, 3)."""
        return self._here.point[None]

    def normal_rows(self, rows: FloatArray, gamma: FloatArray) -> None:
        """Write the wrench rows of the normals, (m, 6), and the second rates of the gaps at qacc = 0, (m,)."""
        x, y, z = self._here.normal.tolist()
        rows[0] = *cross(self._arm, (x, y, z)), x, y, z
        gamma[0] = self._normal_gamma()

    def _normal_gamma(self) -> float:
        """Acceleration of the material points along the normal, and the curvature terms of the moving contact point."""
        here = self._here
        x, y, z = here.normal.tolist()
        own = _acceleration((x, y, z), self._twist.b, here.point_b)
        return own - _acceleration((x, y, z), self._twist.a, here.point_a) + here.bend

    def frictional_rows(self, axes: FloatArray, rows: FloatArray, gamma: FloatArray) -> None:
        """Write the wrench rows of the normals and of two tangents.

        Args:
            axes: Normal and tangents of all points, (3, 3).
            rows: Rows about the centre of b, (m, 3, 6).
            gamma: Second rates of the gaps, and rates of the relative velocity at the contact points, which move over both
                surfaces, at qacc = 0, (m, 3).
        """
        twist, (u, v, w) = self._twist, self._here.point_rate
        rows[0, :, :3], rows[0, :, 3:] = np.cross(self._arm, axes), axes
        passing = shifted(twist.acceleration, 1.0, cross(twist.alpha, self._arm))
        gamma[0] = axes.dot(shifted(passing, 1.0, cross(twist.omega, (u, v, w))))
        gamma[0, 0] = self._normal_gamma()


def _acceleration(axis: Vector, body: BodyTwist, point: FloatArray) -> float:
    """Acceleration of a material point along an axis at qacc = 0, m/s^2: a + alpha x r + omega x (v + omega x r)."""
    x, y, z = point.tolist()
    arm, omega = minus((x, y, z), body.centre), body.omega
    passing = shifted(body.velocity, 1.0, cross(omega, arm))
    spatial = shifted(body.acceleration, 1.0, cross(body.alpha, arm))
    return dot(axis, spatial) + dot(axis, cross(omega, passing))


def _in_patch(here: FeatureState, twist: PairTwist) -> FeatureState:
    """The state of a point of a flat patch, whose normal turns with body a."""
    (x, y, z), (i, j, k) = here.point.tolist(), here.normal.tolist()
    w = shifted(twist.velocity, 1.0, cross(twist.omega, minus((x, y, z), twist.b.centre)))
    bend = 2.0 * dot(cross(twist.a.omega, (i, j, k)), w)
    return here._replace(point_a=here.point, point_b=here.point, bend=bend, scale=max(here.scale, abs(bend)))
