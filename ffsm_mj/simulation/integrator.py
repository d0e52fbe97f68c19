"""The course of a motion: it moves on until a contact model acts."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.contact.step_control import StepControl
from ffsm_mj.contact_models.interface import ContactModel, EventTime
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.records.active_contact import ActiveContact
from ffsm_mj.records.columns import Columns


class EventDrivenIntegrator:
    """Moves a motion on, watched by contact models.

    Most steps ask none of them: the kinetic energy bounds how far anything can have moved, so a contact model whose horizon
    is further away need not look.

    Attributes:
        motion: What moves.
        contact_models: Who watches; where two act at one instant, the first goes first.
        control: Cuts steps into sub-steps; None: every step is made as it is asked for.
    """

    def __init__(self, motion: Motion, contact_models: Sequence[ContactModel]) -> None:
        """Begin at the state of the motion."""
        self.contact_models = tuple(contact_models)
        self.control: StepControl | None = None
        self._active: list[ContactModel] = []
        self._poll: Callable[[], None] | None = None
        self._passed_s: float | None = None
        self.bind(motion)

    def bind(self, motion: Motion) -> None:
        """Move this from here on."""
        self.motion = motion
        if self._poll is not None:
            motion.path.poll = self._poll
        for contact_model in self.contact_models:
            contact_model.bind(motion)
        self.restart()

    def restore_state(self, system: Motion) -> None:
        """Begin at the state in ``data`` with what the contact models' columns say of it.

        Args:
            system: What moves unless a contact model says otherwise.
        """
        self._passed_s = None
        moving = [motion for contact_model in self.contact_models if (motion := contact_model.restore_state()) is not None]
        self.bind(moving[0] if moving else system)

    def interrupt_by(self, poll: Callable[[], None]) -> None:
        """Have something called before every move along a path; what it raises ends :meth:`advance`."""
        self._poll = self.motion.path.poll = poll

    def restart(self) -> None:
        """Look again after something changed at one instant: velocities, who is active, what moves."""
        self._active = [contact_model for contact_model in self.contact_models if contact_model.active]
        pushing = [contact_model for contact_model in self._active if contact_model.pushes]
        pushes, answers = ([each.push for each in pushing if each.is_reactive is answering] for answering in (False, True))
        self.motion.push_with(pushes, answers)
        for contact_model in self.contact_models:
            contact_model.restart()
        self.motion.flight.clear(self._horizon())
        if self.control is not None:
            self.control.restart()

    def reconsider(self) -> None:
        """Ask the contact models again how far they can see: one of them heard something."""
        self.motion.flight.horizon = self._horizon()

    def after_event(self, time_s: float) -> None:
        """An event was told of at this time: the contact models hear of it once a step begins from there."""
        self._passed_s = time_s

    def _begin_step(self) -> None:
        if self._passed_s is not None:
            for contact_model in self.contact_models:
                contact_model.after_event(self._passed_s)
            self._passed_s = None
        for contact_model in self._active:
            contact_model.begin_step()

    def _horizon(self) -> float:
        return min((contact_model.horizon for contact_model in self.contact_models), default=math.inf)

    @property
    def columns(self) -> list[Columns]:
        """What all contact models report."""
        return [columns for contact_model in self.contact_models for columns in contact_model.columns]

    def contacts(self) -> tuple[ActiveContact, ...]:
        """What is closed at the state in ``data``, under the efforts in it."""
        return (
            tuple(contact for contact_model in self._active for contact in contact_model.active_contacts())
            if self._active
            else ()
        )

    @property
    def kinetic_energy_J(self) -> float:
        """Of everything, at the state in ``data``."""
        return self.motion.flight.energy

    def advance(self, duration_s: float) -> tuple[float, ContactModel | None]:
        """Integrate for a time, a sub-step of it, or until a contact model acts.

        Returns:
            Time since the start in s, the state being there, and who acts; None where nobody does.

        Raises:
            UnsupportedContactError: A motion is too fast to follow.
            StepLimitError: A motion is too fast for the accuracy that is asked for.
        """
        motion, flight = self.motion, self.motion.flight
        if flight.horizon <= flight.way:
            for contact_model in self.contact_models:
                if contact_model.due():
                    return 0.0, contact_model
        step_s, clear = self._step(duration_s, duration_s)
        # What is not finite is for the caller to notice.
        if clear or not math.isfinite(flight.energy):
            return step_s, None
        watching = [contact_model for contact_model in self.contact_models if not contact_model.is_clear()]
        motion.path.at_s = step_s
        if not watching:
            self._flown(step_s)
            flight.horizon = self._horizon()
            return step_s, None
        first: tuple[float, ContactModel] | None = None
        for contact_model in watching:
            time_s = contact_model.first_event(step_s if first is None else first[0])
            if time_s is not None and (first is None or time_s < first[0]):
                first = time_s, contact_model
        at_s = step_s if first is None else first[0]
        motion.path.move_to(at_s)
        self._flown(at_s)
        for contact_model in self.contact_models:
            contact_model.on_event_located(at_s)
        motion.flight.clear(self._horizon())
        return first if first is not None else (step_s, None)

    def integrate(self, most_s: float, left_s: float) -> float:
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

    def exchanged(self, duration_s: float) -> list[Exchange]:
        """What the wrenches of the active contact models did in a step that may yet be taken back."""
        return [booking for contact_model in self._active if (booking := contact_model.exchanged(duration_s)) is not None]

    def _flown(self, duration_s: float) -> None:
        for contact_model in self.contact_models:
            contact_model.after_substep(duration_s)

    def finish(self, instant: EventTime) -> list[Any]:
        """Records that the contact models leave at the end of the run."""
        return [record for contact_model in self.contact_models for record in contact_model.finish(instant)]

    def exchanges(self, duration_s: float) -> list[Exchange]:
        """What the wrenches of the active contact models did in the (sub-)step that has ended."""
        if not self._active or duration_s <= 0.0:
            return []  # nobody pushes, or a contact model acted before the step began
        done = (contact_model.end_step(duration_s) for contact_model in self._active)
        return [booking for booking in done if booking is not None]
