"""Closing time of an armed grasp: first time within a step at which its bounds hold, including dips between its ends."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from ffsm_mj.contact_models.grasp.nearness import Nearness, Vectors
from ffsm_mj.tolerances import EVENT_TIME, EVENT_TIME_S

_MARGIN = 1.1
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_GOLDEN_TOLERANCE = 1e-6
_SAMPLES = (0.25, 0.5, 0.75)

At = Callable[[float], Vectors]
"""Moves to a time of a step in s, and evaluates the relative vectors of the sites there."""


class Bounds:
    """Bounds of the closing condition of a grasp; None for a value without bound.

    Attributes:
        stated: The bounds by the name of the value in :class:`~ffsm_mj.contact_models.grasp.nearness.Nearness`.
    """

    def __init__(self, bounds: Sequence[float | None]) -> None:
        """Store the bounds, in the order of :class:`~ffsm_mj.contact_models.grasp.nearness.Nearness`."""
        self._bounds = tuple(bounds)
        self.stated = {name: bound for name, bound in zip(Nearness._fields, bounds, strict=True) if bound is not None}

    def ratio(self, near: Nearness) -> float:
        """Largest ratio of a value to its bound."""
        return near.ratio(self._bounds)

    def rate(self, vectors: Vectors, accelerations: Sequence[Sequence[float]]) -> float:
        """Rate of the largest ratio, 1/s.

        Distance and angle change at the relative velocities along them, speeds at the relative accelerations along them.

        Args:
            vectors: Relative vectors of the sites.
            accelerations: Rates of the relative velocities, (2, 3).
        """
        ratios = [
            0.0 if bound is None else math.hypot(*one) / bound for one, bound in zip(vectors, self._bounds, strict=True)
        ]
        largest = ratios.index(max(ratios))
        one, other, bound = vectors[largest], (*vectors[2:], *accelerations)[largest], self._bounds[largest]
        size, along = math.hypot(*one), sum(a * b for a, b in zip(one, other, strict=True))
        return (along / size if size else math.hypot(*other)) / (bound or math.inf)

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

    def first(self, at: At, duration_s: float) -> float | None:
        """First time at which all bounds hold in a step, s; None if there is none.

        The ratio is sampled at a few times; a local minimum among the samples is refined, in case it dips below 1.

        Args:
            at: Moves to a time of the step, and evaluates the vectors there.
            duration_s: Length of the step.
        """

        def excess(time_s: float) -> float:
            return self.ratio(Nearness.of(at(time_s))) - 1.0

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


def lowest_inside(bounds: Bounds, start: Vectors, end: Vectors, at: At, duration_s: float, enough: float) -> float | None:
    """Time inside a step at which the largest ratio first falls and then rises, s; None if it does not.

    The minimum is the root of the rate of the ratio, which is known to rounding there; the ratio itself is flat.

    Args:
        bounds: The bounds.
        start: Relative vectors at the start of the step.
        end: Those at its end.
        at: Moves to a time of the step, and evaluates the vectors there.
        duration_s: Length of the step.
        enough: Minima that are certainly above this do not matter.
    """
    from scipy.optimize import brentq  # takes a second to import: only runs with a grasp pay

    if not duration_s > 0.0:
        return None
    mean = [[(b - a) / duration_s for a, b in zip(*both, strict=True)] for both in zip(start[2:], end[2:], strict=True)]
    falls, rises = bounds.rate(start, mean), bounds.rate(end, mean)
    if not falls < 0.0 < rises:
        return None
    # The tangents at both ends meet at or below the minimum of a convex function. Of one that is not quite convex, the
    # minimum is assumed to be at most twice as deep: a step at rest, where rates are rounding, is not searched.
    before, after = (bounds.ratio(Nearness.of(vectors)) for vectors in (start, end))
    lowest_m = (before * rises - after * falls + falls * rises * duration_s) / (rises - falls)
    if 2.0 * lowest_m - min(before, after) > enough:
        return None
    middle = at(0.5 * duration_s)
    bends = [
        [2.0 * (a - 2.0 * m + b) / duration_s for a, m, b in zip(*three, strict=True)]
        for three in zip(start[2:], middle[2:], end[2:], strict=True)
    ]

    def rate(time_s: float) -> float:
        # Accelerations of the parabola through the velocities at the ends and in the middle.
        part = 2.0 * time_s / duration_s - 1.0
        now = [[a + part * b for a, b in zip(*both, strict=True)] for both in zip(mean, bends, strict=True)]
        return bounds.rate(at(time_s), now)

    if not rate(0.0) < 0.0 < rate(duration_s):
        return None
    return float(brentq(rate, 0.0, duration_s, xtol=EVENT_TIME_S, rtol=EVENT_TIME))


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
