"""Everything that a run left, from memory or from its log the same."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.records.events import Event, ImpactRecord, OutcomeRecord, PhaseRecord, UnhandledContactRecord
from ffsm_mj.records.header import RunHeader

BLOCK_ROWS = 4096
"""A block has no more rows than this."""


class Rows(Protocol):
    """Rows of a log, (n, number of signals): an array, or what is indexed like one and read from disk when asked for."""

    def __len__(self) -> int:
        """Number of rows."""

    def __getitem__(self, key: Any, /) -> Any:
        """Rows, columns or numbers, as of an array."""

    def copy(self) -> FloatArray:
        """All of it as an array of its own."""


@runtime_checkable
class InBlocks(Protocol):
    """Rows that are best read a block at a time."""

    def blocks(self) -> Iterator[FloatArray]:
        """The rows in order, a block at a time."""


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
        if isinstance(self.rows, InBlocks):
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
