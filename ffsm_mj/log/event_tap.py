"""Sink that hands on the events of a run as they happen."""

from __future__ import annotations

from ffsm_mj.arrays import FloatArray
from ffsm_mj.records.events import Event, OutcomeRecord
from ffsm_mj.records.header import RunHeader


class EventTap:
    """Keeps events until they are taken."""

    def __init__(self) -> None:
        """Start without events."""
        self._events: list[Event] = []

    def take(self) -> tuple[Event, ...]:
        """Events since the last call, in the order of the log."""
        if not self._events:
            return ()
        taken, self._events = tuple(self._events), []
        return taken

    def open(self, header: RunHeader) -> None:
        """Nothing to do."""

    def rows(self, block: FloatArray) -> None:
        """Rows are not kept."""

    def event(self, event: Event) -> None:
        """Keep an event."""
        self._events.append(event)

    def flush(self) -> None:
        """Nothing to do."""

    def close(self, outcome: OutcomeRecord | None) -> None:
        """Nothing to do."""
