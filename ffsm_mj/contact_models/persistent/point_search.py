"""Search for the contact points of pairs: features that touch at rest, and those that separate slowly."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact.features.gap_function import FeatureState
from ffsm_mj.contact.features.search import features, features_at_rest
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from ffsm_mj.tolerances import FEATURE_BOUND_M, PARALLEL

_SLOW_M_S = 1e-3
"""Only contacts that separate below this speed may stay closed for their small lift-off."""


def points_at_rest(scene: Scene, pair: UnilateralConstraint, near: Proximity, still: float) -> tuple[ContactPoint, ...]:
    """Features of a pair with gap 0 and a gap rate of at most ``still`` in m/s.

    Args:
        scene: The logged system and its data.
        pair: Two geoms, or a joint limit.
        near: Their proximity at the state in ``data``.
        still: Gap rates within this of zero are rounding.
    """
    data = scene.data
    if isinstance(pair, JointLimit):
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

    found = features_at_rest(pair, scene.system.mj, data, near, is_still)
    return tuple(ContactPoint(pair, feature) for feature in found)


def slow_points(
    scene: Scene, pairs: Sequence[tuple[UnilateralConstraint, Proximity]], held: Sequence[ContactPoint]
) -> list[tuple[ContactPoint, float]]:
    """Contact points of some pairs that separate slowly, with the rates of their gaps, m/s; without those held already."""
    model, data = scene.system.mj, scene.data
    found = [
        ContactPoint(pair, feature)
        for pair, near in pairs
        for feature in ((pair.feature,) if isinstance(pair, JointLimit) else features(pair, model, data, near))
    ]
    return [
        (contact, at.rate)
        for contact in found
        if 0.0 < (at := contact.feature.at(data)).rate <= _SLOW_M_S and not _is_among(held, contact, at, data)
    ]


def _is_among(held: Sequence[ContactPoint], new: ContactPoint, at: FeatureState, data: Any) -> bool:
    """Whether some contact points have one at this position, or this joint limit."""
    if isinstance(new.pair, JointLimit):
        return any(contact.pair is new.pair for contact in held)
    return any(math.dist(contact.feature.at(data).point, at.point) < FEATURE_BOUND_M for contact in held)
