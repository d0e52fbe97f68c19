"""What a campaign came to, as its report and its stopping rule look at it."""

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
        name: Of the campaign.
        kind: Kind of samples.
        n: Size of the sample; of ``saltelli`` the design has n (d + 2) rows.
        runs: Rows of the design.
        parameters: Columns of what was drawn.
        metrics: Columns of what was asked for.
        rows: Those that are there, by run, each with at least ``run``, ``outcome``, ``failed``, ``success`` (None where
            nothing is asked for), ``message`` and ``phase``.
    """

    name: str
    kind: str
    n: int
    runs: int
    parameters: tuple[str, ...]
    metrics: tuple[str, ...]
    rows: Sequence[TableRow]

    @property
    def judges(self) -> bool:
        """Whether the campaign says what a success is."""
        return any(row["success"] is not None for row in self.rows)

    @property
    def complete(self) -> bool:
        """Whether every run has a row."""
        return len(self.rows) == self.runs

    @cached_property
    def sample(self) -> tuple[TableRow, ...]:
        """Rows that are draws of the distribution: all, of a Saltelli design the first 2 n, which mix no others."""
        return tuple(row for row in self.rows if self.kind != "saltelli" or row["run"] < 2 * self.n)

    @cached_property
    def beginning(self) -> tuple[TableRow, ...]:
        """The rows of the sample before the first run that has none."""
        for position, row in enumerate(self.sample):
            if row["run"] != position:
                return self.sample[:position]
        return self.sample


def column_of(name: str, kind: str, rows: Sequence[TableRow]) -> str:
    """Column of a parameter or metric, whose name another may have taken."""
    own = f"{kind}:{name}"
    return own if any(own in row for row in rows) else name


def is_good(row: TableRow) -> bool:
    """Whether a run is what was hoped for: a success, or where nothing says what that is, no failure."""
    return not row["failed"] and (row["success"] is None or bool(row["success"]))


def numbers(rows: Sequence[TableRow], column: str) -> FloatArray:
    """A column as numbers, (rows,): flags as 0 and 1, NaN for what is no number or not there."""
    values = (row.get(column) for row in rows)
    return np.array([float(value) if isinstance(value, int | float) else np.nan for value in values])


def measured(rows: Sequence[TableRow], metric: str) -> FloatArray:
    """A metric of the runs that did not fail and have it."""
    found = numbers([row for row in rows if not row["failed"]], metric)
    return found[np.isfinite(found)]
