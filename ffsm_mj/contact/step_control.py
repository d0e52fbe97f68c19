"""Steps that are cut into sub-steps where their error would be larger than the accuracy that is asked for."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Protocol

from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.dynamics.motion import Motion

MOST_PARTS = 1024
"""Into so many sub-steps a step is cut at most."""
_AT_ONCE = 8
"""A trial is cut into so many sub-steps at most: its error is then up to 8^4 times its share, far above rounding."""
_ORDER = 4
"""The error of a step over its duration falls with this power of the duration."""
_SAFETY = 1.5
"""So much shorter than the power law says: a fifth of the error."""
_COARSE = 1e-6
"""An error over its scale above this is not in the range of the power law yet."""
_LOST, _SMALL = 1e-3, 1e-9
"""An error over its scale, of the shortest trial, above the first is no motion that is followed at all; below the second the
shortest sub-steps are made, for an instant such as that of a corner under load."""
_MOST_COARSER = 32
"""One trial is so much shorter than the one before at most: the next one measures again."""
_FALLS = 1.5
"""What falls with a lower power of the duration than this is no truncation error: rounding, a leak, a jump of a force."""


class StepError(Protocol):
    """Measures the error of a (sub-)step; see :class:`ffsm_mj.actuation.step_error.StepError`."""

    def begin(self, *, measured: bool) -> None:
        """A step begins at the state in ``data``; it will be measured, or a bound may do."""

    @property
    def is_measured(self) -> bool:
        """Whether it can be measured."""

    def bound(self, duration_s: float) -> float:
        """An upper bound on the error where nothing but the efforts pushes, which costs little."""

    def relative(self, duration_s: float, bookings: Iterable[Exchange], *, carried: bool) -> float:
        """The error of energy and momenta at the state in ``data`` over (1 + scale); infinite where it is no number."""


class StepLimitError(Exception):
    """The motion asks for shorter steps than there are."""


class StepControl:
    """Chooses sub-steps by trial: one long step is made, its error measured, and the step taken back.

    The error of sub-steps follows from that by the power law of the integrator. Theirs alone would be below rounding.

    What is chosen follows from the state at the start of the step of the grid, or after the last event in it, the efforts
    and how much of the step is left: nothing is remembered from step to step, so a log is replayed with the same sub-steps
    from any of its samples.

    Attributes:
        steps: Sub-steps chosen so far, those that an event has cut short included.
        smallest_s: The shortest that was chosen, infinite before any.
    """

    def __init__(self, budget: float, step_s: float, error: StepError) -> None:
        """Begin with a whole step.

        Args:
            budget: Largest error over (1 + scale) of a step of the grid.
            step_s: Duration of a step of the grid.
            error: Measures.
        """
        self._rate, self._step_s, self._error = budget / step_s, step_s, error
        self._shortest_s = step_s * _AT_ONCE / MOST_PARTS
        self.steps, self.smallest_s = 0, math.inf
        self.restart()

    def restart(self) -> None:
        """Choose anew: an event has changed the state."""
        self._planned, self._planned_s, self._reach_s = 0, 0.0, math.inf

    def begin(self, left_s: float, *, pushed: bool) -> None:
        """A sub-step begins at the state in ``data``.

        Args:
            left_s: So much of the step of the grid is left.
            pushed: Contacts push, or may, in the step.
        """
        if left_s >= self._step_s:
            self.restart()
        if not self._planned:
            self._error.begin(measured=pushed or left_s < self._step_s)

    def step(
        self, motion: Motion, left_s: float, most_s: float, exchanged: Callable[[float], Iterable[Exchange]]
    ) -> tuple[float, bool]:
        """Integrate for the time chosen, ``most_s`` at most; says for how long, and whether nothing can have happened.

        Args:
            motion: What moves.
            left_s: What is left of the step of the grid.
            most_s: Where the next event is known to be; ``left_s`` otherwise.
            exchanged: What contacts exchanged in a (sub-)step of this duration that has just been made.

        Raises:
            StepLimitError: The motion asks for sub-steps shorter than a step of the grid over MOST_PARTS.
        """
        if not self._planned:
            clear = self._plan(motion, left_s, exchanged)
            if clear is not None and self._planned_s <= most_s:
                return self._counted(), clear
            motion.path.move_to(0.0)
        # The last one ends where the step of the grid does, to the bit.
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
        """Choose the coming sub-steps by trials from the state in ``data``, which the last one leaves.

        Returns:
            None where it was longer than what is chosen; else whether nothing can have happened in it.
        """
        before: tuple[float, float] | None = None
        trial_s = left_s / math.ceil(left_s / self._reach_s) if self._reach_s < left_s else left_s
        while True:
            clear, motion.path.at_s = motion.step(trial_s), trial_s
            if not self._error.is_measured:
                if self._error.bound(trial_s) <= self._rate * trial_s:
                    return self._plan_one(trial_s, clear)
                motion.path.move_to(0.0)
                self._error.begin(measured=True)
                continue
            error = self._error.relative(trial_s, exchanged(trial_s), carried=motion.carried is not None)
            rate = error / trial_s
            if rate <= self._rate or not math.isfinite(error):  # what is not finite is for the caller to notice
                return self._plan_one(trial_s, clear)
            parts = math.ceil(_SAFETY * (rate / self._rate) ** (1.0 / _ORDER))
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
                if error > _LOST or (falls and error > _SMALL):
                    raise StepLimitError(f"steps of {trial_s:.3g} s still miss the accuracy {rate / self._rate:.3g} times")
                if falls:
                    self._planned, self._planned_s, self._reach_s = _AT_ONCE, trial_s / _AT_ONCE, trial_s
                    return None
                # No step mends that, or what an event left of the step is as short: a whole one is as good, and the checks
                # judge it.
                clear, motion.path.at_s = motion.step(left_s), left_s
                return self._plan_one(left_s, clear)
            before = trial_s, rate
            coarser = min(_MOST_COARSER, max(2, math.ceil(parts / _AT_ONCE), _AT_ONCE * (error > _COARSE)))
            trial_s = max(trial_s / coarser, min(self._shortest_s, trial_s))

    def _plan_one(self, duration_s: float, clear: bool) -> bool:
        """The trial itself is the step."""
        self._planned, self._planned_s = 1, duration_s
        return clear
