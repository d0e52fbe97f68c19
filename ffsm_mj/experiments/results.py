"""Results of a campaign: rows with their columns, and the table for other tools."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.conditions import Condition
from ffsm_mj.experiments.design import Design
from ffsm_mj.experiments.file import CampaignFile, KeepConfig
from ffsm_mj.experiments.metrics import FAULT
from ffsm_mj.experiments.store import RETRIED, RunRow

if TYPE_CHECKING:
    from pandas import DataFrame

TableRow = dict[str, Any]
SUCCESS, GOOD = "success", "run:good"
"""Columns of success, and of whether a run is good; no parameter or metric has the latter's name."""


@dataclass(frozen=True)
class Results:
    """Rows of a campaign.

    Attributes:
        kind: Kind of samples.
        n: Number of samples; a ``saltelli`` design has n (d + 2) rows.
        runs: Number of rows of the design.
        parameters: Columns of the sampled parameters.
        metrics: Columns of the metrics of the campaign file.
        frame: Existing rows by run, with at least the columns ``run``, ``outcome``, ``failed``, ``success`` (None without a
            condition), ``message``, ``phase`` and :data:`GOOD`; see :func:`frame_of`.
    """

    kind: str
    n: int
    runs: int
    parameters: tuple[str, ...]
    metrics: tuple[str, ...]
    frame: DataFrame

    @property
    def has_success(self) -> bool:
        """Whether the campaign has a success condition."""
        return bool(self.frame["success"].notna().any())

    @property
    def complete(self) -> bool:
        """Whether every run has a row."""
        return len(self.frame) == self.runs

    @cached_property
    def sample(self) -> DataFrame:
        """Rows that sample the distribution: all, or the first 2 n of a Saltelli design, whose other rows mix these."""
        return self.frame[self.frame.index < (2 * self.n if self.kind == "saltelli" else self.runs)]

    @property
    def complete_part(self) -> DataFrame:
        """Rows of the sample before the first missing run."""
        return self.sample[self.sample.index == range(len(self.sample))]

    @property
    def valid(self) -> DataFrame:
        """Rows of the sample that completed and pass their checks."""
        return passed(self.sample)


_HEAD = ("run", "outcome", "failed", "success", "message", "phase")


def frame_of(rows: Sequence[TableRow]) -> DataFrame:
    """Rows of a campaign as a frame by run, with the column :data:`GOOD`.

    A run is good if it is a success, or, without a condition, if it has not failed.
    """
    import pandas as pd  # slow to import

    frame = pd.DataFrame(list(rows), columns=None if rows else _HEAD, index=[row["run"] for row in rows])
    return frame.assign(**{GOOD: ~frame["failed"].astype(bool) & frame["success"].ne(False)})


def results_of(rows: Sequence[RunRow], design: Design, config: CampaignFile) -> Results:
    """Results of the rows of a campaign."""
    frame = frame_of(table_rows(rows, design, config.conditions))
    parameters = tuple(column_of(name, "parameter", frame.columns) for name in design.parameters)
    metrics = tuple(column_of(name, "metric", frame.columns) for name in config.all_metrics)
    return Results(design.kind, design.n, len(design.rows), parameters, metrics, frame)


def column_of(name: str, kind: str, columns: Container[str]) -> str:
    """Column of a parameter or metric; it has a prefix if another column has its name."""
    return qualified if (qualified := f"{kind}:{name}") in columns else name


def passed(rows: DataFrame) -> DataFrame:
    """Rows of runs that did not fail."""
    return rows[~rows["failed"].astype(bool)]


def numbers(rows: DataFrame, column: str) -> FloatArray:
    """A column as numbers, (rows,): flags as 0 and 1, NaN for texts and missing values."""
    values = rows[column].tolist() if column in rows else [None] * len(rows)
    return np.array([float(value) if isinstance(value, int | float) else np.nan for value in values])


def finite(rows: DataFrame, column: str) -> FloatArray:
    """Finite numbers of a column."""
    values = numbers(rows, column)
    return values[np.isfinite(values)]


@dataclass(frozen=True)
class VariantResults:
    """Rows of all variants so far; those of a campaign without have the empty name.

    Attributes:
        config: The campaign file.
        variants: Results by variant, in the order of the campaign file.
        not_applicable: Why the other variants have none.
    """

    config: CampaignFile
    variants: Mapping[str, Results]
    not_applicable: Mapping[str, str] = field(default_factory=dict)

    @property
    def metrics(self) -> tuple[str, ...]:
        """Columns of the metrics that all variants have."""
        first, *others = self.variants.values()
        return tuple(name for name in first.metrics if all(name in other.metrics for other in others))

    @property
    def compared(self) -> tuple[str, ...]:
        """Metrics that are compared: ``success`` first, if there is a condition for it."""
        return ((SUCCESS,) if self.config.conditions else ()) + self.metrics

    def met(self, variant: str) -> BoolArray:
        """Whether each run of a variant completed and meets the success condition, with its checks passed or not."""
        results = self.variants[variant]
        met = (results.frame["outcome"] == "completed").to_numpy(np.bool_, copy=True)
        for condition in self.config.conditions:
            values = numbers(results.frame, column_of(condition.metric, "metric", results.frame.columns))
            met &= [math.isfinite(value) and condition.holds({condition.metric: value}) for value in values.tolist()]
        return np.asarray(met)

    def values(self, variant: str, metric: str) -> FloatArray:
        """Values of a metric over the runs of a variant that completed and pass their checks; NaN where a run has none."""
        return numbers(passed(self.variants[variant].frame), metric)

    def metric_faults(self) -> Iterator[tuple[str, str, tuple[int, ...], str]]:
        """Metrics of the caller that raised an exception, or gave no valid number.

        Yields:
            The metric, the variant, its runs without a value, and what was wrong in the first of them.
        """
        for variant, results in self.variants.items():
            for name in results.frame.columns:
                if name.startswith(FAULT) and len(faulty := results.frame[name].dropna()):
                    yield name.removeprefix(FAULT), variant, tuple(faulty.index.tolist()), str(faulty.iloc[0])


def table_rows(rows: Iterable[RunRow], design: Design, conditions: Sequence[Condition]) -> list[TableRow]:
    """A dictionary per run: index, outcome, ``failed``, ``success``, sampled parameters, metrics, and cost.

    Columns have the names of parameters and metrics; the prefix ``parameter:`` or ``metric:`` distinguishes equal names.
    Values read back from the compiled model have the prefix ``model:``.
    """
    table = []
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
        table.append(cells | {"cpu": row.cpu, "wall_s": row.wall_s, "cpu_s": row.cpu_s})
    return table


def _cell(value: Any) -> Any:
    """Value of a cell; a list becomes its JSON text."""
    return json.dumps(value) if isinstance(value, list | tuple) else value


def is_success(row: RunRow, conditions: Sequence[Condition]) -> bool | None:
    """Whether a run meets the success conditions of the campaign; None if there are none."""
    if not conditions:
        return None
    return not row.failed and all(condition.holds(row.metrics) for condition in conditions)


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


def logs_to_keep(rows: Sequence[RunRow], keep: KeepConfig) -> list[int]:
    """Indices of the runs whose logs the campaign file asks for; runs without a result have no log.

    Args:
        rows: All rows, in the order of their indices.
        keep: Entry ``keep`` of the campaign file.
    """
    ended = [row for row in rows if row.outcome not in RETRIED]
    wanted = [row.index for row in ended if row.failed][: keep.failures]
    for metric, count in keep.worst.items():
        known = [row for row in ended if isinstance(row.metrics.get(metric), int | float)]
        wanted += [row.index for row in sorted(known, key=lambda row: -row.metrics[metric])[:count]]
    return list(dict.fromkeys(wanted))
