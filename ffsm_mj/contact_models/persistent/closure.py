"""When a pair closes: tolerances on its gap rate, and the test for contact at rest."""

from __future__ import annotations

import numpy as np

from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.tolerances import CLOSED_RATE, CONTACT_GAP_M, FEATURE_BOUND_M, RATE

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
