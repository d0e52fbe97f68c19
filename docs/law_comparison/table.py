"""The stored table of the comparison: a row per run."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ffsm_mj.arrays import FloatArray

TABLE = Path(__file__).parent / "rows.csv"
KEYS = ("cell", "law", "variant", "first", "second", "run", "seed", "outcome", "passes")
METRICS = (
    "cost",
    "error_integral",
    "effort_integral",
    "peak_torque",
    "least_error",
    "final_error",
    "held",
    "first_held",
    "base_turn",
    "impulse",
    "reach_end_s",
    "overlaps",
)


@dataclass(frozen=True)
class TableRow:
    """A run.

    Attributes:
        cell: Name of the cell.
        law: Name of the law.
        variant: ``default``, ``tuned``, or the number of a point.
        values: Values of the two tuned parameters.
        run: Index in the design.
        seed: Seed of the design.
        outcome: Outcome of the run.
        passes: Whether it passes its checks.
        metrics: Metrics by name, NaN for none.
    """

    cell: str
    law: str
    variant: str
    values: tuple[float, float]
    run: int
    seed: int
    outcome: str
    passes: bool
    metrics: dict[str, float]

    @property
    def is_good(self) -> bool:
        """Whether it completed, passes its checks, and nothing overlaps in the phase."""
        return self.outcome == "completed" and self.passes and self.metrics["overlaps"] == 0.0

    def cells(self) -> list[str]:
        """Texts of the row."""
        values = (f"{value:.10g}" for value in self.values)
        metrics = ("" if math.isnan(value) else f"{value:.7g}" for value in self.metrics.values())
        keys = (self.cell, self.law, self.variant, *values, str(self.run), str(self.seed), self.outcome)
        return [*keys, str(int(self.passes)), *metrics]


class Table:
    """All rows, with selections."""

    def __init__(self, rows: Sequence[TableRow]) -> None:
        """Keep the rows."""
        self.rows = tuple(rows)

    @classmethod
    def read(cls, path: Path = TABLE) -> Table:
        """Read the stored table."""
        with path.open(newline="") as file:
            return cls([_row(line) for line in csv.DictReader(file)])

    def write(self, path: Path = TABLE) -> None:
        """Store the table."""
        with path.open("w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow([*KEYS, *METRICS])
            writer.writerows(row.cells() for row in self.rows)

    @cached_property
    def cells(self) -> tuple[str, ...]:
        """Names of the cells that have judged runs."""
        return tuple(dict.fromkeys(row.cell for row in self.rows if row.variant == "default"))

    def of(self, cell: str, law: str, variant: str) -> dict[int, TableRow]:
        """Judged runs of a variant by index."""
        return {row.run: row for row in self.rows if (row.cell, row.law, row.variant) == (cell, law, variant)}

    def common(self, cell: str) -> list[int]:
        """Indices of the runs that all laws have with default and tuned parameters."""
        judged = [row for row in self.rows if row.cell == cell and not row.variant.isdecimal()]
        sets = [
            {row.run for row in judged if (row.law, row.variant) == pair}
            for pair in {(row.law, row.variant) for row in judged}
        ]
        return sorted(set.intersection(*sets)) if sets else []

    def values(self, cell: str, law: str, variant: str, metric: str) -> FloatArray:
        """A metric of the common runs of a variant, NaN for a run that is not good."""
        runs = self.of(cell, law, variant)
        found = [runs[i].metrics[metric] if i in runs and runs[i].is_good else math.nan for i in self.common(cell)]
        return np.array(found)

    def points(self, cell: str, law: str) -> list[tuple[tuple[float, float], list[TableRow]]]:
        """Values of the tuned parameters and runs of each point that all laws have tried."""
        counted = {
            name: {row.variant for row in self.rows if row.cell == cell and row.law == name and row.variant.isdecimal()}
            for name in {row.law for row in self.rows if row.cell == cell and row.variant.isdecimal()}
        }
        shared = sorted(set.intersection(*counted.values()), key=int) if counted else []
        tried = [[row for row in self._tuning(cell, law) if row.variant == number] for number in shared]
        return [(rows[0].values, rows) for rows in tried]

    def _tuning(self, cell: str, law: str) -> Iterator[TableRow]:
        return (row for row in self.rows if row.cell == cell and row.law == law and row.variant.isdecimal())

    def tuned(self, cell: str, law: str) -> tuple[float, float]:
        """Values of the tuned parameters with the least mean cost; a run that is not good costs without bound."""
        return min(self.points(cell, law), key=lambda point: mean_of(point[1], "cost"))[0]


def mean_of(rows: Sequence[TableRow], metric: str) -> float:
    """Mean of a metric; infinite if a run is not good."""
    return float(np.mean([row.metrics[metric] if row.is_good else math.inf for row in rows]))


def _row(line: dict[str, str]) -> TableRow:
    metrics = {name: float(line[name]) if line[name] else math.nan for name in METRICS}
    return TableRow(
        line["cell"],
        line["law"],
        line["variant"],
        (float(line["first"]), float(line["second"])),
        int(line["run"]),
        int(line["seed"]),
        line["outcome"],
        line["passes"] == "1",
        metrics,
    )
