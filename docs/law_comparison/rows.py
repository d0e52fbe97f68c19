"""Runs that the table needs, and their execution: an interrupted computation goes on where it was."""

from __future__ import annotations

import importlib.util
import inspect
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from cells import CAMPAIGNS, CELLS, Cell
from floor import reach_end_s
from laws import Config, Law
from scipy.stats import qmc
from table import METRICS, Table, TableRow

from ffsm_mj.analysis.run import Run
from ffsm_mj.analysis.run_models import all_checks

TUNING_SEED, JUDGED_SEED, POINTS_SEED = 1, 2, 3
"""Seeds of the runs that tune, of those that are judged, and of the points of the unit square."""


@dataclass(frozen=True)
class Wanted:
    """A run that the table needs.

    Attributes:
        cell: Cell.
        law: Control law.
        variant: ``default``, ``tuned``, or the number of a point.
        values: Values of the two tuned parameters.
        run: Index in the design.
        seed: Seed of the design.
    """

    cell: Cell
    law: Law
    variant: str
    values: tuple[float, float]
    run: int
    seed: int

    @property
    def key(self) -> str:
        """What tells it from other runs."""
        return json.dumps([self.cell.name, self.law.name, *self.values, self.run, self.seed])


def points(n: int) -> list[tuple[float, float]]:
    """Scrambled Sobol points of the unit square, the same for every law; more points extend fewer."""
    found = qmc.Sobol(2, seed=POINTS_SEED).random(n).tolist()
    return [(first, second) for first, second in found]


def tuning_runs(cell: Cell, n: int, runs: int) -> Iterator[Wanted]:
    """Runs at all points: point by point, so that fewer points are complete first."""
    for number, point in enumerate(points(n)):
        for run in range(runs):
            for law in cell.laws:
                yield Wanted(cell, law, str(number), law.at(point), run, TUNING_SEED)


def judged_runs(cell: Cell, tuned: dict[str, tuple[float, float]], runs: int) -> Iterator[Wanted]:
    """Runs with default and tuned parameters: run by run, so that fewer runs are complete pairs first."""
    for run in range(runs):
        for law in cell.laws:
            yield Wanted(cell, law, "default", law.default, run, JUDGED_SEED)
            yield Wanted(cell, law, "tuned", tuned[law.name], run, JUDGED_SEED)


class RowFile:
    """Results of runs in a file of JSON lines, by the key of the run."""

    def __init__(self, path: Path) -> None:
        """Read what is there; an incomplete last line is left out."""
        self._path = path
        self._found: dict[str, Config] = {}
        for line in path.read_text().splitlines() if path.is_file() else ():
            try:
                key, found = json.loads(line)
            except ValueError:
                continue
            self._found[key] = found

    def complete(self, every: Sequence[Wanted]) -> None:
        """Execute the runs that have no result."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        missing = [each for each in every if each.key not in self._found]
        for i, each in enumerate(missing):
            found = simulated(each)
            with self._path.open("a") as file:
                file.write(json.dumps([each.key, found]) + "\n")
            self._found[each.key] = found
            print(f"{each.cell.name} {i + 1} of {len(missing)}: {each.law.name} {each.variant}", flush=True)

    def table(self, every: Sequence[Wanted]) -> Table:
        """Rows of the runs that have a result."""
        return Table([_table_row(each, self._found[each.key]) for each in every if each.key in self._found])


def simulated(wanted: Wanted) -> Config:
    """Outcome and metrics of a run."""
    cell = wanted.cell
    dispersed = _overrides(cell.name, wanted.run, wanted.seed) if cell.dispersions else {}
    run = cell.run(cell.controller(wanted.law, wanted.values), dispersed, wanted.run)
    ends = {"reach_end_s": reach_end_s(run)} if cell.has_floor and run.impacts else {}
    return {"outcome": run.outcome, "passes": all(check.passes for check in all_checks(run))} | metrics_of(run) | ends


@cache
def _overrides(cell: str, run: int, seed: int) -> Config:
    """Dispersed keys of a run; samples of kind random are the same for any number of runs."""
    return CELLS[cell].design(run + 1, seed).overrides(run)


@cache
def _metrics() -> ModuleType:
    spec = importlib.util.spec_from_file_location("control_law_metrics", CAMPAIGNS / "control_law_metrics.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def metrics_of(run: Run) -> dict[str, Any]:
    """Metrics of the campaigns, by name; None for all of them if the phase never began."""
    functions = inspect.getmembers(_metrics(), inspect.isfunction)
    begun = any(phase.name == "regulate" for phase in run.phases)
    return {name: function(run) if begun else None for name, function in functions if name[0] != "_"}


def _table_row(wanted: Wanted, found: Config) -> TableRow:
    values = ((name, found.get(name)) for name in METRICS)
    metrics = {name: math.nan if value is None or math.isinf(value) else float(value) for name, value in values}
    return TableRow(
        wanted.cell.name,
        wanted.law.name,
        wanted.variant,
        wanted.values,
        wanted.run,
        wanted.seed,
        found["outcome"],
        found["passes"],
        metrics,
    )
