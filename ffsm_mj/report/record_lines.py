"""Records of contact models, as text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from ffsm_mj.analysis.run import Run
from ffsm_mj.errors import one_line
from ffsm_mj.records.kinds import RecordKind

_MOST_LINES = 20


def record_lines(run: Run) -> list[str]:
    """Lines for the records of contact models, by kind; impacts, phases and unhandled contacts have their own tables."""
    return ["\n".join(_lines(kind, run.records.get(kind.plural, ()))) for kind in run.log.kinds if not kind.in_every_run]


def _lines(kind: RecordKind, records: Sequence[Any]) -> Iterator[str]:
    yield f"{kind.plural.replace('_', ' ')}: {len(records) or 'none'}"
    for record in records[:_MOST_LINES]:
        yield f"  {kind.time(record):.6f} s  {one_line(kind.sentence(record))}"
    if len(records) > _MOST_LINES:
        yield f"  and {len(records) - _MOST_LINES} more: ffsm export --csv --table {kind.plural}"
