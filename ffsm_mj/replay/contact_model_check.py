"""Check of logged contact-model events: each model reproduces its events at the logged states."""

from __future__ import annotations

from dataclasses import replace

from ffsm_mj.balance.balance import Balance
from ffsm_mj.contact_models.interface import ContactModel, EventEffect, EventTime
from ffsm_mj.errors import UnsupportedContactError
from ffsm_mj.records.events import RunEnded
from ffsm_mj.replay.logged_events import LoggedEvent, LoggedEvents
from ffsm_mj.simulation.integrator import EventDrivenIntegrator
from ffsm_mj.verification.agreement import Agreement


class ContactModelCheck:
    """Applies the events of contact models at logged states, and compares the resulting records with the logged ones."""

    def __init__(self, course: EventDrivenIntegrator, logged_events: LoggedEvents, found: Agreement) -> None:
        """Bind to the integrator of the replay; differences are added to ``found``."""
        self._course, self._logged_events, self._found = course, logged_events, found
        self._owners = {
            kind.name: contact_model for contact_model in course.contact_models for kind in contact_model.records
        }

    def compare_event(self, event: LoggedEvent, balance: Balance) -> None:
        """Apply the event at the state in ``data``, compare its records, enter it in the balance, and bind its motion."""
        effect = self._effect(self._owners[event.kind], event)
        if effect is None or len(effect.records) != len(event.records):
            self._logged_events.refuse(f"{event.name} records", event.time_s)
            return
        for mine, theirs in zip(effect.records, event.records, strict=True):
            again = replace(mine, time_s=theirs.time_s, efforts_after=theirs.efforts_after)
            self._found.record(event.name, theirs, again)
        if effect.exchange is not None:
            balance.book(*effect.exchange)
        if effect.motion is not None:
            self._course.bind(effect.motion)

    def _effect(self, contact_model: ContactModel, event: LoggedEvent) -> EventEffect | None:
        try:
            contact_model.prepare_replay(event.records)
            return contact_model.act(EventTime(event.time_s, event.step))
        except (RunEnded, UnsupportedContactError, ValueError, ArithmeticError):
            return None
