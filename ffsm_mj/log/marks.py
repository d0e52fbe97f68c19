"""Marks of event records as every viewer draws them: numbered by instant, with the time for which they are shown."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.arrows import drawn_vector
from ffsm_mj.records.kinds import Mark, RecordKind, kind_of

SHOWN_S = 2.0
"""Simulation time for which viewers show a mark."""


def marks_topic(kind: RecordKind) -> str:
    """Topic of ``run.mcap`` that holds the marks of a kind, below the topic of the scene."""
    return f"/scene/{kind.plural}"


class DrawnMark(NamedTuple):
    """A mark of an event record.

    Attributes:
        kind: Kind of the record.
        time_s: Time of the record.
        instant: Number of the earlier instants with marks of this kind.
        number: Number of the earlier marks of this kind at this instant.
        mark: Its point, text and name.
        vector: Drawn vector of its arrow in world axes, (3,), m, which ends at its point; zero if it has no arrow.
    """

    kind: RecordKind
    time_s: float
    instant: int
    number: int
    mark: Mark
    vector: FloatArray

    @property
    def end_s(self) -> float:
        """Time at which viewers remove it."""
        return self.time_s + SHOWN_S


class MarkSequence:
    """Numbers the marks of the records of a run, which come in order of time."""

    def __init__(self, scale: float) -> None:
        """Start before the first record.

        Args:
            scale: Scale of markers (:func:`ffsm_mj.log.marker_scale.marker_scale`).
        """
        self._scale = scale
        self._last: dict[str, list[DrawnMark]] = {}

    def add(self, record: Any) -> list[DrawnMark]:
        """Marks of the next record that can be drawn; a log of unknown origin may hold numbers that are not finite."""
        kind = kind_of(record)
        time, last = kind.time(record), self._last.get(kind.name, [])
        marks = [mark for mark in kind.marks(record) if _is_finite(mark)] if kind.marks is not None else []
        if not marks:
            return []
        # Contacts of one impact are separate records of the same time: they share an instant, as viewers list them together.
        together = last if last and last[0].time_s == time else []
        instant = together[0].instant if together else last[0].instant + 1 if last else 0
        vectors = [drawn_vector(mark.direction, mark.magnitude, self._scale) for mark in marks]
        added = [
            DrawnMark(kind, time, instant, len(together) + i, mark, vector)
            for i, (mark, vector) in enumerate(zip(marks, vectors, strict=True))
        ]
        self._last[kind.name] = together + added
        return added

    def of_instant(self, kind: RecordKind) -> list[DrawnMark]:
        """All marks so far of the last instant of a kind."""
        return self._last.get(kind.name, [])


def drawn_marks(records: Iterable[Any], scale: float) -> list[DrawnMark]:
    """Marks of records in order of time, at a scale of markers."""
    sequence = MarkSequence(scale)
    return [mark for record in records for mark in sequence.add(record)]


def _is_finite(mark: Mark) -> bool:
    return bool(np.isfinite((*mark.point_m, *mark.direction, mark.magnitude)).all())
