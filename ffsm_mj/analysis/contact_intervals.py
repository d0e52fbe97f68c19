"""Intervals of persistent contact, computed from rows and records."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.persistent.record import (
    CONTACT_BEGINS,
    CONTACT_CHANGES,
    CONTACT_ENDS,
    ContactBegins,
    ContactEnds,
    ContactRecord,
)
from ffsm_mj.records.events import Event
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import Layout, identifier

COLUMNS = {
    "rule": ("", "name of the contact rule"),
    "pairs": ("", "names of its pairs that were closed in the interval"),
    "start_s": ("s", "time at which the first pair closes"),
    "end_s": ("s", "time at which the last one opens; NaN if one is closed at the end of the log"),
    "impulse_N_s": ("N s", "integral of the contact force over the interval"),
    "peak_force_N": ("N", "greatest contact force of the samples and events in the interval"),
    "peak_force_s": ("s", "time of the greatest force"),
}


@dataclass(frozen=True)
class ContactInterval:
    """Interval in which at least one pair of a contact rule is closed.

    Attributes:
        rule: Name of the contact rule.
        pairs: Names of its pairs that were closed in the interval, in the order of their closing.
        start_s: Time at which the first pair closed: that of its first impact.
        end_s: Time at which the last one opened; None if one is closed at the end of the log.
        impulse_N_s: Integral of the contact force over the interval.
        peak_force_N: Greatest contact force of the samples and events in the interval.
        peak_force_s: Time of the greatest force.
    """

    rule: str
    pairs: tuple[str, ...]
    start_s: float
    end_s: float | None
    impulse_N_s: float
    peak_force_N: float
    peak_force_s: float


class _OpenContact:
    """Accumulator for one interval."""

    def __init__(self, begins: ContactRecord, columns: Sequence[int]) -> None:
        self.rule, self.start_s, self.end_s = begins.rule, begins.time_s, math.inf
        self._pairs, self._closed = [begins.pair], {begins.pair}
        self._columns = columns
        self._before = self._until = begins.impulse_N_s
        self._peak, self._peak_s = begins.force_after_N, begins.time_s

    def record(self, record: ContactRecord) -> None:
        """Process a record of the contact."""
        self._until = record.impulse_N_s
        self._higher(max(record.force_before_N, record.force_after_N), record.time_s)
        if isinstance(record, ContactBegins):
            self._closed.add(record.pair)
            self._pairs += [record.pair] if record.pair not in self._pairs else []
        elif isinstance(record, ContactEnds):
            self._closed.discard(record.pair)
            self.end_s = math.inf if self._closed else record.time_s

    def rows(self, times: FloatArray, block: FloatArray) -> None:
        """Process the rows within the interval."""
        first, last = np.searchsorted(times, self.start_s), np.searchsorted(times, self.end_s, side="right")
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
        impulse = self._until - self._before
        return ContactInterval(self.rule, tuple(self._pairs), self.start_s, end_s, impulse, self._peak, self._peak_s)


class ContactIntervals:
    """Accumulates the contact intervals of one run from blocks of rows and records.

    A record must be passed before the first block that extends beyond its time; all records of a log may come first.
    """

    def __init__(self, layout: Layout) -> None:
        """Start without records."""
        self._layout = layout
        self._spells: list[_OpenContact] = []
        self._lasting: dict[str, _OpenContact] = {}
        self._awaited: list[_OpenContact] = []

    def event(self, event: Event) -> None:
        """Process the next record; other kinds are ignored."""
        if not isinstance(event, ContactRecord):
            return
        if isinstance(event, ContactBegins) and event.rule not in self._lasting:
            keys = (f"contact.{identifier(event.rule)}_{name}" for name in ("force_N", "impulse_N_s"))
            spell = _OpenContact(event, [self._layout.index[key] for key in keys if key in self._layout.index])
            self._lasting[event.rule] = spell
            self._spells.append(spell)
            self._awaited.append(spell)
        elif event.rule in self._lasting:  # otherwise its start is in a damaged part of the log
            self._lasting[event.rule].record(event)
            if self._lasting[event.rule].end_s < math.inf:
                del self._lasting[event.rule]

    def rows(self, block: FloatArray) -> None:
        """Process the next rows."""
        if not self._awaited:
            return
        times = block[:, self._layout.time]
        for spell in self._awaited:
            spell.rows(times, block)
        self._awaited = [spell for spell in self._awaited if not spell.end_s < times[-1]]

    def intervals(self) -> tuple[ContactInterval, ...]:
        """All intervals so far in order of their start, except those of zero length."""
        return tuple(spell.interval() for spell in self._spells if spell.end_s > spell.start_s)


def contact_records(log: RunLog) -> list[Any]:
    """Records of persistent contact in a log, in order."""
    kinds = (CONTACT_BEGINS, CONTACT_CHANGES, CONTACT_ENDS)
    found = [record for kind in kinds for record in log.records.get(kind.plural, ())]
    return sorted(found, key=lambda record: record.event)
