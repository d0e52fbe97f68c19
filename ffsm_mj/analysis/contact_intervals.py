"""Contacts that last, each from its beginning to its end: worked out from what rows and records say of them."""

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
    "pair": ("", "name of the pair of geoms"),
    "geoms_{ab}": ("", "geom of the pair; the force on b points away from a"),
    "start_s": ("s", "when it begins to last"),
    "end_s": ("s", "when it opens; NaN where it lasts to the end of the log"),
    "impulse_N_s": ("N s", "integral of the resultant force over that time"),
    "peak_force_N": ("N", "greatest resultant force of the samples and events in that time"),
    "peak_force_s": ("s", "when that is"),
}


@dataclass(frozen=True)
class ContactInterval:
    """A pair that stayed closed for a time.

    Attributes:
        pair: Name of the pair of geoms.
        geoms: The two, a and b.
        start_s: When it began to last: the impact that was its entry.
        end_s: When it opened; None where it lasts to the end of the log.
        impulse_N_s: Integral of the resultant force over that time.
        peak_force_N: Greatest resultant force of the samples and events in that time.
        peak_force_s: When that was.
    """

    pair: str
    geoms: tuple[str, ...]
    start_s: float
    end_s: float | None
    impulse_N_s: float
    peak_force_N: float
    peak_force_s: float


class _OpenContact:
    """A contact while it is told of."""

    def __init__(self, begins: ContactRecord, columns: Sequence[int]) -> None:
        self.pair, self.geoms, self.start_s, self.end_s = begins.pair, begins.geoms, begins.time_s, math.inf
        self._columns = columns
        self._before = self._until = begins.impulse_N_s
        self._peak, self._peak_s = begins.force_after_N, begins.time_s

    def record(self, record: ContactRecord) -> None:
        """Something happened to it."""
        self._until = record.impulse_N_s
        self._higher(max(record.force_before_N, record.force_after_N), record.time_s)
        if isinstance(record, ContactEnds):
            self.end_s = record.time_s

    def rows(self, times: FloatArray, block: FloatArray) -> None:
        """Take those of some rows that fall into it."""
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

    def told(self) -> ContactInterval:
        """What it came to."""
        end_s = None if self.end_s == math.inf else self.end_s
        impulse = self._until - self._before
        return ContactInterval(self.pair, self.geoms, self.start_s, end_s, impulse, self._peak, self._peak_s)


class ContactIntervals:
    """Contacts of one run, told in blocks of rows and records.

    A record must be told before the first block that reaches beyond it; those of a log may all be told first.
    """

    def __init__(self, layout: Layout) -> None:
        """Nothing was told yet."""
        self._layout = layout
        self._spells: list[_OpenContact] = []
        self._lasting: dict[str, _OpenContact] = {}
        self._awaited: list[_OpenContact] = []

    def event(self, event: Event) -> None:
        """Take the next record; one that tells of no contact says nothing here."""
        if not isinstance(event, ContactRecord):
            return
        if isinstance(event, ContactBegins) and event.pair not in self._lasting:
            keys = (f"contact.{identifier(event.pair)}_{name}" for name in ("force_N", "impulse_N_s"))
            spell = _OpenContact(event, [self._layout.index[key] for key in keys if key in self._layout.index])
            self._lasting[event.pair] = spell
            self._spells.append(spell)
            self._awaited.append(spell)
        elif event.pair in self._lasting:  # else its beginning is lost, with a part of the log
            self._lasting[event.pair].record(event)
            if isinstance(event, ContactEnds):
                del self._lasting[event.pair]

    def rows(self, block: FloatArray) -> None:
        """Take the next rows."""
        if not self._awaited:
            return
        times = block[:, self._layout.time]
        for spell in self._awaited:
            spell.rows(times, block)
        self._awaited = [spell for spell in self._awaited if not spell.end_s < times[-1]]

    def told(self) -> tuple[ContactInterval, ...]:
        """All of them so far in the order in which they began, but for those that ended at that same instant."""
        return tuple(spell.told() for spell in self._spells if spell.end_s > spell.start_s)


def contact_records(log: RunLog) -> list[Any]:
    """What a log tells of contacts that last, in order."""
    kinds = (CONTACT_BEGINS, CONTACT_CHANGES, CONTACT_ENDS)
    found = [record for kind in kinds for record in log.records.get(kind.plural, ())]
    return sorted(found, key=lambda record: record.event)
