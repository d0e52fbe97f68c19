"""The rows of a campaign as one table: what was drawn, what came of it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import pyarrow as pa

from ffsm_mj.campaign.evaluation.results import TableRow
from ffsm_mj.campaign.plan.design import Design
from ffsm_mj.campaign.plan.success import Condition
from ffsm_mj.campaign.storage.store import RunRow


def table_rows(rows: Iterable[RunRow], design: Design, conditions: Sequence[Condition]) -> list[TableRow]:
    """A dictionary per run: number, outcome, whether it failed or was a success, drawn values, metrics, and what it cost.

    Names of parameters and metrics are columns as they are; one that is both, or a column of ours, gets its kind in front
    (``parameter:``, ``metric:``). ``model:`` stands before what was read back from the compiled model.
    """
    found = []
    for row in rows:
        drawn = dict(zip(design.parameters, design.rows[row.index], strict=True))
        told: TableRow = {
            "run": row.index,
            "outcome": row.outcome,
            "failed": row.failed,
            "success": succeeded(row, conditions),
            "message": row.message,
            "phase": row.phase,
        }
        for kind, values in (("parameter", drawn), ("metric", row.metrics)):
            told |= {name if name not in told else f"{kind}:{name}": _cell(value) for name, value in values.items()}
        told |= {f"model:{name}": value for name, value in row.model.items()}
        found.append(told | {"cpu": row.cpu, "wall_s": row.wall_s, "cpu_s": row.cpu_s})
    return found


def _cell(value: Any) -> Any:
    """A value as one cell: a list that was drawn as its text."""
    return json.dumps(value) if isinstance(value, list | tuple) else value


def succeeded(row: RunRow, conditions: Sequence[Condition]) -> bool | None:
    """Whether a run did what the campaign asks for; None where it asks for nothing."""
    if not conditions:
        return None
    return not row.failed and all(each.holds(row.metrics) for each in conditions)


def as_arrow(rows: Sequence[TableRow]) -> Any:
    """A ``pyarrow.Table``; a column is there if any row has it, null where a row has not."""
    names = dict.fromkeys(name for row in rows for name in row)
    return pa.table({name: pa.array(_of_one_type([row.get(name) for row in rows])) for name in names})


def _of_one_type(values: list[Any]) -> list[Any]:
    """A column whose values are of several types as numbers, or where there are texts among them as texts."""
    types = {type(value) for value in values if value is not None}
    if len(types) <= 1:
        return values
    one: Callable[[Any], Any] = float if types <= {bool, int, float} else _as_text
    return [None if value is None else one(value) for value in values]


def _as_text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
