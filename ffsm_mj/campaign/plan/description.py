"""Description of a campaign as text, for ``ffsm check``."""

from __future__ import annotations

from collections.abc import Iterator

from ffsm_mj.assembly.prepare import as_overrides
from ffsm_mj.campaign.plan.design import Design
from ffsm_mj.campaign.plan.loading import Plan
from ffsm_mj.campaign.plan.row_check import extreme_rows
from ffsm_mj.errors import InputError


def description(plan: Plan, design: Design) -> list[str]:
    """Lines that describe the runs of a campaign, then its base scenario."""
    config = plan.config
    size = f"{design.n} x ({len(design.parameters)} + 2) runs" if design.kind == "saltelli" else f"{len(design.rows)} runs"
    chance = "every combination" if design.kind == "grid" else f"{design.kind}, seed {design.seed}"
    lines = [f"{config.campaign}: valid", f"  {size} of {plan.base.scenario.name} ({chance})"]
    for column, name in enumerate(design.parameters):
        keys = [binding.key for binding in plan.bindings if any(column in effect.columns for effect in binding.effects)]
        values = [row[column] for row in design.rows]
        lines.append(f"  {name}: {_range(values)}, sets {', '.join(keys)}")
    lines.append(f"  metrics: {', '.join(config.kept_metrics) or 'only those of every run'}")
    if config.success is not None:
        lines.append(f"  success: {config.success}")
    lines += [f"  base {line}" if line.startswith(plan.base.scenario.name) else line for line in plan.base.describe()]
    return [*lines, *(f"note: {note}" for note in _runs_that_cannot_start(plan, design))]


def _runs_that_cannot_start(plan: Plan, design: Design) -> Iterator[str]:
    """Notes on runs with the smallest and largest values that will fail at the start."""
    for run in extreme_rows(design):
        source = plan.base.source.overridden(as_overrides(design.overrides(run)))
        try:
            plan.base.changed(source).assemble()
        except InputError as error:
            yield f"run {run} cannot start: {error.lines[0]}"


def _range(values: list[object]) -> str:
    numbers = [value for value in values if isinstance(value, int | float) and not isinstance(value, bool)]
    if len(numbers) == len(values):
        return f"{min(numbers):.6g} to {max(numbers):.6g}"
    return ", ".join(dict.fromkeys(map(str, values)))
