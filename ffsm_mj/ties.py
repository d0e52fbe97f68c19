"""Ties: what counts as equal where a decision depends on it.

Numbers that are equal in exact arithmetic differ by rounding, in a log replay otherwise than in the run, and in a moving
frame otherwise than at rest. A decision between them must not depend on that.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Generic, NamedTuple, TypeVar

T = TypeVar("T")


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
        kept = next(i for i, each in enumerate(self._candidates) if each.value <= value + 2.0 * rounding)
        del self._candidates[:kept]

    @property
    def least(self) -> float:
        """The least value; infinite without values."""
        return self._candidates[-1].value if self._candidates else float("inf")

    def first(self) -> T | None:
        """What the first value within rounding of the least one belongs to; None without values."""
        if not self._candidates:
            return None
        last = self._candidates[-1]
        return next(each.what for each in self._candidates if each.value <= last.value + last.rounding)

    def equals(self) -> tuple[T, ...]:
        """All that may count as the first, were the values rounded otherwise.

        A value that falls slowly passes the limit, one rounding above the least, at a time that depends on rounding: what
        is within twice that of the least may be the first.
        """
        return tuple(each.what for each in self._candidates)
