"""What is drawn of records, numbered as viewers want it: by instant, and mark by mark within one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ffsm_mj.records.kinds import Mark, RecordKind, kind_of

SHOWN_S = 2.0
"""How long viewers show a mark."""


def marks_topic(kind: RecordKind) -> str:
    """Topic of ``run.mcap``, below that of the scene, on which viewers find the marks of a kind."""
    return f"/scene/{kind.plural}"


@dataclass
class MarkGroup:
    """All marks of one kind at one time.

    Attributes:
        kind: Whose.
        time_s: When.
        number: How many instants of that kind were before.
        marks: So far, in order.
    """

    kind: RecordKind
    time_s: float
    number: int
    marks: list[Mark]


class MarkGroups:
    """Follows the records of a run."""

    def __init__(self) -> None:
        """None yet."""
        self._last: dict[str, MarkGroup] = {}

    def add(self, record: Any) -> tuple[MarkGroup, int] | None:
        """The instant that a record belongs to, with its marks, and how many were there before; None without any."""
        kind = kind_of(record)
        new = kind.marks(record) if kind.marks is not None else ()
        if not new:
            return None
        last, time = self._last.get(kind.name), kind.time(record)
        if last is None or last.time_s != time:
            last = self._last[kind.name] = MarkGroup(kind, time, last.number + 1 if last is not None else 0, [])
        before = len(last.marks)
        last.marks.extend(new)
        return last, before
