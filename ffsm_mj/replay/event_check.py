"""Check of logged events: the contact model of each reproduces it at the logged state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from ffsm_mj.contact_models.interface import EventEffect, EventSource, LoggedEvent
from ffsm_mj.errors import UnsupportedContactError
from ffsm_mj.records.events import RunEnded
from ffsm_mj.records.kinds import RecordKind
from ffsm_mj.verification.agreement import Agreement, impossible, is_text, numbers_of


class EventCheck:
    """Reproduces logged events, and compares their records with the logged ones.

    Attributes:
        found: Collects differences.
    """

    def __init__(self, contact_models: Sequence[EventSource], found: Agreement) -> None:
        """Find the contact model of each kind of record; differences are added to ``found``."""
        self.found = found
        self._models = {kind.name: contact_model for contact_model in contact_models for kind in contact_model.records}

    def fault_of(self, kind: RecordKind, records: Sequence[Any]) -> str:
        """Why the records of one event do not fit the models, in one word; empty if they do."""
        return self._models[kind.name].record_fault(records)

    def reproduce(self, event: LoggedEvent) -> EventEffect | None:
        """Reproduce the event at the state in ``data``, and compare its records; None if the models do not allow it."""
        effect = self._effect(event)
        if effect is None or [*map(type, effect.records)] != [*map(type, event.records)]:
            self.found.keep(impossible(f"{event.name} records", event.time_s))
            return effect
        for i, (mine, theirs) in enumerate(zip(effect.records, event.records, strict=True)):
            again = replace(mine, time_s=theirs.time_s, efforts_after=theirs.efforts_after)
            accuracy = dict(effect.accuracy) | _spread(mine, [records[i] for records in effect.varied])
            self.found.record(event.name, theirs, again, theirs.time_s, accuracy)
        return effect

    def _effect(self, event: LoggedEvent) -> EventEffect | None:
        try:
            return self._models[event.kind].replay(event)
        except (RunEnded, UnsupportedContactError, ValueError, ArithmeticError):
            return None


def _spread(record: Any, varied: Sequence[Any]) -> dict[str, float]:
    """How far the numbers of a record change in its variations together, by field."""
    names = [each.name for each in fields(record) if not is_text(getattr(record, each.name))] if varied else []
    numbers = {name: numbers_of(getattr(record, name)) for name in names}
    return {
        name: sum(float(np.abs(numbers_of(getattr(each, name)) - own).max(initial=0.0)) for each in varied)
        for name, own in numbers.items()
    }
