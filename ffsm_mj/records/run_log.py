"""Complete data of a run, from memory or from its log: header, rows and events, and the order of events at one instant."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from itertools import product
from typing import Any, Protocol, TypeVar, runtime_checkable

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.cached_property import cached_property
from ffsm_mj.records.events import Event, ImpactRecord, OutcomeRecord, PhaseRecord, UnhandledContactRecord
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
        records: Event records in order, by the plural of each kind that the run may have: ``impacts``, ``phases``, ...
        outcome: How the run ended; None if the log is incomplete.
        damage: What of the log could not be read, as text; empty if it is intact up to its end.
        note: What of the log was skipped because its schema is unknown, as text; empty if nothing was.
        lost: Times between which a part of the file is lost, s, in order: of the last message before it and of the first one
            after it, or infinite; starts and ends are non-decreasing. Events at these times may lack records, and are left
            out. Or ``DOUBTFUL``.
    """

    header: RunHeader
    rows: Rows
    records: Mapping[str, tuple[Any, ...]] = field(default_factory=dict)
    outcome: OutcomeRecord | None = None
    damage: str = ""
    note: str = ""
    lost: tuple[tuple[float, float], ...] = ()

    @property
    def impacts(self) -> tuple[ImpactRecord, ...]:
        """Contacts of all impacts in order."""
        return self.records.get("impacts", ())

    @property
    def impact_records(self) -> tuple[Any, ...]:
        """Records of all impacts in order, of contacts and of joints at their limits; those of one impact are adjacent."""
        both = (*self.impacts, *self.records.get("limit_impacts", ()))
        return tuple(sorted(both, key=lambda record: record.event)) if len(both) > len(self.impacts) else both

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
        return [kind.time(record) for kind in self.event_kinds for record in self.records.get(kind.plural, ())]

    def whole_events(self) -> dict[str, tuple[Any, ...]]:
        """Records by plural without those of events at times at which a part of the log is lost: some may be missing."""
        whole = dict(self.records)
        starts, ends = np.array(self.lost).reshape(-1, 2).T
        for kind in self.event_kinds if self.lost else ():
            records = whole.get(kind.plural, ())
            times = np.array([kind.time(record) for record in records])
            # As starts and ends are non-decreasing, the last part that starts before is the one that ends last.
            last = np.searchsorted(starts, times, side="right") - 1
            lacks = (last >= 0) & (times <= ends[last])
            whole[kind.plural] = tuple(record for record, lack in zip(records, lacks.tolist(), strict=True) if not lack)
        return whole

    @property
    def is_doubtful(self) -> bool:
        """Whether what the log says of itself may be damaged, although every message was read."""
        return self.lost == DOUBTFUL

    def events(self) -> list[Event]:
        """All records in order of time; at one time those that are numbered together by number, the others by kind."""
        kinds = self.kinds
        series = [kind.event_group or kind.name if kind.numbered_alone else "" for kind in kinds]
        entries: list[tuple[float, int, int, Event]] = []
        for i, kind in enumerate(kinds):
            for record in self.records.get(kind.plural, ()):
                number = getattr(record, "event", None)
                place = i if number is None else series.index(series[i])
                entries.append((kind.time(record), place, number or 0, record))
        return [record for *_, record in sorted(entries, key=lambda entry: entry[:3])]

    def marks(self) -> list[tuple[RecordKind, float, Mark]]:
        """Marks of its records as (kind, time in s, mark); by kind, then in order."""
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
        """The rows in order in blocks of a few thousand, (n, number of signals) each; use this for long runs."""
        if isinstance(self.rows, InBlocks):
            yield from self.rows.blocks()
            return
        for first in range(0, len(self.rows), READ_ROWS):
            yield np.asarray(self.rows[first : first + READ_ROWS])


def run_log(
    header: RunHeader, rows: Rows, events: Sequence[Event], outcome: OutcomeRecord | None, damage: str = ""
) -> RunLog:
    """Create a log from events in order of time.

    Raises:
        KeyError: An event is of a kind that the header does not list.
    """
    records: dict[str, list[Event]] = {kind.plural: [] for kind in kinds_of(header.kinds) if kind.plural}
    for event in events:
        records[kind_of(event).plural].append(event)
    return RunLog(header, rows, {plural: tuple(kept) for plural, kept in records.items()}, outcome, damage)


_Event = TypeVar("_Event")


def merged(first: Sequence[_Event], second: Sequence[_Event], jump: Callable[[_Event, _Event], float]) -> list[_Event]:
    """Merge two sequences so that the state after each event is nearest to that before the next.

    The two states need not be equal, as a drift projection may lie between them. Dynamic programming over the numbers of
    events taken from each sequence minimises the sum of all jumps; in a tie, those of the first sequence come first.

    Args:
        first: Events in their order.
        second: Others in theirs.
        jump: Distance between the state after one event and the state before another.
    """
    if not first or not second:
        return [*first, *second]
    both = first, second
    sums: dict[tuple[int, int, int], float] = {}
    before: dict[tuple[int, int, int], tuple[int, int, int]] = {}
    counts = len(first), len(second)
    for i, j, which in product(range(counts[0] + 1), range(counts[1] + 1), (0, 1)):
        if (i, j)[which]:
            event, rest = (first[i - 1], (i - 1, j)) if which == 0 else (second[j - 1], (i, j - 1))
            previous = [(*rest, last) for last in (1, 0) if rest[last]]
            costs = [sums[end] + jump(both[end[2]][rest[end[2]] - 1], event) for end in previous]
            sums[i, j, which] = min(costs, default=0.0)
            if costs:
                before[i, j, which] = previous[costs.index(min(costs))]
    place: tuple[int, int, int] | None = min(((*counts, last) for last in (1, 0)), key=lambda end: sums[end])
    out = []
    while place is not None:
        out.append(both[place[2]][place[place[2]] - 1])
        place = before.get(place)
    return out[::-1]
