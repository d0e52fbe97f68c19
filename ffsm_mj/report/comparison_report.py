"""Differences between two runs, as text for a terminal."""

from __future__ import annotations

import json
import math
from typing import Any

from ffsm_mj.analysis.comparison import Comparison, ImpactDifference, RecordsDifference
from ffsm_mj.errors import one_line
from ffsm_mj.report.terminal import table

_IMPACTS = (
    *("contact", "pair", "first\nat s", "second\nat s", "change\ns"),
    *("first\nN s", "second\nN s", "change\nN s"),
)
"""Columns of impacts: times and impulses in the first and the second run."""
_SPARE = ("change", "change", "contact")


def comparison_report(labels: tuple[str, str], comparison: Comparison) -> str:
    """Text report of the differences between two runs."""
    head = f"{labels[1]} against {labels[0]}"
    if comparison.same:
        return f"{head}: identical at all {comparison.samples} common times"
    parts = [f"{head}: {comparison.samples} common times up to {comparison.end_s:g} s", _scenario_lines(comparison)]
    parts.append(_record_lines(comparison))
    if any(pair.a != pair.b for pair in comparison.impacts):
        parts.append(table(_IMPACTS, (_impact_row(i, pair) for i, pair in enumerate(comparison.impacts)), spare=_SPARE))
    parts.append(_motion_lines(comparison))
    return "\n\n".join(part for part in parts if part)


def _scenario_lines(comparison: Comparison) -> str:
    lines = [f"  {one_line(f'{key}: {_brief(a)} -> {_brief(b)}')}" for key, a, b in comparison.scenario]
    lines += [f"  model {one_line(name)} differs" for name in comparison.models]
    lines += [f"  {sentence}" for sentence in comparison.origins]
    return "\n".join(["scenario:", *lines]) if lines else "scenario and models are identical"


def _brief(value: Any) -> str:
    text = "(not given)" if value is None else json.dumps(value) if isinstance(value, dict | list) else str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _record_lines(comparison: Comparison) -> str:
    """One line per kind of record: numbers of records, and the first difference."""
    return "\n".join(
        ["records:", *(f"  {one_line(_compared(record))}" for record in comparison.records if record.a or record.b)]
    )


def _compared(difference: RecordsDifference) -> str:
    name = difference.kind.plural.replace("_", " ")
    if difference.first is None:
        return f"{name}: {difference.a}, identical"
    a, b = (sentence or "none" for sentence in difference.sentences)
    return f"{name}: {difference.a} -> {difference.b}, number {difference.first + 1} differs: {a} -> {b}"


def _impact_row(i: int, pair: ImpactDifference) -> tuple[str, ...]:
    times = [f"{r.time_s:.6f}" if r else "-" for r in (pair.a, pair.b)]
    impulses = [f"{r.impulse_N_s:.6f}" if r else "-" for r in (pair.a, pair.b)]
    changes = [f"{x:+.2e}" if math.isfinite(x) else "-" for x in (pair.time_s, pair.impulse_N_s)]
    pairs = dict.fromkeys(r.pair for r in (pair.a, pair.b) if r)
    return str(i + 1), " -> ".join(pairs), *times, changes[0], *impulses, changes[1]


def _motion_lines(comparison: Comparison) -> str:
    """When the motions diverge, and the largest differences of coordinates, tip, energies and momenta."""
    shown = [d for d in comparison.signals if d.key.startswith(("state.", "energy.", "momentum.total_"))]
    lines = [] if comparison.first_s is None else [f"the motions differ from {comparison.first_s:.3f} s on"]
    if comparison.first_s is None:
        lines.append("the motions are identical")
    if shown:
        rows = ((d.key, f"{d.largest:.3e}", d.unit, f"{d.time_s:.3f}") for d in shown)
        lines.append(table(("largest difference of", "is", "unit", "at s"), rows))
    for which, keys in (("first", comparison.only_a), ("second", comparison.only_b)):
        if keys:
            lines.append(f"only in the {which}: {one_line(', '.join(keys))}")
    return "\n\n".join(lines)
