"""Rows of a campaign as one table: sampled parameters and results of each run."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import pyarrow as pa

from ffsm_mj.campaign.evaluation.results import TableRow
from ffsm_mj.campaign.plan.design import Design
from ffsm_mj.campaign.storage.store import RunRow
from ffsm_mj.conditions import Condition


def table_rows(rows: Iterable[RunRow], design: Design, conditions: Sequence[Condition]) -> list[TableRow]:
    """A dictionary per run: index, outcome, ``failed``, ``success``, sampled parameters, metrics, and cost.

    Columns have the names of parameters and metrics; the prefix ``parameter:`` or ``metric:`` distinguishes equal names.
    Values read back from the compiled model have the prefix ``model:``.
    """
    found = []
    for row in rows:
        sampled = dict(zip(design.parameters, design.rows[row.index], strict=True))
        cells: TableRow = {
            "run": row.index,
            "outcome": row.outcome,
            "failed": row.failed,
            "success": is_success(row, conditions),
            "message": row.message,
            "phase": row.phase,
        }
        for kind, values in (("parameter", sampled), ("metric", row.metrics)):
            cells |= {name if name not in cells else f"{kind}:{name}": _cell(value) for name, value in values.items()}
        cells |= {f"model:{name}": value for name, value in row.model.items()}
        found.append(cells | {"cpu": row.cpu, "wall_s": row.wall_s, "cpu_s": row.cpu_s})
    return found


def _cell(value: Any) -> Any:
    """Value of a cell; a list becomes its JSON text."""
    return json.dumps(value) if isinstance(value, list | tuple) else value


def is_success(row: RunRow, conditions: Sequence[Condition]) -> bool | None:
    """Whether a run meets the success conditions of the campaign; None if there are none."""
    if not conditions:
        return None
    return not row.failed and all(each.holds(row.metrics) for each in conditions)


def as_arrow(rows: Sequence[TableRow]) -> Any:
    """A ``pyarrow.Table`` with every column that a row has; null in rows without it."""
    names = dict.fromkeys(name for row in rows for name in row)
    return pa.table({name: pa.array(_of_one_type([row.get(name) for row in rows])) for name in names})


def _of_one_type(values: list[Any]) -> list[Any]:
    """Values of a column converted to one type: mixed numbers and flags to floats, all other mixtures to texts."""
    types = {type(value) for value in values if value is not None}
    if len(types) <= 1:
        return values
    one: Callable[[Any], Any] = float if types <= {bool, int, float} else _as_text
    return [None if value is None else one(value) for value in values]


def _as_text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
