"""When the bounds of an armed grasp first hold within a step: a root on its path, and no dip between its ends is missed."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from ffsm_mj.contact_models.grasp.nearness import Nearness, Vectors

_INSTANT_S = 1e-13
_MARGIN = 1.1
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_SHARE = 1e-6
_LITTLE = 1e-6
"""Of a step: at either end of it, this tells whether a ratio falls or rises there."""
_LOOKS = (0.25, 0.5, 0.75)

At = Callable[[float], Nearness]


class Bounds:
    """Of one grasp, None where one is not stated."""

    def __init__(self, bounds: Sequence[float | None]) -> None:
        """Take them in the order of :class:`~ffsm_mj.contact_models.grasp.nearness.Nearness`."""
        self._bounds = tuple(bounds)

    def ratio(self, near: Nearness) -> float:
        """The largest value over its bound."""
        return near.ratio(self._bounds)

    def may_dip(self, start: Nearness, end: Nearness, duration_s: float) -> bool:
        """Whether all bounds may hold somewhere in a step at neither of whose ends they do.

        Distance and angle change no faster than the relative speeds; those may be lower by as much as they differ.
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
        """About the lowest ratio within a step that begins with it falling and ends with it rising; infinite in any other.

        Of the chords of the vectors that the values are norms of: there the ratio is convex.
        """
        chords = [
            (one, [b - a for a, b in zip(one, other, strict=True)], bound)
            for one, other, bound in zip(start, end, self._bounds, strict=True)
            if bound is not None
        ]

        def ratio(part: float) -> float:
            return max(math.dist(one, [-part * x for x in way]) / bound for one, way, bound in chords)

        if ratio(_LITTLE) >= ratio(0.0) or ratio(1.0 - _LITTLE) >= ratio(1.0):
            return math.inf
        return ratio(lowest(ratio, 0.0, 1.0))

    def first(self, at: At, duration_s: float) -> float | None:
        """When they first hold in a step at whose start they do not, s; None where they do not.

        Args:
            at: Goes to a time of the step, and looks.
            duration_s: Length of the step.
        """

        def excess(time_s: float) -> float:
            return self.ratio(at(time_s)) - 1.0

        times = [0.0, *(share * duration_s for share in _LOOKS), duration_s]
        values = [excess(time) for time in times]
        if values[0] <= 0.0:
            return 0.0
        for i in range(1, len(times)):
            if values[i] <= 0.0:
                return _root(excess, times[i - 1], times[i])
            if 0 < i < len(times) - 1 and values[i] <= values[i - 1] and values[i] <= values[i + 1]:
                dip = lowest(excess, times[i - 1], times[i + 1])
                if excess(dip) <= 0.0:
                    return _root(excess, times[i - 1], dip)
        return None


def _root(f: Callable[[float], float], start_s: float, end_s: float) -> float:
    """Where a function falls to zero, from the side where it has: it is above at the start, and not at the end."""
    from scipy.optimize import brentq  # a second to import, for runs with a capture

    if f(end_s) == 0.0:
        return end_s
    root, late = float(brentq(f, start_s, end_s, xtol=_INSTANT_S, rtol=8.9e-16)), _INSTANT_S
    while root < end_s and f(root) > 0.0:
        root, late = min(root + late, end_s), 2.0 * late
    return root


def lowest(f: Callable[[float], float], start_s: float, end_s: float) -> float:
    """Where a function that falls, then rises is lowest, by golden sections, to a millionth of the stretch."""
    stretch = _SHARE * (end_s - start_s)
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
