"""Records in words: those of a run, and of two runs side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from ffsm_mj.analysis.comparison import Comparison, RecordsDifference
from ffsm_mj.analysis.run import Run
from ffsm_mj.records.kinds import RecordKind

_MOST_LINES = 20


def record_lines(run: Run) -> list[str]:
    """What a run tells once of its contact regimes, kind by kind; impacts, phases and overlaps have words of their own."""
    return ["\n".join(_lines(kind, run.records.get(kind.plural, ()))) for kind in run.log.kinds if not kind.in_every_run]


def _lines(kind: RecordKind, records: Sequence[Any]) -> Iterator[str]:
    yield f"{kind.plural.replace('_', ' ')}: {len(records) or 'none'}"
    for record in records[:_MOST_LINES]:
        yield f"  {kind.time(record):.6f} s  {kind.sentence(record)}"
    if len(records) > _MOST_LINES:
        yield f"  and {len(records) - _MOST_LINES} more: ffsm export --csv --table {kind.plural}"


def record_comparison(found: Comparison) -> str:
    """One line for each kind of record that either run has: how many, and the first that differ."""
    return "\n".join(["records:", *(f"  {_compared(each)}" for each in found.records if each.a or each.b)])


def _compared(each: RecordsDifference) -> str:
    name = each.kind.plural.replace("_", " ")
    if each.first is None:
        return f"{name}: {each.a}, the same in both"
    a, b = (sentence or "none" for sentence in each.sentences)
    return f"{name}: {each.a} -> {each.b}, number {each.first + 1} differs: {a} -> {b}"
