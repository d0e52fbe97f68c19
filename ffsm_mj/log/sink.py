"""What every destination of a run understands."""

from __future__ import annotations

from typing import Protocol

from ffsm_mj.arrays import FloatArray
from ffsm_mj.records.events import Event, OutcomeRecord
from ffsm_mj.records.header import RunHeader


class Sink(Protocol):
    """A destination. Calls come in order: ``open``, then ``rows`` and ``event`` as they happen, then ``close``."""

    def open(self, header: RunHeader) -> None:
        """Begin a run."""

    def rows(self, block: FloatArray) -> None:
        """Take rows, (n, number of signals); the array is reused afterwards."""

    def event(self, event: Event) -> None:
        """Take an event; all earlier rows have been handed over."""

    def flush(self) -> None:
        """Make everything taken so far survive a kill."""

    def close(self, outcome: OutcomeRecord | None) -> None:
        """End the run; ``None`` when its end is not known (an error outside the simulation)."""
