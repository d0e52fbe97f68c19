"""When a pair closes: tolerances on its gap rate, the test for contact at rest, and the pairs to be tested."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import TypeAlias

import numpy as np

from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.contact_models.impact.closed_pairs import ClosedPairs
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.tolerances import CLEARLY_APART_M, CLOSED_RATE, CONTACT_GAP_M, FEATURE_BOUND_M, RATE

ClosingPair: TypeAlias = tuple[UnilateralConstraint, Proximity, float]
"""A pair, its gap and normal, and the gap rate in m/s below which it is at rest."""

_REST_SHARE = 1e-9
"""Post-impact normal velocities below this share of the approach velocity are rounding: the contact is at rest."""
_LEAST_RADIUS_M = 1e-4
"""Smallest radius of curvature assumed where a rounded geom slides over an edge, m."""


def rate_tolerance(near: Proximity, approach: float) -> float:
    """Gap rates below this are rounding after an impact with a given approach speed, m/s."""
    return near.rate_tolerance + _REST_SHARE * approach


def held_rate_tolerance(near: Proximity) -> float:
    """The same for a closed pair: its gap rate drifts by the truncation error of a step until the next projection."""
    return CLOSED_RATE / RATE * near.rate_tolerance


def switched_rate_tolerance(near: Proximity) -> float:
    """The same for a pair that left a feature by FEATURE_BOUND_M: on a round geom the normal has turned by that / radius."""
    return FEATURE_BOUND_M / _LEAST_RADIUS_M / RATE * near.rate_tolerance


def closed_and_still(near: Proximity, still: float) -> bool:
    """Whether a pair is in contact and one of its points neither approaches nor separates."""
    return near.gap <= CONTACT_GAP_M and bool(np.abs(near.rates).min() <= still)


def closed_after_change(pairs: ClosedPairs, held: Collection[UnilateralConstraint]) -> Iterator[ClosingPair]:
    """Pairs in contact after a change of motion; those in ``held`` were closed before it."""
    for pair, near in pairs:
        # A deeper overlap at release is not a closed contact: the impact model resolves it.
        if abs(near.gap) <= CONTACT_GAP_M:
            yield pair, near, held_rate_tolerance(near) if pair in held else near.rate_tolerance


def closed_at(
    scene: Scene, pairs: Sequence[UnilateralConstraint], held: Sequence[UnilateralConstraint]
) -> Iterator[ClosingPair]:
    """Pairs near contact at the state in ``data``; those in ``held`` were closed before it."""
    model, data = scene.system.mj, scene.data
    for pair in pairs:
        if pair.gap(model, data, 1.0) <= CLEARLY_APART_M:
            near = pair.proximity(model, data)
            yield pair, near, held_rate_tolerance(near) if pair in held else near.rate_tolerance
