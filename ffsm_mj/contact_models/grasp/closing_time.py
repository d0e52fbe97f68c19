"""Closing time of an armed grasp: first time within a step at which its bounds hold, including dips between its ends."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from ffsm_mj.contact_models.grasp.nearness import Nearness, Vectors
from ffsm_mj.tolerances import EVENT_TIME, EVENT_TIME_S

_MARGIN = 1.1
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_GOLDEN_TOLERANCE = 1e-6
_SLOPE_STEP = 1e-6
"""Fraction of a step used to find the sign of the slope of a ratio at its ends."""
_SAMPLES = (0.25, 0.5, 0.75)

At = Callable[[float], Nearness]


class Bounds:
    """Bounds of the closing condition of a grasp; None for a value without bound."""

    def __init__(self, bounds: Sequence[float | None]) -> None:
        """Store the bounds, in the order of :class:`~ffsm_mj.contact_models.grasp.nearness.Nearness`."""
        self._bounds = tuple(bounds)

    def ratio(self, near: Nearness) -> float:
        """Largest ratio of a value to its bound."""
        return near.ratio(self._bounds)

    def may_dip(self, start: Nearness, end: Nearness, duration_s: float) -> bool:
        """Whether all bounds may hold inside a step although they hold at neither end.

        Distance and angle change no faster than the relative speeds, which gives a lower bound on each; a speed is assumed
        to fall below its smaller end value by at most the difference of the two.
        """
        for i, bound in enumerate(self._bounds):
            if bound is None:
                continue
            if i < 2:
                fastest = _MARGIN * max(start[i + 2], end[i + 2])
                least = 0.5 * (start[i] + end[i] - fastest * duration_s)
            else:
                least = min(start[i], end[i]) - abs(start[i] - end[i])
            if least > bound:
                return False
        return True

    def lowest_between(self, start: Vectors, end: Vectors) -> float:
        """Estimate of the smallest ratio within a step where it first falls and then rises; infinite otherwise.

        The vectors whose norms are bounded are interpolated linearly: norms are then convex in time, and so is the largest
        of their ratios, so that golden-section search finds the minimum.
        """
        chords = [
            (one, [b - a for a, b in zip(one, other, strict=True)], bound)
            for one, other, bound in zip(start, end, self._bounds, strict=True)
            if bound is not None
        ]

        def ratio(part: float) -> float:
            return max(math.dist(one, [-part * x for x in change]) / bound for one, change, bound in chords)

        if ratio(_SLOPE_STEP) >= ratio(0.0) or ratio(1.0 - _SLOPE_STEP) >= ratio(1.0):
            return math.inf
        return ratio(lowest(ratio, 0.0, 1.0))

    def first(self, at: At, duration_s: float) -> float | None:
        """First time at which all bounds hold in a step, s; None if there is none.

        The ratio is sampled at a few times; a local minimum among the samples is refined, in case it dips below 1.

        Args:
            at: Evaluates the relative pose and velocity of the sites at a time of the step.
            duration_s: Length of the step.
        """

        def excess(time_s: float) -> float:
            return self.ratio(at(time_s)) - 1.0

        return first_at_most_zero(excess, duration_s)


def first_at_most_zero(f: Callable[[float], float], duration_s: float) -> float | None:
    """First time in a step at which a function is not positive, s, also where it dips inside; None if there is none."""
    times = [0.0, *(share * duration_s for share in _SAMPLES), duration_s]
    values = [f(time) for time in times]
    if values[0] <= 0.0:
        return 0.0
    for i in range(1, len(times)):
        if values[i] <= 0.0:
            return _root(f, times[i - 1], times[i])
        if 0 < i < len(times) - 1 and values[i] <= values[i - 1] and values[i] <= values[i + 1]:
            dip = lowest(f, times[i - 1], times[i + 1])
            if f(dip) <= 0.0:
                return _root(f, times[i - 1], dip)
    return None


def _root(f: Callable[[float], float], start_s: float, end_s: float) -> float:
    """Root of a function that is positive at the start and not at the end, rounded up until it is not positive."""
    from scipy.optimize import brentq  # takes a second to import: only runs with a grasp pay

    if f(end_s) == 0.0:
        return end_s
    root, late = float(brentq(f, start_s, end_s, xtol=EVENT_TIME_S, rtol=EVENT_TIME)), EVENT_TIME_S
    while root < end_s and f(root) > 0.0:
        root, late = min(root + late, end_s), 2.0 * late
    return root


def lowest(f: Callable[[float], float], start_s: float, end_s: float) -> float:
    """Minimum of a unimodal function by golden-section search, to a millionth of the interval; stops at a value <= 0."""
    stretch = _GOLDEN_TOLERANCE * (end_s - start_s)
    a, b = end_s - _GOLDEN * (end_s - start_s), start_s + _GOLDEN * (end_s - start_s)
    fa, fb = f(a), f(b)
    while end_s - start_s > stretch:
        if fa <= 0.0:
            return a
        if fa < fb:
            end_s, b, fb = b, a, fa
            a = end_s - _GOLDEN * (end_s - start_s)
            fa = f(a)
        else:
            start_s, a, fa = a, b, fb
            b = start_s + _GOLDEN * (end_s - start_s)
            fb = f(b)
    return a if fa < fb else b
