"""Ties: what counts as equal where a decision depends on it.

Numbers that are equal in exact arithmetic differ by rounding, in a log replay otherwise than in the run, and in a moving
frame otherwise than at rest. A decision between them must not depend on that.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Generic, NamedTuple, TypeVar

from ffsm_mj.tolerances import INSTANT, INSTANT_S, SHORTEST_S

T = TypeVar("T")


def instant_s(time_s: float) -> float:
    """Events at about a time whose times differ by at most this, in s, are at one instant."""
    return max(INSTANT_S, INSTANT * time_s)


def shortest_s(time_s: float) -> float:
    """No part of a step at about a time is shorter than this, in s: logged times tell whether there is one."""
    return max(SHORTEST_S, INSTANT * time_s)


def apart(at_s: float, step_s: float, time_s: float) -> float:
    """Time at which an event ends a step, s: where it was located, or so much later that no part of the step is too short.

    A log, whose times are rounded, then tells whether there is a (sub-)step between two events, or between an event and the
    end of its step.

    Args:
        at_s: Where it was located in the step, s.
        step_s: Length of the step, s.
        time_s: Simulation time, s.
    """
    shortest = shortest_s(time_s)
    at_s = max(at_s, shortest)
    return step_s if step_s - at_s < shortest else at_s


def logged(at_s: float, step_s: float, time_s: float) -> float:
    """The same from the logged time of an event: a run leaves no part of a step so short that rounding hides it."""
    half = 0.5 * shortest_s(time_s)
    return 0.0 if at_s < half else step_s if step_s - at_s < half else at_s


def last_of_first(times_s: Sequence[float], time_s: float) -> float:
    """The last of the times that are at one instant with the first of them, s: what is due there is due by then.

    Args:
        times_s: Times in the step, s; one at least.
        time_s: Simulation time, s.
    """
    end_s = min(times_s) + instant_s(time_s)
    return max(time for time in times_s if time <= end_s)


def first_of_greatest(values: Sequence[float], rounding: float) -> int:
    """Index of the first of the values that equal the greatest one to rounding."""
    least = max(values) - rounding
    return next(i for i, value in enumerate(values) if value >= least)


class _Candidate(NamedTuple, Generic[T]):
    value: float
    rounding: float
    what: T


class FirstOfLeast(Generic[T]):
    """The least of values that come one after another; of those that equal it to rounding the first one counts."""

    def __init__(self) -> None:
        """Start without values."""
        # Only a value below all before it can be the first one within rounding of the least of all: the candidates fall.
        self._candidates: list[_Candidate[T]] = []

    def add(self, value: float, rounding: float, what: T) -> None:
        """Add the next value.

        Args:
            value: The value.
            rounding: How far it may differ from another one that equals it in exact arithmetic.
            what: What it is the value of.
        """
        if self._candidates and value >= self._candidates[-1].value:
            return
        self._candidates.append(_Candidate(value, rounding, what))
        # Twice the rounding: see equals().
        kept = next(i for i, candidate in enumerate(self._candidates) if candidate.value <= value + 2.0 * rounding)
        del self._candidates[:kept]

    def get_state(self) -> list[tuple[float, float, T]]:
        """The values that count, with their roundings and what they are of."""
        return [(value, rounding, what) for value, rounding, what in self._candidates]

    def set_state(self, state: Iterable[tuple[float, float, T]]) -> None:
        """Go on from these values."""
        self._candidates = [_Candidate(*fields) for fields in state]

    @property
    def least(self) -> float:
        """The least value; infinite without values."""
        return self._candidates[-1].value if self._candidates else float("inf")

    def first(self) -> T | None:
        """What the first value within rounding of the least one belongs to; None without values."""
        if not self._candidates:
            return None
        last = self._candidates[-1]
        return next(candidate.what for candidate in self._candidates if candidate.value <= last.value + last.rounding)

    def equals(self) -> tuple[T, ...]:
        """All that may count as the first, were the values rounded otherwise.

        A value that falls slowly passes the limit, one rounding above the least, at a time that depends on rounding: what
        is within twice that of the least may be the first.
        """
        return tuple(candidate.what for candidate in self._candidates)
