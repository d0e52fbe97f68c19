"""Intervals of persistent contact, and of grasps from closing to release, computed from rows and records."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.grasp.records import GraspRecord, ReleaseRecord
from ffsm_mj.contact_models.persistent.record import (
    ContactBegins,
    ContactEnds,
    ContactRecord,
)
from ffsm_mj.contact_models.persistent.rule_columns import RuleMode, mode_key, pairs_columns
from ffsm_mj.records.events import Event
from ffsm_mj.records.load_columns import load_columns_of
from ffsm_mj.records.record import Values, declared, record
from ffsm_mj.records.signals import Layout, identifier
from ffsm_mj.ties import instant_s

_UNNAMED = ""
"""Stands for pairs that were closed at the first row, as long as no record names them."""


@record
class ContactInterval:
    """Interval in which at least one pair of a contact rule is closed."""

    rule: str = declared("Name of the contact rule.")
    pairs: tuple[str, ...] = declared(
        "Names of its pairs that were closed in the interval, in the order of their closing; the rule's name stands for "
        "those that are closed at the first row of a run that goes on and have no record."
    )
    start_s: float = declared(
        "Time at which the first pair closed: that of its first impact; that of the first row in a run that goes on from "
        "within the contact."
    )
    end_s: float | None = declared(
        "Time at which the last one opened; None, NaN in tables, if one is closed at the end of the log."
    )
    impulse_N_s: float = declared("Integral of the contact force over the interval.")
    peak_force_N: float = declared("Greatest contact force of the samples and events in the interval.")
    peak_force_s: float = declared("Time of the greatest force.")
    sliding_s: float = declared(
        "Time in the interval for which a pair slides under friction; 0 without friction.",
        default=0.0,
    )
    slip_m: float = declared("Slip distance under friction over the interval.", default=0.0)
    peak_friction_use: float = declared(
        "Greatest share of the friction limit that the samples in the interval use; 1 if they slide.",
        default=0.0,
    )


class _Slip:
    """Accumulator of slip in one interval."""

    def __init__(self, start_s: float, columns: Sequence[int]) -> None:
        self._columns, self._pairs = columns, set[str]()
        self._at_s, self._sliding_s = start_s, 0.0
        self._before_m: float | None = None
        self._until_m = self.peak_use = 0.0

    def go_on(self, row: FloatArray, *, slides: bool) -> None:
        """Begin at a row at which the contact is closed already."""
        self._pairs |= {_UNNAMED} if slides else set()
        self._before_m = float(row[self._columns[1]]) if len(self._columns) else None

    def record(self, record: ContactRecord) -> None:
        """Process a record of the contact."""
        self._sliding_s, self._at_s = self.sliding_s(record.time_s), record.time_s
        if not isinstance(record, ContactBegins):
            self._pairs.discard(_UNNAMED)  # the record says from here on whether that pair slides
        if record.friction == "sliding":
            self._pairs.add(record.pair)
        else:
            self._pairs.discard(record.pair)

    def sliding_s(self, until_s: float) -> float:
        """Time for which a pair slides, up to a time after the last record."""
        return self._sliding_s + (until_s - self._at_s if self._pairs else 0.0)

    def rows(self, before: FloatArray | None, rows: FloatArray) -> None:
        """Process the next rows of the interval, given the row before them."""
        if not len(self._columns) or not len(rows):
            return
        use, slip = rows[:, self._columns].T
        if self._before_m is None:
            self._before_m = 0.0 if before is None else float(before[self._columns[1]])
        self._until_m = float(slip[-1])
        self.peak_use = max(self.peak_use, float(np.nan_to_num(use).max()))

    @property
    def slip_m(self) -> float:
        """Slip distance."""
        return max(0.0, self._until_m - (self._before_m or 0.0))


class _OpenContact:
    """Accumulator for one interval."""

    def __init__(
        self, rule: str, start_s: float, impulse_N_s: float, columns: Sequence[int], of_slip: Sequence[int]
    ) -> None:
        self.rule, self.start_s, self.end_s = rule, start_s, math.inf
        self._slip, self._last_s = _Slip(start_s, of_slip), start_s
        self._pairs, self._closed = list[str](), set[str]()
        self._unnamed = 0.0  # number of closed pairs that no record has named yet
        self._columns = columns
        self._before = self._until = impulse_N_s
        self._peak, self._peak_s = -math.inf, start_s

    def go_on(self, pairs: float, row: FloatArray, *, slides: bool) -> None:
        """Begin at a row at which this many pairs are closed already."""
        self._unnamed = pairs
        self._slip.go_on(row, slides=slides)

    def record(self, record: ContactRecord) -> None:
        """Process a record of the contact."""
        self._until = record.impulse_N_s
        self._slip.record(record)
        self._higher(max(record.force_before_N, record.force_after_N), record.time_s)
        begins = isinstance(record, ContactBegins)
        if begins or (self._unnamed > 0.0 and record.pair not in self._closed):
            self._unnamed -= not begins
            self._closed.add(record.pair)
            self._pairs += [record.pair] if record.pair not in self._pairs else []
        if isinstance(record, ContactEnds):
            self._closed.discard(record.pair)
            self.end_s = math.inf if self._closed or self._unnamed > 0.0 else record.time_s

    def rows(self, times: FloatArray, block: FloatArray, before: FloatArray | None) -> None:
        """Process the rows within the interval; ``before`` is the row before the first one."""
        first, last = np.searchsorted(times, self.start_s), np.searchsorted(times, self.end_s, side="right")
        # The row after the end has the slip of the last part.
        self._slip.rows(block[first - 1] if first else before, block[first : last + 1])
        self._last_s = max(self._last_s, float(times[-1]))
        if first >= last or not len(self._columns):
            return
        force, impulse = block[first:last, self._columns].T
        force = np.where(np.isfinite(force), force, -math.inf)
        highest = int(np.argmax(force))
        self._higher(float(force[highest]), float(times[first + highest]))
        if self.end_s == math.inf:
            self._until = max(self._until, float(impulse[-1]))

    def _higher(self, force_N: float, time_s: float) -> None:
        if (force_N, -time_s) > (self._peak, -self._peak_s):
            self._peak, self._peak_s = force_N, time_s

    def interval(self) -> ContactInterval:
        """The interval so far."""
        end_s = None if self.end_s == math.inf else self.end_s
        impulse, slip = self._until - self._before, self._slip
        sliding_s = slip.sliding_s(self._last_s if end_s is None else end_s)
        of_slip = sliding_s, slip.slip_m, slip.peak_use
        pairs = (*self._pairs, *([self.rule] if self._unnamed > 0.0 else []))
        return ContactInterval(self.rule, pairs, self.start_s, end_s, impulse, self._peak, self._peak_s, *of_slip)


class ContactIntervals:
    """Accumulates the contact intervals of one run from blocks of rows and records.

    A record must be passed before the first block that extends beyond its time; all records of a log may come first.
    """

    def __init__(self, layout: Layout, *, goes_on: bool = False) -> None:
        """Start without records.

        Args:
            layout: Columns of the rows.
            goes_on: The run goes on from a state: no record tells of contacts that are closed there, the first row does.
        """
        self._layout = layout
        self._until_first_row: list[ContactRecord] | None = [] if goes_on else None
        self._spells: list[_OpenContact] = []
        self._lasting: dict[str, _OpenContact] = {}
        self._awaited: list[_OpenContact] = []
        self._last_row: FloatArray | None = None

    def event(self, event: Event) -> None:
        """Process the next record; other kinds are ignored."""
        if not isinstance(event, ContactRecord):
            return
        if self._until_first_row is not None:
            self._until_first_row.append(event)
        else:
            self._record(event)

    def _record(self, record: ContactRecord) -> None:
        if isinstance(record, ContactBegins) and record.rule not in self._lasting:
            self._open(record.rule, record.time_s, record.impulse_N_s)
        if record.rule in self._lasting:  # otherwise its start is in a damaged part of the log
            self._lasting[record.rule].record(record)
            if self._lasting[record.rule].end_s < math.inf:
                del self._lasting[record.rule]

    def _open(self, rule: str, start_s: float, impulse_N_s: float) -> _OpenContact:
        of_force, of_slip = self._columns(rule, "force_N", "impulse_N_s"), self._columns(rule, "friction_use", "slip_m")
        spell = self._lasting[rule] = _OpenContact(rule, start_s, impulse_N_s, of_force, of_slip)
        self._spells.append(spell)
        self._awaited.append(spell)
        return spell

    def _go_on(self, row: FloatArray, records: Sequence[ContactRecord]) -> None:
        """Process the first row of a run that goes on, and the records so far."""
        time_s, index = float(row[self._layout.time]), self._layout.index
        earlier = sum(one.time_s < time_s for one in records)
        for one in records[:earlier]:
            self._record(one)
        for rule, column in pairs_columns(self._layout).items():
            impulse = self._columns(rule, "impulse_N_s")
            if row[column] > 0.0 and rule not in self._lasting and impulse:
                slides = row[index.get(mode_key(rule), column)] == RuleMode.SLIDING
                self._open(rule, time_s, float(row[impulse[0]])).go_on(float(row[column]), row, slides=bool(slides))
        for one in records[earlier:]:
            self._record(one)

    def _columns(self, rule: str, *names: str) -> list[int]:
        """Those of some columns of a rule that exist."""
        keys = (f"contact.{identifier(rule)}_{name}" for name in names)
        return [self._layout.index[key] for key in keys if key in self._layout.index]

    def rows(self, block: FloatArray) -> None:
        """Process the next rows."""
        if self._until_first_row is not None and len(block):
            records, self._until_first_row = self._until_first_row, None
            self._go_on(block[0], records)
        before, self._last_row = self._last_row, block[-1].copy() if len(block) else self._last_row
        if not self._awaited:
            return
        times = block[:, self._layout.time]
        for spell in self._awaited:
            spell.rows(times, block, before)
        self._awaited = [spell for spell in self._awaited if not spell.end_s < times[-1]]

    def intervals(self) -> tuple[ContactInterval, ...]:
        """All intervals so far in order of their start, except those of zero length."""
        return tuple(spell.interval() for spell in self._spells if spell.end_s > spell.start_s + instant_s(spell.start_s))


@record
class GraspInterval:
    """Interval in which an object was grasped."""

    grasp: str = declared("Name of the grasp.")
    time_s: float = declared("Time of closing.")
    release_s: float | None = declared(
        "Time of the release, or at which another grasp of the same two sites takes over; None, NaN in tables, if the grasp "
        "is closed at the end of the log.",
    )
    loss_J: float = declared("Kinetic energy lost at closing.")
    impulse: Values = declared("Impulse on the object at closing in world axes.", unit="N s", components="xyz")
    peak_force_N: float = declared("Greatest force on the object in the interval, of the samples and right after events.")
    peak_torque_N_m: float = declared("Greatest torque on the object about its site in the interval, likewise.")
    peak_s: float = declared("Time of the greatest force.")


class _OpenGrasp:
    """Accumulator for one interval."""

    def __init__(self, begins: GraspRecord, layout: Layout) -> None:
        self.begins, self.end_s = begins, math.inf
        columns = load_columns_of(layout, begins.grasp)
        self._places = (layout.places(columns.loads), layout.places(columns.event_loads)) if columns is not None else None
        self._force, self._torque, self._peak_s = 0.0, 0.0, begins.time_s

    def rows(self, times: FloatArray, block: FloatArray) -> None:
        """Process the rows within the interval; its end, the instant of the release, is excluded."""
        if self._places is None:
            return
        loads, events = (block[:, places] for places in self._places)
        for force, torque, at_s in events[(events[:, 2] >= self.begins.time_s) & (events[:, 2] < self.end_s)].tolist():
            self._higher(force, torque, at_s)
        first, last = np.searchsorted(times, self.begins.time_s), np.searchsorted(times, self.end_s)
        if first >= last:
            return
        force, torque = np.linalg.norm(np.nan_to_num(loads[first:last]).reshape(-1, 2, 3), axis=2).T
        highest = int(np.argmax(force))
        self._higher(float(force[highest]), float(torque.max()), float(times[first + highest]))

    def _higher(self, force: float, torque: float, at_s: float) -> None:
        if force > self._force:
            self._force, self._peak_s = force, at_s
        self._torque = max(self._torque, torque)

    def interval(self) -> GraspInterval:
        """The interval so far."""
        begins, end_s = self.begins, None if self.end_s == math.inf else self.end_s
        peaks = self._force, self._torque, self._peak_s
        return GraspInterval(begins.grasp, begins.time_s, end_s, begins.loss_J, begins.impulse_N_s, *peaks)


class GraspIntervals:
    """Accumulates the grasp intervals of one run from blocks of rows and records."""

    def __init__(self, layout: Layout) -> None:
        """Start without records."""
        self._layout = layout
        self._spells: list[_OpenGrasp] = []
        self._awaited: list[_OpenGrasp] = []

    def event(self, event: Event) -> None:
        """Process the next record; other kinds are ignored."""
        if isinstance(event, GraspRecord):
            self._end(event.replaces, event.time_s)
            self._spells.append(_OpenGrasp(event, self._layout))
            self._awaited.append(self._spells[-1])
        elif isinstance(event, ReleaseRecord):
            self._end(event.grasp, event.time_s)

    def _end(self, grasp: str, time_s: float) -> None:
        """End the interval of a grasp; without one its closing is in a damaged part of the log."""
        spell = next(
            (candidate for candidate in self._spells if candidate.begins.grasp == grasp and candidate.end_s == math.inf),
            None,
        )
        if spell is not None:
            spell.end_s = time_s

    def rows(self, block: FloatArray) -> None:
        """Process the next rows."""
        times = block[:, self._layout.time]
        for spell in self._awaited:
            spell.rows(times, block)
        self._awaited = [spell for spell in self._awaited if not spell.end_s < times[-1]]

    def intervals(self) -> tuple[GraspInterval, ...]:
        """All intervals so far, in order."""
        return tuple(spell.interval() for spell in self._spells)
