"""Everything that a run left, from memory or from its log the same."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Protocol, runtime_checkable

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.records.events import Event, ImpactRecord, OutcomeRecord, PhaseRecord, UnhandledContactRecord
from ffsm_mj.records.header import RunHeader
from ffsm_mj.records.kinds import Mark, RecordKind, kind_of, kinds_of

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
        records: What happened once, in order, by the plural of each kind that it may have: ``impacts``, ``phases``, ...
        outcome: How the run ended; None where the log breaks off before.
        damage: What of the log could not be read, in a sentence; empty where it is whole up to its end.
        note: What of the log was left out because nobody here knows what it is, in a sentence; empty where nothing was.
    """

    header: RunHeader
    rows: Rows
    records: Mapping[str, tuple[Any, ...]] = field(default_factory=dict)
    outcome: OutcomeRecord | None = None
    damage: str = ""
    note: str = ""

    @property
    def impacts(self) -> tuple[ImpactRecord, ...]:
        """Contacts of all impacts in order."""
        return self.records.get("impacts", ())

    @property
    def phases(self) -> tuple[PhaseRecord, ...]:
        """Beginnings of phases in order."""
        return self.records.get("phases", ())

    @property
    def unhandled(self) -> tuple[UnhandledContactRecord, ...]:
        """Contacts that nobody resolved."""
        return self.records.get("unhandled_contacts", ())

    @property
    def kinds(self) -> tuple[RecordKind, ...]:
        """The kinds of its records, in the order of its topics."""
        return tuple(kind for kind in kinds_of(self.header.kinds) if kind.plural)

    @property
    def event_kinds(self) -> tuple[RecordKind, ...]:
        """The kinds that tell of events: their records say what moved before and after."""
        return tuple(kind for kind in self.kinds if "qvel_after" in {each.name for each in fields(kind.record)})

    @property
    def instants_s(self) -> list[float]:
        """Times of all events: a run that ends at one has a sample there, between two ticks."""
        return [kind.time(record) for kind in self.event_kinds for record in self.records.get(kind.plural, ())]

    def events(self) -> list[Event]:
        """All records in order of time."""
        found = [record for kind in self.kinds for record in self.records.get(kind.plural, ())]
        return sorted(found, key=lambda record: kind_of(record).time(record))

    def marks(self) -> list[tuple[RecordKind, float, Mark]]:
        """What is drawn of its records: whose, when in s, and what; by kind, then in order."""
        return [
            (kind, kind.time(record), mark)
            for kind in self.kinds
            if kind.marks is not None
            for record in self.records.get(kind.plural, ())
            for mark in kind.marks(record)
        ]

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
    """Sort events by kind.

    Raises:
        KeyError: An event is of a kind that the header does not name.
    """
    records: dict[str, list[Event]] = {kind.plural: [] for kind in kinds_of(header.kinds) if kind.plural}
    for event in events:
        records[kind_of(event).plural].append(event)
    return RunLog(header, rows, {plural: tuple(found) for plural, found in records.items()}, outcome, damage)
