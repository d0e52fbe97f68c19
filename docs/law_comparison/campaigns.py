"""Writes the campaign files of the judged runs: each law with its default and its tuned parameters."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from cells import CAMPAIGNS, CELLS, Cell
from laws import Config
from rows import JUDGED_SEED
from table import Table

_VARIANTS = ("default", "tuned")


def campaign_files(table: Table) -> dict[Path, str]:
    """Texts of the campaign files by path."""
    return {CAMPAIGNS / f"control-laws-{name}.yaml": _campaign(cell, table) for name, cell in CELLS.items()}


def _campaign(cell: Cell, table: Table) -> str:
    lines = [
        "# yaml-language-server: $schema=../ffsm-campaign.schema.json",
        "# Written by docs/law_comparison from the table of docs/law-comparison.md.",
        f"campaign: control-laws-{cell.name}",
        f"description: Control laws, default and tuned; {cell.title.replace('`', '')}.",
        f"scenario: ../{cell.scenario}.yaml",
        *([f"overrides: {_flow(cell.overrides)}"] if cell.overrides else []),
        f"samples: {{kind: random, n: {cell.runs}, seed: {JUDGED_SEED}}}",
        "",
        "dispersions:",
        *(f"  {key}: {_flow(value)}" for key, value in cell.dispersions.items()),
        "",
        "variants:",
    ]
    for law in cell.laws:
        for variant, values in zip(_VARIANTS, (law.default, table.tuned(cell.tuned_in, law.name)), strict=True):
            controllers: Config = {"regulate": cell.controller(law, values)}
            lines += [f"  {law.name}_{variant}:", f"    controllers: {_flow(controllers)}"]
    lines += [
        "",
        "metrics: {file: control_law_metrics.py}",
        "objectives: {cost: minimize, error_integral: minimize, effort_integral: minimize}",
        "pareto: {error: error_integral, effort: effort_integral}",
        "limits: {timeout_s: 600}",
    ]
    return "\n".join(lines) + "\n"


def _flow(value: Any) -> str:
    """A value in YAML's flow style."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(key)}: {_flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_flow, value)) + "]"
    return '"off"' if value == "off" else (value if isinstance(value, str) and "/" not in value else json.dumps(value))


def _key(key: str) -> str:
    return json.dumps(key) if any(letter in key for letter in ".*/") else key
