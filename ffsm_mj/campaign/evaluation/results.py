"""Results of a campaign, for its report and its stopping rule."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray

TableRow = dict[str, Any]


@dataclass(frozen=True)
class Results:
    """Rows of a campaign.

    Attributes:
        name: Name of the campaign.
        kind: Kind of samples.
        n: Number of samples; a ``saltelli`` design has n (d + 2) rows.
        runs: Number of rows of the design.
        parameters: Columns of the sampled parameters.
        metrics: Columns of the metrics of the campaign file.
        rows: Existing rows in the order of the runs, each with at least ``run``, ``outcome``, ``failed``, ``success`` (None
            without a condition), ``message`` and ``phase``.
    """

    name: str
    kind: str
    n: int
    runs: int
    parameters: tuple[str, ...]
    metrics: tuple[str, ...]
    rows: Sequence[TableRow]

    @property
    def has_success(self) -> bool:
        """Whether the campaign has a success condition."""
        return any(row["success"] is not None for row in self.rows)

    @property
    def complete(self) -> bool:
        """Whether every run has a row."""
        return len(self.rows) == self.runs

    @cached_property
    def sample(self) -> tuple[TableRow, ...]:
        """Rows that sample the distribution: all, or the first 2 n of a Saltelli design, whose other rows mix these."""
        return tuple(row for row in self.rows if self.kind != "saltelli" or row["run"] < 2 * self.n)

    @cached_property
    def complete_part(self) -> tuple[TableRow, ...]:
        """Rows of the sample before the first missing run."""
        for position, row in enumerate(self.sample):
            if row["run"] != position:
                return self.sample[:position]
        return self.sample


def column_of(name: str, kind: str, rows: Sequence[TableRow]) -> str:
    """Column of a parameter or metric; it has a prefix if another column has its name."""
    own = f"{kind}:{name}"
    return own if any(own in row for row in rows) else name


def is_good(row: TableRow) -> bool:
    """Whether a run is a success, or, without a success condition, has not failed."""
    return not row["failed"] and (row["success"] is None or bool(row["success"]))


def numbers(rows: Sequence[TableRow], column: str) -> FloatArray:
    """A column as numbers, (rows,): flags as 0 and 1, NaN for texts and missing values."""
    values = (row.get(column) for row in rows)
    return np.array([float(value) if isinstance(value, int | float) else np.nan for value in values])


def metric_numbers(rows: Sequence[TableRow], metric: str) -> FloatArray:
    """Finite values of a metric over the runs that did not fail."""
    found = numbers([row for row in rows if not row["failed"]], metric)
    return found[np.isfinite(found)]
