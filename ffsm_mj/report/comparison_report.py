"""Differences between two runs, as text for a terminal."""

from __future__ import annotations

import json
import math
from typing import Any

from ffsm_mj.analysis.comparison import Comparison, ImpactDifference, RecordsDifference
from ffsm_mj.errors import one_line
from ffsm_mj.report.terminal import table


def comparison_report(labels: tuple[str, str], found: Comparison) -> str:
    """Text report of the differences between two runs."""
    head = f"{labels[1]} against {labels[0]}"
    if found.same:
        return f"{head}: identical at all {found.samples} common times"
    parts = [f"{head}: {found.samples} common times up to {found.end_s:g} s", _scenario_lines(found)]
    parts.append(_record_lines(found))
    if any(pair.a != pair.b for pair in found.impacts):
        names = ("contact", "pair", "time s", "", "change s", "impulse N s", "", "change N s")
        parts.append(table(names, (_impact_row(i, pair) for i, pair in enumerate(found.impacts))))
    parts.append(_motion_lines(found))
    return "\n\n".join(part for part in parts if part)


def _scenario_lines(found: Comparison) -> str:
    lines = [f"  {one_line(f'{key}: {_brief(a)} -> {_brief(b)}')}" for key, a, b in found.scenario]
    lines += [f"  model {one_line(name)} differs" for name in found.models]
    return "\n".join(["scenario:", *lines]) if lines else "scenario and models are identical"


def _brief(value: Any) -> str:
    text = "(not given)" if value is None else json.dumps(value) if isinstance(value, dict | list) else str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _record_lines(found: Comparison) -> str:
    """One line per kind of record: numbers of records, and the first difference."""
    return "\n".join(["records:", *(f"  {one_line(_compared(each))}" for each in found.records if each.a or each.b)])


def _compared(each: RecordsDifference) -> str:
    name = each.kind.plural.replace("_", " ")
    if each.first is None:
        return f"{name}: {each.a}, identical"
    a, b = (sentence or "none" for sentence in each.sentences)
    return f"{name}: {each.a} -> {each.b}, number {each.first + 1} differs: {a} -> {b}"


def _impact_row(i: int, pair: ImpactDifference) -> tuple[str, ...]:
    times = [f"{r.time_s:.6f}" if r else "none" for r in (pair.a, pair.b)]
    impulses = [f"{r.impulse_N_s:.6f}" if r else "none" for r in (pair.a, pair.b)]
    changes = [f"{x:+.2e}" if math.isfinite(x) else "-" for x in (pair.time_s, pair.impulse_N_s)]
    pairs = dict.fromkeys(r.pair for r in (pair.a, pair.b) if r)
    return str(i + 1), " -> ".join(pairs), *times, changes[0], *impulses, changes[1]


def _motion_lines(found: Comparison) -> str:
    """When the motions diverge, and the largest differences of coordinates, tip, energies and momenta."""
    shown = [d for d in found.signals if d.key.startswith(("state.", "energy.", "momentum.total_"))]
    lines = [] if found.first_s is None else [f"the motions differ from {found.first_s:.3f} s on"]
    if found.first_s is None:
        lines.append("the motions are identical")
    if shown:
        rows = ((d.key, f"{d.largest:.3e}", d.unit, f"{d.time_s:.3f}") for d in shown)
        lines.append(table(("largest difference of", "is", "unit", "at s"), rows))
    for which, keys in (("first", found.only_a), ("second", found.only_b)):
        if keys:
            lines.append(f"only in the {which}: {one_line(', '.join(keys))}")
    return "\n\n".join(lines)
