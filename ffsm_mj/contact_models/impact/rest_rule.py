"""Rule (10): an impact brings a contact to rest if its next flight would be shorter than a time that the scenario states.

A contact that separates at speed u and is pressed at b (:mod:`.pressing`) is in flight for 2 u / b.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.impact.closed_pairs import ClosedPairs, contact_points
from ffsm_mj.contact_models.impact.pressing import pressing_accelerations
from ffsm_mj.contact_models.impact.resolution import Impact
from ffsm_mj.dynamics.motion import Motion


@dataclass(frozen=True)
class RestRule:
    """When an impact brings a contact to rest.

    Attributes:
        interval_s: Flights shorter than this are omitted, s.
        speed_m_s: Contacts that separate slower than this come to rest too, m/s.
    """

    interval_s: float
    speed_m_s: float

    def least_speeds(self, pressing: FloatArray) -> FloatArray:
        """Separation speeds below which contacts pressed at these accelerations come to rest, m/s, (k,)."""
        return np.maximum(self.speed_m_s, 0.5 * self.interval_s * pressing)


@dataclass(frozen=True)
class RestingResult:
    """An impact under the rest rule.

    Attributes:
        impact: The resolved impact.
        used: Coefficient of restitution used for each contact: 0 if it comes to rest, (k,).
        pressing: Acceleration b that presses each contact, m/s^2, (k,).
        speeds: Separation speed that each contact at rest would have had without the rule, m/s, (k,); 0 for the others.
    """

    impact: Impact
    used: FloatArray
    pressing: FloatArray
    speeds: FloatArray


def resolve_resting(
    model: Any,
    data: Any,
    touching: ClosedPairs,
    rule: RestRule,
    resolve_with: Callable[[FloatArray], Impact],
    motion: Motion,
) -> RestingResult:
    """Resolve an impact, plastic for contacts whose next flight would be too short.

    A contact with e = 1 comes to rest only if it does not approach.

    Args:
        model: MuJoCo model of the logged system.
        data: Its data before the impact, with the current efforts.
        touching: Pairs in contact.
        rule: When a contact comes to rest.
        resolve_with: Resolves the impact of all contact points with given coefficients of restitution, (k,).
        motion: The current motion; bodies of the impacts are bodies of its model.
    """
    points = contact_points(touching)
    used = np.array([pair.restitution for pair, _, _ in points])
    impact = resolve_with(used)
    tolerance = np.array([near.rate_tolerance for _, near, _ in points])
    stated, speeds, pressing = used, np.zeros(len(points)), np.zeros(len(points))
    if np.all((stated >= 1.0) & (impact.separation_speeds > tolerance)):
        return RestingResult(impact, used, pressing, speeds)
    pressing = pressing_accelerations(model, data, points, impact, motion)
    # A contact that comes to rest takes velocity from others, which may then come to rest too. At most all of them do.
    for _ in points:
        after = impact.separation_speeds
        rests = (after <= tolerance) | ((stated < 1.0) & (after < rule.least_speeds(pressing)))
        rests &= (pressing > 0.0) & (used > 0.0)
        if not rests.any():
            break
        speeds = np.where(rests, np.maximum(after, 0.0), speeds)
        used = np.where(rests, 0.0, used)
        impact = resolve_with(used)
    return RestingResult(impact, used, pressing, speeds)
