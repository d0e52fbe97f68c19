"""Event localisation of persistent contact: when in a step the active set or a feature ceases to be valid."""

from __future__ import annotations

from collections.abc import Callable

from ffsm_mj.contact_models.persistent.active_set import ActiveContactSet
from ffsm_mj.tolerances import EVENT_TIME, EVENT_TIME_S, INSTANT_S

_START_FRACTIONS = tuple(0.5**k for k in range(1, 20))
"""Fractions of a step at which a positive gap is looked for: a point that lands may start the step at a gap of rounding."""


def first_change(active_set: ActiveContactSet, duration_s: float) -> tuple[float, bool] | None:
    """First time in a step at which the active set or a feature is no longer valid.

    Args:
        active_set: The closed contacts, with the active set chosen at the start of the step.
        duration_s: Time since the start of the step up to which to search.

    Returns:
        The time, located just after the zero crossing, and whether closed pairs touch there at a point that is not one of
        their contact points; None if all stays valid.
    """
    path = active_set.motion.path

    def slack(time_s: float) -> float:
        if time_s <= 0.0:
            return 1.0  # the active set was chosen at this state, so it is valid there whatever the rounding
        path.move_to(time_s)
        # Points stick a little beyond the limit of friction. Those that leave it further behind are released at the limit.
        return active_set.witness_value(exact=True)

    path.move_to(duration_s)
    if active_set.witness_value() >= 0.0:
        return None
    changed = _just_after(slack, 0.0, duration_s)
    # A gap that drifts beyond its bound may return and cross it again: of several roots the first one counts.
    while changed > INSTANT_S and slack(0.5 * changed) < 0.0:
        changed = _just_after(slack, 0.0, 0.5 * changed)
    path.move_to(changed)
    landing = active_set.touches_elsewhere()
    return _landing_time(active_set, changed) if landing else changed, landing


def _landing_time(active_set: ActiveContactSet, seen_s: float) -> float:
    """Time at which the overlapping points of closed pairs touched.

    The detection threshold is a depth; an impact at that depth instead of at gap zero would change the energy.
    """
    overlapping, path = active_set.overlapping_features(), active_set.motion.path

    def gap(time_s: float) -> float:
        path.move_to(time_s)
        return min(feature.at(active_set.data).gap for feature in overlapping)

    if not overlapping:
        return seen_s
    # brentq needs a sign change. A point that rocks may have lifted off only after the start of the step.
    above = next((part * seen_s for part in (0.0, *_START_FRACTIONS) if gap(part * seen_s) > 0.0), seen_s)
    return _just_after(gap, above, seen_s) if above < seen_s else seen_s


def _just_after(f: Callable[[float], float], start_s: float, end_s: float) -> float:
    """First time between two times at which a function becomes negative, rounded up until it is negative there.

    A log replay evaluates the same state with slightly different rounding: it must reach the same decision.
    """
    from scipy.optimize import brentq  # takes a second to import: only runs with persistent contact pay

    root, late = float(brentq(f, start_s, end_s, xtol=EVENT_TIME_S, rtol=EVENT_TIME)), EVENT_TIME_S
    while True:
        root, late = min(root + late, end_s), 2.0 * late
        if root >= end_s or f(root) < 0.0:
            return root
