"""Contact points, which of them are evaluated together on one face, and rows and rates of a single one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple, TypeAlias

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.body_motion import Vector, cross, dot, minus, shifted
from ffsm_mj.contact.features.gap_function import Feature, FeatureState
from ffsm_mj.contact.features.point_line_gaps import PointOnFace
from ffsm_mj.contact.pairs import UnilateralConstraint
from ffsm_mj.dynamics.body_twists import BodyTwist, PairTwist

Patch: TypeAlias = tuple[UnilateralConstraint, str]
"""A pair, and the name of one of its patches."""


@dataclass(frozen=True, eq=False)
class ContactPoint:
    """One contact feature of a pair, or a joint limit.

    Attributes:
        pair: The pair.
        feature: The feature.
        patch: Name of its patch among those of a pair of unions; empty for other pairs, which have one.
    """

    pair: UnilateralConstraint
    feature: Feature
    patch: str = ""

    @property
    def flat_on(self) -> Patch:
        """What points have in common that may be on one face."""
        return self.pair, self.patch


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
    # Points over one face are one group of the core: the twists of both bodies give the rows of all of them.
    starts = [
        i
        for i, point in enumerate(contact_points)
        if i == 0
        or point.flat_on != contact_points[i - 1].flat_on
        or not over_one_face(contact_points[i - 1].feature, point.feature)
    ]
    return [slice(start, end) for start, end in pairwise([*starts, len(contact_points)])]


class SinglePoint:
    """A contact point by itself, or a joint limit: its normal is zero, and so are the rows that this gives."""

    def __init__(self, feature: Feature, *, in_patch: bool) -> None:
        """Store the feature."""
        self._feature, self._in_patch = feature, in_patch

    def at_state(self, data: Any, twist: PairTwist) -> SingleState:
        """Evaluate at the state in ``data``, with the twist of both bodies there."""
        state = self._feature.at(data)
        return SingleState(_in_patch(state, twist) if self._in_patch else state, twist)


class SingleState:
    """A contact point at one state, as a group of one: m = 1. Points over one face are a group of the core.

    The velocity along an axis d at the arm r from the centre of the twist (omega, v) is d . (v + omega x r) = (r x d) .
    omega + d . v: the row (r x d, d) is the moment and the force of a unit force along d there. The same row takes the rates
    of a twist to accelerations and, transposed, a force at the point to its resultant.

    Attributes:
        count: Number of points, m.
        states: States of the features.
        gaps: Gaps, m.
        rates: Their rates, m/s.
        scales: Largest terms of the curvature, m/s^2.
        insides: Distances to the bounds of the features, m.
    """

    def __init__(self, state: FeatureState, twist: PairTwist) -> None:
        """Store its state and the twist of both bodies."""
        self.states, self.count = (state,), 1
        self.gaps, self.rates, self.scales, self.insides = (state.gap,), (state.rate,), (state.scale,), (state.inside,)
        self._state, self._twist = state, twist
        x, y, z = state.point.tolist()
        self._arm = minus((x, y, z), twist.b.centre)

    @property
    def normals(self) -> FloatArray:
        """Normals from a to b, (m, 3)."""
        return self._state.normal[None]

    @property
    def points(self) -> FloatArray:
        """Points of application of the forces, m, (m, 3)."""
        return self._state.point[None]

    def normal_rows(self, rows: FloatArray, gamma: FloatArray) -> None:
        """Write the wrench rows of the normals, (m, 6), and the second rates of the gaps at qacc = 0, (m,)."""
        x, y, z = self._state.normal.tolist()
        rows[0] = *cross(self._arm, (x, y, z)), x, y, z
        gamma[0] = self._normal_gamma()

    def _normal_gamma(self) -> float:
        """Acceleration of the material points along the normal, and the curvature terms of the moving contact point."""
        state = self._state
        x, y, z = state.normal.tolist()
        of_b = _acceleration((x, y, z), self._twist.b, state.point_b)
        return of_b - _acceleration((x, y, z), self._twist.a, state.point_a) + state.bend

    def frictional_rows(self, axes: FloatArray, rows: FloatArray, gamma: FloatArray) -> None:
        """Write the wrench rows of the normals and of two tangents.

        Args:
            axes: Normal and tangents of all points, (3, 3).
            rows: Rows about the centre of b, (m, 3, 6).
            gamma: Second rates of the gaps, and rates of the relative velocity at the contact points, which move over both
                surfaces, at qacc = 0, (m, 3).
        """
        twist, (u, v, w) = self._twist, self._state.point_rate
        for row, (x, y, z) in zip(rows[0], axes.tolist(), strict=True):
            row[:] = *cross(self._arm, (x, y, z)), x, y, z
        passing = shifted(twist.acceleration, 1.0, cross(twist.alpha, self._arm))
        # With the velocity of the contact point, which moves over both bodies: rows of a point fixed to one bend the path of
        # a sphere that rolls and spins (docs/derivations.md).
        gamma[0] = axes.dot(shifted(passing, 1.0, cross(twist.omega, (u, v, w))))
        # The normal turns, too: the second rate of the gap has n' . u besides n . u'.
        gamma[0, 0] = self._normal_gamma()


def _acceleration(axis: Vector, body: BodyTwist, point: FloatArray) -> float:
    """Acceleration of a material point along an axis at qacc = 0, m/s^2: a + alpha x r + omega x (v + omega x r)."""
    x, y, z = point.tolist()
    arm, omega = minus((x, y, z), body.centre), body.omega
    passing = shifted(body.velocity, 1.0, cross(omega, arm))
    spatial = shifted(body.acceleration, 1.0, cross(body.alpha, arm))
    return dot(axis, spatial) + dot(axis, cross(omega, passing))


def _in_patch(state: FeatureState, twist: PairTwist) -> FeatureState:
    """The state of a point of a flat patch, whose normal turns with body a.

    Two bodies that are held at three points of a flat patch do not tilt relative to each other: their normals turn alike.
    The second rates of all gaps of a patch are taken with the normal of body a, so that they are affine in the place to
    rounding. The exact second rate at a point that moves over both bodies, as where two edges cross, differs by its speed
    times their rate of tilt. To rounding the latter is that of a gap over the width of the patch, and in a patch that slides
    over the edge of a face both would grow without bound: a tilt times the width, which is a difference of gaps, would be
    kept constant.
    """
    (x, y, z), (i, j, k) = state.point.tolist(), state.normal.tolist()
    w = shifted(twist.velocity, 1.0, cross(twist.omega, minus((x, y, z), twist.b.centre)))
    # The cross term 2 n' . u in the second derivative of n . (x_b - x_a), with n' = omega_a x n.
    bend = 2.0 * dot(cross(twist.a.omega, (i, j, k)), w)
    return state._replace(point_a=state.point, point_b=state.point, bend=bend, scale=max(state.scale, abs(bend)))


class Extremes(NamedTuple):
    """Extremes over some contact points.

    Attributes:
        inside: Smallest distance to the bounds of a feature, m.
        gap: Largest absolute gap, m.
        rate: Largest absolute rate of a gap, m/s.
        lowest: Smallest gap, m.
    """

    inside: float
    gap: float
    rate: float
    lowest: float
