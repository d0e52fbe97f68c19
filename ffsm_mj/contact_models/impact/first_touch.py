"""The first touch of one pair on a stretch of its path where the gap is monotone or has one extremum.

A touch is an instant at which the gap is used up and the pair approaches. A pair that starts in contact first has to leave
it, or is pressed from there: a root of the gap at which the pair separates is where it comes from, not where it goes.
"""

from __future__ import annotations

from collections.abc import Callable

from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.tolerances import RATE

At = Callable[[float], Proximity]

_FALL = 100.0
"""A pair in contact has moved on when its gap has fallen by so many times its rounding."""
_ITERATIONS = 100


def first_touch(at: At, start: float, end: float, pressed: Callable[[Proximity], bool]) -> float | None:
    """First touch between two times, or None.

    Args:
        at: Goes to a time, and looks.
        start: Begin of the stretch, s.
        end: Its end, s.
        pressed: Whether a pair that is closed and still, where ``at`` has gone last, is pressed together.
    """
    first, last = at(start), at(end)
    if first.approaches:
        return start if first.gap <= 0.0 else _falling(at, start, end, first, last)
    level, fall = min(first.gap, 0.0), _FALL * last.rounding
    if last.gap > level - (fall if first.gap <= 0.0 else 0.0):
        return None
    # It leaves, or rests, and falls later: it touches on the way down, at the gap that it started with or at none.
    if first.rate > 0.0 and last.rate >= 0.0:
        return _by_halves(at, start, end, pressed)
    highest = root(lambda t: at(t).rate, (start, first.rate), (end, last.rate), RATE) if first.rate > 0.0 else start
    top = at(highest)
    if top.gap <= level + top.rounding:
        if pressed(top):
            return highest
        level -= fall
    return root(lambda t: at(t).gap - level, (highest, top.gap - level), (end, last.gap - level), last.rounding)


def _by_halves(at: At, start: float, end: float, pressed: Callable[[Proximity], bool]) -> float | None:
    """A gap that rises at both ends and is lower at the second has more than one extremum: look at each half."""
    middle = 0.5 * (start + end)
    if not start < middle < end:
        return None
    early = first_touch(at, start, middle, pressed)
    return early if early is not None else first_touch(at, middle, end, pressed)


def _falling(at: At, start: float, end: float, first: Proximity, last: Proximity) -> float | None:
    """Where a pair that is apart and approaches touches."""
    if last.gap > 0.0:
        if last.rate <= 0.0:
            return None
        end = root(lambda t: at(t).rate, (start, first.rate), (end, last.rate), RATE)
        last = at(end)  # it dips in between: a graze, or a touch on the way down
        if last.gap > 0.0:
            return None
    return root(lambda t: at(t).gap, (start, first.gap), (end, last.gap), last.rounding)


def root(f: Callable[[float], float], left: tuple[float, float], right: tuple[float, float], tolerance: float) -> float:
    """Root of f between two points (t, f(t)) of different sign: Illinois' secant, kept inside its bracket."""
    (a, fa), (b, fb) = left, right
    if fa == 0.0:
        return a
    side = 0
    for _ in range(_ITERATIONS):
        c = (a * fb - b * fa) / (fb - fa)
        if not min(a, b) < c < max(a, b):
            break
        fc = f(c)
        if abs(fc) <= tolerance:
            return c
        if (fc > 0.0) == (fb > 0.0):
            b, fb = c, fc
            fa = 0.5 * fa if side < 0 else fa
            side = -1
        else:
            a, fa = c, fc
            fb = 0.5 * fb if side > 0 else fb
            side = 1
    return b
