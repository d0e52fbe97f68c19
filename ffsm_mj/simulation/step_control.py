"""Step-size control: steps are divided into sub-steps if their error would exceed the requested accuracy."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol

from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.state import Stateful

MOST_PARTS = 1024
"""Largest number of sub-steps of a step."""
_AT_ONCE = 8
"""Largest number of sub-steps of a trial: the error of the trial is up to 8^4 times theirs, far above rounding."""
_ORDER, _IMPLICIT_ORDER = 4, 5
"""The error of a step over its duration is proportional to this power of the duration: RK4, and Radau IIA."""
_SAFETY = 1.5
"""Sub-steps are shorter by this factor than the power law requires, which leaves a fifth of the error."""
_BELOW_ROUNDING = 0.1
"""Sub-steps are as long as the budget allows, or so long that their error is below this share of what is rounding.

The errors may have one sign: those of 2.2e4 sub-steps of an iiwa 14 in 1 s of a path add up to 1.8e-12 J.
"""
_COARSE = 1e-6
"""A relative error above this is outside the range of the power law."""
_LOST, _SMALL = 1e-3, 1e-9
"""Relative errors of the shortest trial: above the first the motion is not resolved, and the run ends; below the second the
shortest sub-steps are used, as for the time at which a corner under load is passed."""
_MOST_COARSER = 32
"""Largest factor by which a trial is shorter than the one before; the next one measures again."""
_FALLS = 1.5
"""An error that falls with a lower power of the duration is not truncation: rounding, a leak, or a jump of a force."""


class StepError(Protocol):
    """Measure of the error of a (sub-)step; see :class:`ffsm_mj.balance.step_error.StepError`."""

    def begin(self, *, measured: bool) -> None:
        """Begin a step at the state in ``data``; its error will be measured, or a bound may suffice."""

    @property
    def is_measured(self) -> bool:
        """Whether the error can be measured."""

    def bound(self, duration_s: float) -> float:
        """Upper bound on the error of a step without contact forces; cheap."""

    def relative(self, duration_s: float, exchanges: Iterable[Exchange], *, grasped: bool) -> float:
        """Error of energy and momenta at the state in ``data`` over (1 + scale); infinite if not finite."""


class StepLimitError(Exception):
    """The motion requires shorter steps than step-size control allows."""


class StepControl(Stateful):
    """Chooses the length of sub-steps by a trial: one long step, whose error is measured and which is then undone.

    The error of the sub-steps follows from that of the trial by the power law of the integrator; their own error would be
    below rounding.

    The choice is a function of the state at the start of the time step, or after the last event in it, of the efforts and of
    the remaining time. No information is kept from step to step, so a log replay makes the same sub-steps from any sample.

    Attributes:
        steps: Number of sub-steps so far, including those that an event has shortened.
        smallest_s: Shortest sub-step chosen so far, s; infinite before the first.
    """

    @dataclass
    class State:
        """Statistics of the sub-steps so far; each time step, and the rest of one after an event, is divided anew."""

        steps: int
        smallest_s: float

    def __init__(self, budget: float, step_s: float, error: StepError, parts: int = MOST_PARTS, least: float = 0.0) -> None:
        """Start at the beginning of a time step.

        Args:
            budget: Largest error over (1 + scale) of a time step.
            step_s: Time step, s.
            error: Measure of the error.
            parts: Largest number of sub-steps of a time step.
            least: Error that is rounding: a sub-step within it is not divided further.
        """
        self._rate, self._step_s, self._error, self._least = budget / step_s, step_s, error, least
        self._shortest_s = step_s * _AT_ONCE / parts
        self.steps, self.smallest_s = 0, math.inf
        self.restart()

    def restart(self) -> None:
        """Discard the choice: an event has changed the state."""
        self._planned, self._planned_s, self._reach_s = 0, 0.0, math.inf

    def begin(self, left_s: float, *, pushed: bool) -> None:
        """Begin a sub-step at the state in ``data``.

        Args:
            left_s: Remaining time of the time step, s.
            pushed: Whether contacts exert forces in the step, or may.
        """
        if left_s >= self._step_s:
            self.restart()
        if not self._planned:
            self._error.begin(measured=pushed or left_s < self._step_s)

    def step(
        self, motion: Motion, left_s: float, most_s: float, exchanged: Callable[[float], Iterable[Exchange]]
    ) -> tuple[float, bool]:
        """Integrate one sub-step of the chosen length, at most ``most_s``.

        Args:
            motion: The current motion.
            left_s: Remaining time of the time step, s, or the longest step that contact forces allow if it is shorter.
            most_s: Time until a known event, s; otherwise ``left_s``.
            exchanged: Returns what contacts exchanged in the (sub-)step of a given duration that has just been made.

        Returns:
            Duration of the sub-step in s, and whether the motion bound excludes any event in it.

        Raises:
            StepLimitError: The motion requires sub-steps shorter than the time step over the largest number of them.
        """
        if not self._planned:
            clear = self._plan(motion, left_s, exchanged)
            if clear is not None and self._planned_s <= most_s:
                return self._counted(), clear
            motion.path.move_to(0.0)
        # The last sub-step ends exactly at the end of the time step.
        ends = self._planned == 1 and self._planned_s >= left_s * (1.0 - 1e-9)
        self._planned_s = left_s if ends else self._planned_s
        duration_s = min(self._planned_s, most_s)
        clear, motion.path.at_s = motion.step(duration_s), duration_s
        self._counted()
        return duration_s, clear

    def _counted(self) -> float:
        self.steps, self.smallest_s, self._planned = self.steps + 1, min(self.smallest_s, self._planned_s), self._planned - 1
        return self._planned_s

    def _plan(self, motion: Motion, left_s: float, exchanged: Callable[[float], Iterable[Exchange]]) -> bool | None:
        """Choose the next sub-steps by trials from the state in ``data``; the last trial is not undone.

        Returns:
            None if the last trial was longer than the sub-step chosen; otherwise the trial is the sub-step, and the value is
            whether the motion bound excludes any event in it.
        """
        before: tuple[float, float] | None = None
        order = _ORDER if motion.stiff is None else _IMPLICIT_ORDER
        rates: dict[float, float] = {}
        trial_s = left_s / math.ceil(left_s / self._reach_s) if self._reach_s < left_s else left_s
        while True:
            clear, motion.path.at_s = motion.step(trial_s), trial_s
            if not self._error.is_measured:
                if self._error.bound(trial_s) <= self._rate * trial_s:
                    return self._plan_one(trial_s, clear)
                motion.path.move_to(0.0)
                self._error.begin(measured=True)
                continue
            error = self._error.relative(trial_s, exchanged(trial_s), grasped=motion.grasped_object is not None)
            rate = rates[trial_s] = error / trial_s
            # The caller notices states that are not finite.
            if rate <= self._rate or error <= self._least or not math.isfinite(error):
                self._reach_s = max(2.0 * trial_s, self._reach_s)  # a transient decays: the next trial may be longer
                return self._plan_one(trial_s, clear)
            ratio = (rate / self._rate) ** (1.0 / order)
            if self._least:  # the error itself has one power more
                ratio = min(ratio, (error / (_BELOW_ROUNDING * self._least)) ** (1.0 / (order + 1)))
            parts = math.ceil(_SAFETY * ratio)
            if parts <= _AT_ONCE and error <= _COARSE:
                self._planned, self._planned_s = parts, trial_s / parts
                self._reach_s = trial_s if parts > _AT_ONCE // 2 else 2.0 * trial_s
                return None
            motion.path.move_to(0.0)
            if trial_s <= self._shortest_s and before is None and trial_s < left_s:
                trial_s = min(2.0 * trial_s, left_s)  # two trials show whether the error falls with the duration
                continue
            if trial_s <= self._shortest_s:
                falls = before is not None and rate < before[1] * (trial_s / before[0]) ** _FALLS
                as_good_s = max(length_s for length_s, of in rates.items() if of <= 2.0 * min(rates.values()))
                return self._plan_shortest(motion, (trial_s, as_good_s), error, falls=falls)
            before = trial_s, rate
            coarser = min(_MOST_COARSER, max(2, math.ceil(parts / _AT_ONCE), _AT_ONCE * (error > _COARSE)))
            trial_s = max(trial_s / coarser, min(self._shortest_s, trial_s))

    def _plan_shortest(self, motion: Motion, durations_s: tuple[float, float], error: float, *, falls: bool) -> bool | None:
        """Choose sub-steps although the shortest trial exceeds the allowed error; see :meth:`_plan`.

        Args:
            motion: The current motion, at the start of the trial.
            durations_s: Durations of the trial, and of the longest one whose error per time is about the least, s.
            error: Relative error of the trial.
            falls: Whether the error falls with the duration, as truncation does.
        """
        trial_s, as_good_s = durations_s
        if error > _LOST or (falls and error > _SMALL):
            times = error / trial_s / self._rate
            raise StepLimitError(f"steps of {trial_s:.3g} s exceed the allowed error {times:.3g} times")
        if falls:
            self._planned, self._planned_s, self._reach_s = _AT_ONCE, trial_s / _AT_ONCE, trial_s
            return None
        # The error is not truncation, or an event left an equally short rest of the step: shorter steps do not help.
        # The longest trial that is as good does, and the checks evaluate it. It need not be the whole rest: at high rates
        # the error of short steps is rounding, while that of a time step is far above it.
        clear, motion.path.at_s = motion.step(as_good_s), as_good_s
        return self._plan_one(as_good_s, clear)

    def _plan_one(self, duration_s: float, clear: bool) -> bool:
        """Make the trial itself the sub-step."""
        self._planned, self._planned_s = 1, duration_s
        return clear
