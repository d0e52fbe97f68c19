"""The course of a motion: it moves on until a regime acts."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from ffsm_mj.contact.exchange import Booking
from ffsm_mj.contact.regimes import Instant, Regime
from ffsm_mj.contact.step_control import StepControl
from ffsm_mj.motion.motion import Motion
from ffsm_mj.records.active_contact import ActiveContact
from ffsm_mj.records.columns import Columns


class Course:
    """Moves a motion on, watched by regimes.

    Most steps ask none of them: the kinetic energy bounds how far anything can have moved, so a regime whose horizon is
    further away need not look.

    Attributes:
        motion: What moves.
        regimes: Who watches; where two act at one instant, the first goes first.
        control: Cuts steps into sub-steps; None: every step is made as it is asked for.
    """

    def __init__(self, motion: Motion, regimes: Sequence[Regime]) -> None:
        """Begin at the state of the motion."""
        self.regimes = tuple(regimes)
        self.control: StepControl | None = None
        self._active: list[Regime] = []
        self._poll: Callable[[], None] | None = None
        self._passed_s: float | None = None
        self.bind(motion)

    def bind(self, motion: Motion) -> None:
        """Move this from here on."""
        self.motion = motion
        if self._poll is not None:
            motion.path.poll = self._poll
        for regime in self.regimes:
            regime.bind(motion)
        self.restart()

    def take_up(self, system: Motion) -> None:
        """Begin at the state in ``data`` with what the regimes' columns say of it.

        Args:
            system: What moves unless a regime says otherwise.
        """
        self._passed_s = None
        moving = [motion for regime in self.regimes if (motion := regime.take_up()) is not None]
        self.bind(moving[0] if moving else system)

    def interrupt_by(self, poll: Callable[[], None]) -> None:
        """Have something called before every move along a path; what it raises ends :meth:`advance`."""
        self._poll = self.motion.path.poll = poll

    def restart(self) -> None:
        """Look again after something changed at one instant: velocities, who is active, what moves."""
        self._active = [regime for regime in self.regimes if regime.active]
        pushing = [regime for regime in self._active if regime.pushes]
        pushes, answers = ([each.push for each in pushing if each.answers is answering] for answering in (False, True))
        self.motion.push_with(pushes, answers)
        for regime in self.regimes:
            regime.restart()
        self.motion.flight.clear(self._horizon())
        if self.control is not None:
            self.control.restart()

    def reconsider(self) -> None:
        """Ask the regimes again how far they can see: one of them heard something."""
        self.motion.flight.horizon = self._horizon()

    def passed(self, time_s: float) -> None:
        """An event was told of at this time: the regimes hear of it once a step begins from there."""
        self._passed_s = time_s

    def _begin_step(self) -> None:
        if self._passed_s is not None:
            for regime in self.regimes:
                regime.passed(self._passed_s)
            self._passed_s = None
        for regime in self._active:
            regime.begin_step()

    def _horizon(self) -> float:
        return min((regime.horizon for regime in self.regimes), default=math.inf)

    @property
    def columns(self) -> list[Columns]:
        """What all regimes report."""
        return [columns for regime in self.regimes for columns in regime.columns]

    def contacts(self) -> tuple[ActiveContact, ...]:
        """What is closed at the state in ``data``, under the efforts in it."""
        return tuple(contact for regime in self._active for contact in regime.active_contacts()) if self._active else ()

    @property
    def kinetic_energy_J(self) -> float:
        """Of everything, at the state in ``data``."""
        return self.motion.flight.energy

    def advance(self, duration_s: float) -> tuple[float, Regime | None]:
        """Integrate for a time, a sub-step of it, or until a regime acts.

        Returns:
            Time since the start in s, the state being there, and who acts; None where nobody does.

        Raises:
            UnsupportedContactError: A motion is too fast to follow.
            StepLimitError: A motion is too fast for the accuracy that is asked for.
        """
        motion, flight = self.motion, self.motion.flight
        if flight.horizon <= flight.way:
            for regime in self.regimes:
                if regime.due():
                    return 0.0, regime
        step_s, clear = self._step(duration_s, duration_s)
        # What is not finite is for the caller to notice.
        if clear or not math.isfinite(flight.energy):
            return step_s, None
        watching = [regime for regime in self.regimes if not regime.is_clear()]
        motion.path.at_s = step_s
        if not watching:
            self._flown(step_s)
            flight.horizon = self._horizon()
            return step_s, None
        first: tuple[float, Regime] | None = None
        for regime in watching:
            time_s = regime.first_event(step_s if first is None else first[0])
            if time_s is not None and (first is None or time_s < first[0]):
                first = time_s, regime
        at_s = step_s if first is None else first[0]
        motion.path.move_to(at_s)
        self._flown(at_s)
        for regime in self.regimes:
            regime.arrived(at_s)
        motion.flight.clear(self._horizon())
        return first if first is not None else (step_s, None)

    def fly(self, most_s: float, left_s: float) -> float:
        """Integrate for a time or a sub-step of it, whatever happens on the way; says for how long.

        Args:
            most_s: The time.
            left_s: What is left of the step of the grid: sub-steps are those that a run would make of it.

        Raises:
            StepLimitError: The motion is too fast for the accuracy that is asked for.
        """
        step_s, _ = self._step(left_s, most_s)
        self.motion.path.at_s = step_s
        self._flown(step_s)
        return step_s

    def _step(self, left_s: float, most_s: float) -> tuple[float, bool]:
        """A (sub-)step of at most ``most_s``: its duration, and whether nothing can have happened in it."""
        control = self.control
        if control is None:
            self._begin_step()
            return most_s, self.motion.step(most_s)
        control.begin(left_s, pushed=bool(self._active))
        self._begin_step()
        return control.step(self.motion, left_s, most_s, self.exchanged)

    def exchanged(self, duration_s: float) -> list[Booking]:
        """What the wrenches of the active regimes did in a step that may yet be taken back."""
        return [booking for regime in self._active if (booking := regime.exchanged(duration_s)) is not None]

    def _flown(self, duration_s: float) -> None:
        for regime in self.regimes:
            regime.flown(duration_s)

    def finish(self, instant: Instant) -> list[Any]:
        """Records that the regimes leave at the end of the run."""
        return [record for regime in self.regimes for record in regime.finish(instant)]

    def bookings(self, duration_s: float) -> list[Booking]:
        """What the wrenches of the active regimes did in the (sub-)step that has ended."""
        if not self._active or duration_s <= 0.0:
            return []  # nobody pushes, or a regime acted before the step began
        done = (regime.end_step(duration_s) for regime in self._active)
        return [booking for booking in done if booking is not None]
