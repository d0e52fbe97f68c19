"""Complete data of a run, from memory or from its log: header, rows and events."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Any, Protocol, runtime_checkable

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.cached_property import cached_property
from ffsm_mj.records.events import ImpactRecord, OutcomeRecord, PhaseRecord, UnhandledContactRecord
from ffsm_mj.records.kinds import Mark, RecordKind, kind_of, kinds_of
from ffsm_mj.records.signals import Layout
from ffsm_mj.yaml import write_yaml


@dataclass(frozen=True)
class RunHeader:
    """Metadata needed to interpret the rows of a run, fixed before the first one.

    Attributes:
        scenario_name: Name of the scenario.
        scenario: The resolved scenario, as plain data or as YAML text; its MJCF paths are keys of ``files``.
        layout: The columns of a row.
        files: Contents of every model file by its path relative to the scenario.
        metadata: Versions, start time, task target, whether the system is conservative; text by name.
        kinds: Names of the kinds of records of its contact models, in addition to those of every run.
    """

    scenario_name: str
    scenario: Mapping[str, Any] | str
    layout: Layout
    files: Mapping[str, bytes]
    metadata: Mapping[str, str]
    kinds: tuple[str, ...] = ()

    @cached_property
    def scenario_yaml(self) -> str:
        """The resolved scenario as YAML text. Of a run in memory it takes a third of the time of a short run to write."""
        return self.scenario if isinstance(self.scenario, str) else write_yaml(self.scenario)


READ_ROWS = 4096
"""Greatest number of rows in a block."""
DOUBTFUL = ((-np.inf, -np.inf),)
"""What is lost of a log of which every message was read, but what it says of itself may be damaged."""


class Rows(Protocol):
    """Rows of a log, (n, number of signals): an array, or an object indexed like one that reads from disk on demand."""

    def __len__(self) -> int:
        """Number of rows."""

    def __getitem__(self, key: Any, /) -> Any:
        """Rows, columns or numbers, as of an array."""

    def copy(self) -> FloatArray:
        """All rows as a new array."""


@runtime_checkable
class InBlocks(Protocol):
    """Rows that are read in blocks."""

    def blocks(self) -> Iterator[FloatArray]:
        """The rows in order, block by block."""


@dataclass(frozen=True)
class RunLog:
    """Contents of a log.

    Attributes:
        header: Names, scenario, files.
        rows: One row per control tick, (n, number of signals): an array, or read from disk on demand.
        events: Event records of all kinds, in the order in which they were written: that in which they happened.
        outcome: How the run ended; None if the log is incomplete.
        damage: What of the log could not be read, as text; empty if it is intact up to its end.
        note: What of the log was skipped because its schema is unknown, as text; empty if nothing was.
        lost: Times between which a part of the file is lost, s, in order: of the last message before it and of the first one
            after it, or infinite; starts and ends are non-decreasing. Events at these times may lack records, and are left
            out. Or ``DOUBTFUL``.
    """

    header: RunHeader
    rows: Rows
    events: tuple[Any, ...] = ()
    outcome: OutcomeRecord | None = None
    damage: str = ""
    note: str = ""
    lost: tuple[tuple[float, float], ...] = ()

    @cached_property
    def records(self) -> Mapping[str, tuple[Any, ...]]:
        """Event records in order, by the plural of each kind that the run may have: ``impacts``, ``phases``, ...

        Raises:
            KeyError: An event is of a kind that the header does not list.
        """
        records: dict[str, list[Any]] = {kind.plural: [] for kind in self.kinds}
        for event in self.events:
            records[kind_of(event).plural].append(event)
        return {plural: tuple(of_kind) for plural, of_kind in records.items()}

    @property
    def impacts(self) -> tuple[ImpactRecord, ...]:
        """Contacts of all impacts in order."""
        return self.records.get("impacts", ())

    @property
    def impact_records(self) -> tuple[Any, ...]:
        """Records of all impacts in order, of contacts and of joints at their limits; those of one impact are adjacent."""
        return tuple(event for event in self.events if kind_of(event).series == "impact")

    @property
    def phases(self) -> tuple[PhaseRecord, ...]:
        """Beginnings of phases in order."""
        return self.records.get("phases", ())

    @property
    def unhandled(self) -> tuple[UnhandledContactRecord, ...]:
        """Unhandled contacts in order."""
        return self.records.get("unhandled_contacts", ())

    @property
    def kinds(self) -> tuple[RecordKind, ...]:
        """The kinds of its records, in the order of its topics."""
        return tuple(kind for kind in kinds_of(self.header.kinds) if kind.plural)

    @property
    def event_kinds(self) -> tuple[RecordKind, ...]:
        """The kinds of events whose records hold the state before and after."""
        return tuple(kind for kind in self.kinds if "qvel_after" in {field.name for field in fields(kind.record)})

    @property
    def instants_s(self) -> list[float]:
        """Times of all events: a run that ends at an event has a sample there, between two ticks."""
        return [kind.time(record) for kind in self.event_kinds for record in self.records[kind.plural]]

    def whole_events(self) -> tuple[Any, ...]:
        """Its records without those of events at times at which a part of the log is lost: some may be missing."""
        starts, ends = np.array(self.lost).reshape(-1, 2).T
        times = np.array([kind_of(event).time(event) for event in self.events])
        # As starts and ends are non-decreasing, the last part that starts before is the one that ends last.
        last = np.searchsorted(starts, times, side="right") - 1
        lacks = (last >= 0) & (times <= ends[last])
        of_states = {kind.record for kind in self.event_kinds}
        return tuple(
            event for event, lack in zip(self.events, lacks, strict=True) if not (lack and type(event) in of_states)
        )

    @property
    def is_doubtful(self) -> bool:
        """Whether what the log says of itself may be damaged, although every message was read."""
        return self.lost == DOUBTFUL

    def marks(self) -> list[tuple[RecordKind, float, Mark]]:
        """Marks of its records as (kind, time in s, mark); by kind, then in order."""
        return [
            (kind, kind.time(record), mark)
            for kind in self.kinds
            if kind.marks is not None
            for record in self.records[kind.plural]
            for mark in kind.marks(record)
        ]

    def column(self, key: str) -> FloatArray:
        """One signal over the run, (n,).

        Raises:
            KeyError: No such signal.
        """
        return np.asarray(self.rows[:, self.header.layout.index[key]])

    def blocks(self) -> Iterator[FloatArray]:
        """The rows in order in blocks of a few thousand, (n, number of signals) each; use this for long runs."""
        if isinstance(self.rows, InBlocks):
            yield from self.rows.blocks()
            return
        for first in range(0, len(self.rows), READ_ROWS):
            yield np.asarray(self.rows[first : first + READ_ROWS])
