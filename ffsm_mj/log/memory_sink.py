"""A run kept in memory, in the form in which the MCAP reader returns one."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.records.events import Event, OutcomeRecord
from ffsm_mj.records.header import RunHeader
from ffsm_mj.records.run_log import Rows, RunLog, run_log


@dataclass
class MemorySink:
    """Keeps every event, and every row where that is wanted."""

    keep_rows: bool = True
    header: RunHeader | None = None
    blocks: list[FloatArray] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    outcome: OutcomeRecord | None = None

    def open(self, header: RunHeader) -> None:
        """Begin a run."""
        self.header = header

    def rows(self, block: FloatArray) -> None:
        """Keep a copy of a block."""
        if self.keep_rows:
            self.blocks.append(block.copy())

    def event(self, event: Event) -> None:
        """Keep an event."""
        self.events.append(event)

    def flush(self) -> None:
        """Nothing to do: memory does not survive a kill."""

    def close(self, outcome: OutcomeRecord | None) -> None:
        """End the run."""
        self.outcome = outcome

    def log(self, rows: Rows | None = None) -> RunLog:
        """The run so far.

        Args:
            rows: Where its rows are, where they were not kept.

        Raises:
            ValueError: Nothing was opened.
        """
        if self.header is None:
            raise ValueError("no run was recorded")
        if rows is None:
            rows = np.concatenate((np.empty((0, len(self.header.layout.signals))), *self.blocks))
        return run_log(self.header, rows, self.events, self.outcome)
