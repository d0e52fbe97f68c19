"""A run kept in memory, in the form in which the MCAP reader returns one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from ffsm_mj.events import Event, ImpactRecord, OutcomeRecord, PhaseRecord, UnhandledContactRecord
from ffsm_mj.log.sink import RunHeader
from ffsm_mj.log.stored_rows import BLOCK_ROWS, Rows, StoredRows
from ffsm_mj.model import FloatArray


@dataclass(frozen=True)
class RunLog:
    """Everything a log holds.

    Attributes:
        header: Names, scenario, files.
        rows: One row per control tick, (n, number of signals): an array, or on disk and read when asked for.
        impacts: Contacts of all impacts in order.
        phases: Beginnings of phases in order.
        unhandled: Contacts that nobody resolved.
        outcome: How the run ended; None where the log breaks off before.
        damage: What of the log could not be read, in a sentence; empty where it is whole up to its end.
    """

    header: RunHeader
    rows: Rows
    impacts: tuple[ImpactRecord, ...] = ()
    phases: tuple[PhaseRecord, ...] = ()
    unhandled: tuple[UnhandledContactRecord, ...] = ()
    outcome: OutcomeRecord | None = None
    damage: str = ""

    def column(self, key: str) -> FloatArray:
        """One signal over the run, (n,).

        Raises:
            KeyError: No such signal.
        """
        return np.asarray(self.rows[:, self.header.layout.index[key]])

    def blocks(self) -> Iterator[FloatArray]:
        """The rows in order, a few thousand at a time: what a long run should be read by, (n, number of signals) each."""
        if isinstance(self.rows, StoredRows):
            yield from self.rows.blocks()
            return
        for first in range(0, len(self.rows), BLOCK_ROWS):
            yield np.asarray(self.rows[first : first + BLOCK_ROWS])


def run_log(
    header: RunHeader, rows: Rows, events: Sequence[Event], outcome: OutcomeRecord | None, damage: str = ""
) -> RunLog:
    """Sort events by kind."""
    return RunLog(
        header,
        rows,
        tuple(event for event in events if isinstance(event, ImpactRecord)),
        tuple(event for event in events if isinstance(event, PhaseRecord)),
        tuple(event for event in events if isinstance(event, UnhandledContactRecord)),
        outcome,
        damage,
    )


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
