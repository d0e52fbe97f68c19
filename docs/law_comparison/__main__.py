"""Computes the comparison of control laws and writes its page; see docs/law-comparison.md.

``uv run --extra fast python docs/law_comparison``: hours on one processor. Results of runs are kept in
``logs/law-comparison``, so that a computation that was interrupted goes on where it was.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from cells import CELLS
from rows import RowFile, Wanted, judged_runs, tuning_runs
from table import Table

ROWS = Path(__file__).resolve().parents[2] / "logs" / "law-comparison" / "rows.jsonl"
POINTS, TUNING_RUNS = 64, 4


def main() -> None:
    """Compute what is missing."""
    parser = argparse.ArgumentParser(prog="law_comparison", description=__doc__)
    parser.add_argument("--cells", nargs="*", choices=CELLS, default=[*CELLS], help="cells to compute; default: all")
    parser.add_argument("--points", type=int, default=POINTS, help="points of the unit square that are tried")
    parser.add_argument("--tuning-runs", type=int, default=TUNING_RUNS, help="runs at each point")
    parser.add_argument("--runs", type=int, help="judged runs of each variant; default: as in the page")
    parser.add_argument("--rows", type=Path, default=ROWS, help="file of the results")
    options = parser.parse_args()
    results = RowFile(options.rows)
    every: list[Wanted] = []
    for name in dict.fromkeys(CELLS[name].tuned_in for name in options.cells):
        wanted = list(tuning_runs(CELLS[name], options.points, options.tuning_runs))
        results.complete(wanted)
        every += wanted
    tuning = results.table(every)
    for cell in (CELLS[name] for name in options.cells):
        tuned = {law.name: tuning.tuned(cell.tuned_in, law.name) for law in cell.laws}
        wanted = list(judged_runs(cell, tuned, cell.runs if options.runs is None else options.runs))
        results.complete(wanted)
        every += wanted
    results.table(every).write()


if __name__ == "__main__":
    main()
