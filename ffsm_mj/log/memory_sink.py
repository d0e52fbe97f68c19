"""Sink that keeps a run in memory, in the form that the MCAP reader returns."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.records.events import Event, OutcomeRecord
from ffsm_mj.records.header import RunHeader
from ffsm_mj.records.run_log import Rows, RunLog, run_log
from ffsm_mj.records.signals import TIME, Layout


@dataclass
class MemorySink:
    """Keeps all events, and optionally the rows.

    Attributes:
        keep_rows: Whether rows are kept.
        columns: Keys of the columns to keep, in addition to the time; None: all.
    """

    keep_rows: bool = True
    columns: Collection[str] | None = None
    header: RunHeader | None = None
    blocks: list[FloatArray] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    outcome: OutcomeRecord | None = None
    _places: IntArray | None = None

    def open(self, header: RunHeader) -> None:
        """Begin a run."""
        self.header, self._places = header, None
        if self.columns is not None:
            kept = [signal for signal in header.layout.signals if signal.key in self.columns or signal.key == TIME]
            self.header = replace(header, layout=Layout(tuple(kept)))
            self._places = header.layout.places(self.header.layout.keys)

    def rows(self, block: FloatArray) -> None:
        """Keep a copy of a block."""
        if self.keep_rows:
            self.blocks.append(block.copy() if self._places is None else block[:, self._places])

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
            rows: Its rows, if the sink does not keep them.

        Raises:
            ValueError: The sink was never opened.
        """
        if self.header is None:
            raise ValueError("no run was recorded")
        if rows is None:
            rows = np.concatenate((np.empty((0, len(self.header.layout.signals))), *self.blocks))
        return run_log(self.header, rows, self.events, self.outcome)
