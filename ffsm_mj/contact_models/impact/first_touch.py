"""First touch of one pair in an interval where its gap has at most one extremum.

A touch is a time at which the gap is zero and the pair approaches. A root of the gap at which the pair separates is the end
of an earlier contact, not a touch: a pair that starts in contact must first leave it, or is pressed from the start.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.tolerances import CLEARLY_APART_M, INSTANT_S, RATE

At = Callable[[float], Proximity]

_FALL = 100.0
"""A pair that starts in contact touches again when its gap has fallen by this many times its rounding."""
_SMOOTH = 1e-2
"""Share of the values at both ends, below which that between them is if the function is nearly straight."""
_AT_ROOT = 0.1
"""Share of its tolerance within which a value is rounding: 1e-15 m of a gap of bodies some 0.1 m from the origin."""
_ITERATIONS = 100
"""The 40 that halve the interval leave 1e-12 of it, 1e-15 s of a step of 1 ms."""
_KINKED = 20
"""Iterations after which every second one halves the interval: regula falsi has found the roots of smooth functions by then,
but creeps along a gap that stays at rounding and then falls, as that of a cap that falls flat does."""


def first_touch(
    at: At, start: float, end: float, pressed: Callable[[float], bool], end_gap: float = math.inf
) -> float | None:
    """First touch in an interval, s, or None.

    Args:
        at: Moves to a time in s and evaluates the pair there.
        start: Start of the interval, s.
        end: End of the interval, s.
        pressed: Moves to a time in s and tells whether the pair, closed and at rest there, begins to overlap.
        end_gap: Distance at the end from a query, m, if there was one.
    """
    first = at(start)
    if first.approaches:
        return start if first.gap <= 0.0 else _falling(at, start, end, first, end_gap)
    level, ends_apart = min(first.gap, 0.0), CLEARLY_APART_M < end_gap < math.inf  # as most pairs after an impact
    if ends_apart or (last := at(end)).gap > level - (_FALL * last.rounding if first.gap <= 0.0 else 0.0):
        return None
    # The pair separates or is at rest at the start, and its gap is lower at the end: the touch is where the gap falls back
    # to zero, or, for a pair that already overlaps by rounding, to its value at the start.
    if first.rate > 0.0 and last.rate >= 0.0:
        return _by_halves(at, start, end, pressed)
    highest = root(lambda t: at(t).rate, (start, first.rate), (end, last.rate), RATE) if first.rate > 0.0 else start
    top = at(highest)
    if top.gap <= level + top.rounding:
        # The pair never leaves contact. If efforts press it, contact begins at the maximum; else it must fall by more than
        # rounding, or every evaluation would report a touch.
        if pressed(highest):
            return highest
        level -= _FALL * last.rounding
        if last.gap > level:
            return None  # apart by rounding at the start, so that the fall to the end was not asked for above
    return root(lambda t: at(t).gap - level, (highest, top.gap - level), (end, last.gap - level), last.rounding)


def _by_halves(at: At, start: float, end: float, pressed: Callable[[float], bool]) -> float | None:
    """First touch by bisection: a gap that rises at both ends and is lower at the second has more than one extremum."""
    middle = 0.5 * (start + end)
    # Within an instant the gap and its rate are rounding; from 0 s on a thousand halves lead to the least number.
    if end - start <= INSTANT_S or not start < middle < end:
        return None
    early = first_touch(at, start, middle, pressed)
    return early if early is not None else first_touch(at, middle, end, pressed)


def _falling(at: At, start: float, end: float, first: Proximity, end_gap: float) -> float | None:
    """First touch of a pair that is apart and approaches at the start."""
    if end_gap >= -CLEARLY_APART_M:  # else it overlaps at the end, as at most touches, and nothing else counts there
        last = at(end)
        if last.gap > 0.0:
            # It still approaches at the end: a gap with one minimum has it later, and no touch before.
            if last.rate <= 0.0:
                return None
            end = root(lambda t: at(t).rate, (start, first.rate), (end, last.rate), RATE)
            last = at(end)  # the minimum of the gap: positive for a near miss, else a touch precedes it
            if last.gap > 0.0:
                return None
        end_gap = last.gap
    # The parabola through both gaps with the rate at the start falls from above zero to below: its first root.
    bend = ((end_gap - first.gap) / (end - start) - first.rate) / (end - start)
    fall = math.sqrt(max(first.rate**2 - 4.0 * first.gap * bend, 0.0)) - first.rate
    guess = start + 2.0 * first.gap / fall
    return root(lambda t: at(t).gap, (start, first.gap), (end, end_gap), first.rounding, guess)


def _inverse_root(p: tuple[float, float], q: tuple[float, float], r: tuple[float, float]) -> float:
    """Root of a function by the parabola of its inverse through three points (t, f(t)), the last one the nearest."""
    (a, fa), (b, fb), (c, fc) = p, q, r
    return c + (a - c) * fb * fc / ((fa - fb) * (fa - fc)) + (b - c) * fa * fc / ((fb - fa) * (fb - fc))


def root(
    f: Callable[[float], float],
    left: tuple[float, float],
    right: tuple[float, float],
    tolerance: float,
    guess: float | None = None,
) -> float:
    """Root of a function between two points (t, f(t)) of different sign: regula falsi (Illinois), then bisection.

    Where the function proves to be smooth, interpolation of its inverse through three points takes fewer evaluations. A
    guess of the root is where it is evaluated first.
    """
    (a, fa), (b, fb) = left, right
    if fa == 0.0:
        return a
    side, seen, is_smooth = 0, [left, right], False
    for count in range(_ITERATIONS):
        halves = count >= _KINKED and count % 2 == 0
        c = 0.5 * (a + b) if halves else (a * fb - b * fa) / (fb - fa)
        better = _inverse_root(*seen[-3:]) if is_smooth else guess if count == 0 else None
        if better is not None and a < better < b:
            c = better
        # The interval has no inner point left, or both values are equal by rounding.
        if not min(a, b) < c < max(a, b):
            break
        fc = f(c)
        if abs(fc) <= tolerance:
            # Which value within the tolerance comes first hangs on where the search began: the straight line does not.
            p, fp = seen[-1]
            is_straight = _AT_ROOT * tolerance < abs(fc) < _SMOOTH * abs(fp)
            return min(max(a, c - fc * (c - p) / (fc - fp)), b) if is_straight else c
        seen.append((c, fc))
        # Where it is flat, values are equal, and it has no inverse.
        is_smooth = abs(fc) < _SMOOTH * min(abs(fa), abs(fb)) and len({value for _, value in seen[-3:]}) == 3
        if (fc > 0.0) == (fb > 0.0):
            b, fb = c, fc
            # Illinois: an end that stays twice counts half, else regula falsi keeps it for ever where f is convex.
            fa = 0.5 * fa if side < 0 else fa
            side = -1
        else:
            a, fa = c, fc
            fb = 0.5 * fb if side > 0 else fb
            side = 1
    return b
