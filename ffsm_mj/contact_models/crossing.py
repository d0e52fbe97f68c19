"""Roots of functions of the time in a step, rounded up to where they have crossed zero."""

from __future__ import annotations

from collections.abc import Callable

from ffsm_mj.tolerances import EVENT_TIME, EVENT_TIME_S


def just_after(f: Callable[[float], float], start_s: float, end_s: float) -> float:
    """First time between two times at which a function becomes negative, rounded up until it is negative there.

    A log replay evaluates the same state with slightly different rounding: it must reach the same decision.

    Args:
        f: The function; positive at the first time and negative at the second.
        start_s: First time, s.
        end_s: Second time, s.
    """
    from scipy.optimize import brentq  # takes a second to import: only runs with such events pay

    root, late = float(brentq(f, start_s, end_s, xtol=EVENT_TIME_S, rtol=EVENT_TIME)), EVENT_TIME_S
    while True:
        root, late = min(root + late, end_s), 2.0 * late
        if root >= end_s or f(root) < 0.0:
            return root
