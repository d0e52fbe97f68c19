"""Closest approach of an armed grasp to its bounds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from ffsm_mj.contact_models.grasp.closing_time import At, Bounds, lowest_inside
from ffsm_mj.contact_models.grasp.nearness import Nearness, Vectors
from ffsm_mj.state import entries
from ffsm_mj.ties import FirstOfLeast, first_of_greatest


class _Approach(NamedTuple):
    """Relative pose and velocity of the sites at a time in s."""

    time_s: float
    near: Nearness


class ClosestApproach:
    """Least ratio to the bounds of a grasp since it was armed, within steps too; of equal ones the first counts.

    The time of a minimum follows from the rates of the vectors, not from their norms, which do not change there to first
    order: it is known to rounding, and so are the speeds at it.

    Attributes:
        bounds: The bounds.
    """

    @dataclass
    class State:
        """Time up to which steps are added, s, rounding of the ratios, and the least ones, with time and norms of each."""

        clock_s: float
        rounding: float
        least: list[Any]

    def __init__(self, bounds: Bounds, time_s: float) -> None:
        """Start when the grasp is armed."""
        self.bounds, self._clock_s, self._rounding = bounds, time_s, 0.0
        self._least = FirstOfLeast[_Approach]()

    def add_step(self, start: Vectors, end: Vectors, at: At, duration_s: float, rounding: Nearness) -> None:
        """Add a finished (sub-)step.

        Args:
            start: Relative vectors at its start.
            end: Those at its end.
            at: Moves to a time of the step, and evaluates the vectors there.
            duration_s: Its length.
            rounding: Rounding of the norms.
        """
        self._rounding = self.bounds.ratio(rounding)
        self._add(Nearness.of(start), 0.0)
        inside_s = lowest_inside(self.bounds, start, end, at, duration_s, self._least.least - self._rounding)
        if inside_s is not None:
            self._add(Nearness.of(at(inside_s)), inside_s)
        self._add(Nearness.of(end), duration_s)
        self._clock_s += duration_s

    def add_end(self, vectors: Vectors) -> None:
        """Add the state at which it is disarmed, which an event at the end of the last step may have changed."""
        if self._least.first() is not None:
            self._add(Nearness.of(vectors), 0.0)

    def get_state(self) -> State:
        """The approach so far."""
        least = [(ratio, rounding, (at.time_s, tuple(at.near))) for ratio, rounding, at in self._least.get_state()]
        return self.State(self._clock_s, self._rounding, least)

    def set_state(self, state: Any) -> None:
        """Go on from an approach so far."""
        told = entries(state, ("clock_s", "rounding", "least"), "ClosestApproach")
        self._clock_s, self._rounding = told["clock_s"], told["rounding"]
        candidates = told["least"]
        self._least.set_state(
            (ratio, rounding, _Approach(time_s, Nearness(*near))) for ratio, rounding, (time_s, near) in candidates
        )

    def assume(self, near: Nearness, time_s: float) -> None:
        """Take it from a log, whose part since the arming is lost."""
        self._clock_s = time_s
        self._add(near, 0.0)

    def _add(self, near: Nearness, after_s: float) -> None:
        self._least.add(self.bounds.ratio(near), self._rounding, _Approach(self._clock_s + after_s, near))

    def first(self) -> tuple[Nearness, float, str] | None:
        """Relative pose and velocity at it, its time in s, and which value has the largest ratio; None before a step."""
        first, bounds = self._least.first(), self.bounds.stated
        if first is None:
            return None
        ratios = [getattr(first.near, name) / bound for name, bound in bounds.items()]
        # Where one ratio falls and another rises, the largest of both is least where they are equal.
        return first.near, first.time_s, [*bounds][first_of_greatest(ratios, self._rounding)]

    def accuracy(self) -> Mapping[str, float]:
        """How well the fields of the record are determined, by name: how far they vary between equal approaches."""
        first, equals = self._least.first(), self._least.equals()
        if first is None:
            return {}
        spread = {
            name: max(abs(getattr(each.near, name) - value) for each in equals)
            for name, value in first.near._asdict().items()
        }
        return spread | {
            "least_s": max(abs(each.time_s - first.time_s) for each in equals),
            "failed_value": max(spread[name] for name in self.bounds.stated),
        }
