"""Comparison of two runs: scenarios, records of each kind, and signals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import InputError
from ffsm_mj.log.run_folder import BEFORE, SCENARIO
from ffsm_mj.log.scenario import laws_differ, scenario_data
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.records.kinds import RecordKind, kinds_of
from ffsm_mj.records.metadata import logged_start_s
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import TIME
from ffsm_mj.yaml import YamlFault, plain_value

_ORIGIN = f"{BEFORE}/"
_TOGETHER = 8
"""Number of signals compared in one pass over two logs."""
_LATEST_NS = 2.0**63
"""Times of which whole nanoseconds are no 64-bit integer are those of damaged rows."""


@dataclass(frozen=True)
class SignalDifference:
    """Largest difference |b - a| of one signal, and its time; ``first_s``: time of the first difference."""

    key: str
    unit: str
    largest: float
    time_s: float
    first_s: float


@dataclass(frozen=True)
class ImpactDifference:
    """The n-th impact contact of each run; None if a run has fewer."""

    a: ImpactRecord | None
    b: ImpactRecord | None

    @property
    def time_s(self) -> float:
        """Time of b's contact minus that of a's, s; NaN if one is missing."""
        return self.b.time_s - self.a.time_s if self.a and self.b else float("nan")

    @property
    def impulse_N_s(self) -> float:
        """Impulse of b's contact minus that of a's, N s; NaN if one is missing."""
        return self.b.impulse_N_s - self.a.impulse_N_s if self.a and self.b else float("nan")


@dataclass(frozen=True)
class RecordsDifference:
    """Comparison of the records of one kind.

    Attributes:
        kind: Kind of the records.
        a: Number of records of the first run.
        b: Number of records of the second run.
        first: Index of the first difference; None if all are equal.
        sentences: Texts of the two records at that index; empty for a missing one.
    """

    kind: RecordKind
    a: int
    b: int
    first: int | None
    sentences: tuple[str, str]


@dataclass(frozen=True)
class Comparison:
    """Differences between run a and run b.

    Attributes:
        scenario: Keys of the resolved scenarios whose values differ, in order: (key, value in a, in b); None: no such key.
        models: Model files that differ, or that only one run has.
        origins: Sentences on the runs that a and b go on from, where those are not the same.
        impacts: Contacts in order, side by side.
        records: Comparison of each kind of record that either run may have.
        signals: Signals of both runs that differ at some common time, in the order of the log.
        only_a: Signals that only a has.
        only_b: Signals that only b has.
        samples: Number of common times.
        end_s: Last common time, s.
    """

    scenario: tuple[tuple[str, Any, Any], ...]
    models: tuple[str, ...]
    origins: tuple[str, ...]
    impacts: tuple[ImpactDifference, ...]
    records: tuple[RecordsDifference, ...]
    signals: tuple[SignalDifference, ...]
    only_a: tuple[str, ...]
    only_b: tuple[str, ...]
    samples: int
    end_s: float

    @property
    def same(self) -> bool:
        """Whether scenario, models, records and signals are identical bit for bit."""
        records = all(kind.first is None for kind in self.records)
        return records and not (self.scenario or self.models or self.origins or self.signals or self.only_a or self.only_b)

    @property
    def first_s(self) -> float | None:
        """First time at which a coordinate or rate differs; None if there is none."""
        return min((d.first_s for d in self.signals if d.key.startswith("state.")), default=None)


def compare_logs(a: RunLog, b: RunLog) -> Comparison:
    """Compare two runs at their common times."""
    layouts = a.header.layout, b.header.layout
    (times_a, rows_a), (times_b, rows_b) = map(_times_ns, (a, b))
    _, of_a, of_b = np.intersect1d(times_a, times_b, assume_unique=True, return_indices=True)
    of_a, of_b = rows_a[of_a], rows_b[of_b]
    files = _different_files(a, b)
    both = [key for key in layouts[0].keys if key in layouts[1].index and key != TIME]
    return Comparison(
        scenario=tuple(changed_leaves(scenario_data(a), scenario_data(b))),
        models=tuple(sorted(name for name in files if not name.startswith(_ORIGIN))),
        origins=tuple(_origins(a, b)) if any(name.startswith(_ORIGIN) for name in files) else (),
        impacts=tuple(ImpactDifference(x, y) for x, y in zip_longest(a.impacts, b.impacts)),
        records=tuple(_records(a, b)),
        signals=tuple(_signals(a, b, both, (of_a, of_b))),
        only_a=tuple(key for key in layouts[0].keys if key not in layouts[1].index),
        only_b=tuple(key for key in layouts[1].keys if key not in layouts[0].index),
        samples=len(of_a),
        end_s=float(a.column(TIME)[of_a[-1]]) if len(of_a) else 0.0,
    )


def _times_ns(log: RunLog) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.intp]]:
    """Times of a log in whole nanoseconds, once each, and the first row of each: a damaged log may repeat or lack some."""
    times = np.round(log.column(TIME) * 1e9)
    known = np.flatnonzero(np.abs(times) < _LATEST_NS)
    unique, first = np.unique(times[known].astype(np.int64), return_index=True)
    return unique, known[first]


def _records(a: RunLog, b: RunLog) -> Iterator[RecordsDifference]:
    for kind in kinds_of((*a.header.kinds, *b.header.kinds)):
        if kind.plural:
            of_a, of_b = (log.records.get(kind.plural, ()) for log in (a, b))
            pairs = list(zip_longest(of_a, of_b))
            first = next((i for i, (x, y) in enumerate(pairs) if x != y), None)
            differ = pairs[first] if first is not None else (None, None)
            x, y = (kind.sentence(record) if record is not None else "" for record in differ)
            yield RecordsDifference(kind, len(of_a), len(of_b), first, (x, y))


def _signals(a: RunLog, b: RunLog, keys: list[str], chosen: tuple[Any, Any]) -> Iterator[SignalDifference]:
    units = {signal.key: signal.unit for signal in a.header.layout.signals}
    times = a.column(TIME)[chosen[0]]
    for first in range(0, len(keys), _TOGETHER):
        some = keys[first : first + _TOGETHER]
        columns = (_columns(log, some, rows) for log, rows in zip((a, b), chosen, strict=True))
        for key, x, y in zip(some, *columns, strict=True):
            differs = ~((x == y) | (np.isnan(x) & np.isnan(y)))
            if np.any(differs):
                size: FloatArray = np.where(differs, np.abs(y - x), 0.0)
                worst = int(np.argmax(np.nan_to_num(size, nan=np.inf)))
                begins = float(times[np.argmax(differs)])
                yield SignalDifference(key, units[key], float(size[worst]), float(times[worst]), begins)


def _columns(log: RunLog, keys: list[str], rows: Any) -> FloatArray:
    """Some signals at some rows, (number of signals, n), in one pass over a long log."""
    index = log.header.layout.index
    return np.asarray(log.rows[:, [index[key] for key in keys]][rows].T)


def _different_files(a: RunLog, b: RunLog) -> set[str]:
    files = a.header.files, b.header.files
    return {name for name in {*files[0], *files[1]} if files[0].get(name) != files[1].get(name)}


def _origins(a: RunLog, b: RunLog) -> Iterator[str]:
    """Which run goes on from another one, and whether its control law begins anew there."""
    for which, log in (("first", a), ("second", b)):
        kept = log.header.files.get(f"{_ORIGIN}{SCENARIO}")
        if kept is None:
            continue
        sentence = f"the {which} run goes on from another one at {logged_start_s(log.header.metadata):g} s"
        with suppress(YamlFault, UnicodeDecodeError, InputError):  # a log of unknown origin may keep anything
            before = plain_value(kept.decode())
            if isinstance(before, Mapping) and laws_differ(before, scenario_data(log)):
                sentence += ", where phases or task change: the control law of the phase under way begins anew"
        yield sentence


def changed_leaves(a: Any, b: Any, key: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Leaves in which two trees of plain data differ, in the order of the first."""
    if isinstance(a, dict) and isinstance(b, dict):
        for name in dict.fromkeys((*a, *b)):
            yield from changed_leaves(a.get(name), b.get(name), f"{key}.{name}" if key else str(name))
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for i, (x, y) in enumerate(zip(a, b, strict=True)):
            yield from changed_leaves(x, y, f"{key}.{i}")
    elif a != b:
        yield key, a, b
