"""When a pair closes, and where: tolerances on its gap rate, features that touch at rest or separate slowly, refusals."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Any, TypeAlias

import numpy as np

from ffsm_mj.contact.features.gap_function import FeatureState
from ffsm_mj.contact.features.search import features, features_at_rest
from ffsm_mj.contact.pairs import UnilateralConstraint
from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.contact_models.impact.resolution import ClosedPairs
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.tolerances import (
    CLEARLY_APART_M,
    CLOSED_RATE,
    CONTACT_GAP_M,
    FEATURE_BOUND_M,
    PARALLEL,
    RATE,
)

ClosingPair: TypeAlias = tuple[UnilateralConstraint, Proximity, float]
"""A pair, its gap and normal, and the gap rate in m/s below which it is at rest."""
_REST_SHARE = 1e-9
"""Post-impact normal velocities below this share of the approach velocity are rounding: the contact is at rest."""
_LEAST_RADIUS_M = 1e-4
"""Smallest radius of curvature assumed where a rounded geom slides over an edge, m."""
_OTHER_MODEL = "the motion uses another model than the scenario's, and no grasp of the scenario is closed in it"
_SLOW_M_S = 1e-3
"""Only contacts that separate below this speed may stay closed for their small lift-off."""


def rate_tolerance(near: Proximity, approach: float) -> float:
    """Gap rates below this are rounding after an impact with a given approach speed, m/s."""
    return near.rate_tolerance + _REST_SHARE * approach


def closed_rate_tolerance(near: Proximity) -> float:
    """The same for a closed pair: its gap rate drifts by the truncation error of a step until the next projection."""
    return CLOSED_RATE / RATE * near.rate_tolerance


def switched_rate_tolerance(near: Proximity) -> float:
    """The same for a pair that left a feature by FEATURE_BOUND_M: on a round geom the normal has turned by that / radius."""
    return FEATURE_BOUND_M / _LEAST_RADIUS_M / RATE * near.rate_tolerance


def closed_and_still(near: Proximity, still: float) -> bool:
    """Whether a pair is in contact and one of its points neither approaches nor separates."""
    # One point at rest is enough: the others of a patch may lift off, as those of a block that rocks on an edge.
    return near.gap <= CONTACT_GAP_M and bool(np.abs(near.rates).min() <= still)


def closed_after_change(pairs: ClosedPairs, closed: Collection[UnilateralConstraint]) -> Iterator[ClosingPair]:
    """Pairs in contact after a change of motion; those in ``closed`` were closed before it."""
    for pair, near in pairs:
        # A deeper overlap at release is not a closed contact: the impact model resolves it.
        if abs(near.gap) <= CONTACT_GAP_M:
            # The rates of a closed pair have drifted with the steps; a new one must be at rest to rounding.
            yield pair, near, closed_rate_tolerance(near) if pair in closed else near.rate_tolerance


def closed_at(
    scene: Scene, pairs: Sequence[UnilateralConstraint], closed: Sequence[UnilateralConstraint]
) -> Iterator[ClosingPair]:
    """Pairs near contact at the state in ``data``; those in ``closed`` were closed before it."""
    model, data = scene.system.mj, scene.data
    for pair in pairs:
        # The distance query may be wrong by DISTANCE_QUERY_M: at ten times that it leaves out no pair in contact.
        if pair.gap(model, data) <= CLEARLY_APART_M:
            for near in pair.proximities(model, data):
                yield pair, near, closed_rate_tolerance(near) if pair in closed else near.rate_tolerance


def refusal_in(motion: Motion, scene: Scene) -> str:
    """Why no pair of a scene can stay in contact in a motion; empty if all can."""
    if motion.data is not scene.data and not motion.grasp:
        return _OTHER_MODEL
    return ""


def by_pair(closing: Iterable[ClosingPair]) -> dict[UnilateralConstraint, list[tuple[Proximity, float]]]:
    """Patches with their tolerances by pair."""
    patches: dict[UnilateralConstraint, list[tuple[Proximity, float]]] = {}
    for pair, near, still in closing:
        patches.setdefault(pair, []).append((near, still))
    return patches


def points_at_rest(scene: Scene, pair: UnilateralConstraint, near: Proximity, still: float) -> tuple[ContactPoint, ...]:
    """Features of a pair with gap 0 and a gap rate of at most ``still`` in m/s.

    Args:
        scene: The logged system and its data.
        pair: Two geoms, or a joint limit.
        near: Their proximity at the state in ``data``.
        still: Gap rates within this of zero are rounding.
    """
    data = scene.data
    if pair.is_limit:
        return (ContactPoint(pair, pair.feature),) if abs(near.rate) <= still else ()

    def is_still(at: FeatureState) -> bool:
        if abs(at.rate) <= still:
            return True
        # An edge that lies on a cap is parallel to it only to about 1e-10 rad, and the normals at its ends differ by as
        # much. Impacts act along the normal of the pair: at a slip of 0.3 m/s they leave gap rates of 3e-11 m/s. The
        # normals at both ends of round sides along each other differ by more.
        parallel = math.dist(at.normal, near.normal) <= max(PARALLEL, pair.flush_angle)
        place = near.point_at(at.point, pair.flush_offset)
        return parallel and abs(pair.rate_along(data, near.normal, place)) <= still

    resting = features_at_rest(pair, scene.system.mj, data, near, is_still)
    return tuple(ContactPoint(pair, feature, near.patch) for feature in resting)


def slow_points(
    scene: Scene, pairs: Sequence[tuple[UnilateralConstraint, Proximity]], closed: Sequence[ContactPoint]
) -> list[tuple[ContactPoint, float]]:
    """Contact points of some pairs that separate slowly, with the rates of their gaps, m/s; without those closed already."""
    model, data = scene.system.mj, scene.data
    points = [
        ContactPoint(pair, feature, near.patch)
        for pair, near in pairs
        # The features of a patch of unions are at its points: where all of these separate fast, none is looked for. Normals
        # of features differ from that of the patch by PARALLEL: so do rates, as a share of speeds far below 1000 m/s.
        if pair.is_limit or not pair.has_pieces or near.rate <= 2.0 * _SLOW_M_S
        for feature in ((pair.feature,) if pair.is_limit else features(pair, model, data, near))
    ]
    return [
        (contact, at.rate)
        for contact in points
        # Points that approach are left to an impact: only a separation can be stopped by the load before it counts.
        if 0.0 < (at := contact.feature.at(data)).rate <= _SLOW_M_S and not _is_among(closed, contact, at, data)
    ]


def _is_among(points: Sequence[ContactPoint], new: ContactPoint, at: FeatureState, data: Any) -> bool:
    """Whether some contact points have one at this position, or this joint limit."""
    if new.pair.is_limit:
        return any(contact.pair is new.pair for contact in points)
    # A corner at the bounds of two features is found by both: closed twice, it would bear two shares of the load.
    return any(math.dist(contact.feature.at(data).point, at.point) < FEATURE_BOUND_M for contact in points)
