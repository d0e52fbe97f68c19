"""Computes the comparison of control laws and writes docs/law-comparison.md, its figures and campaign files.

``uv run python docs/law_comparison``: hours on one processor. Results of runs are kept in
``logs/law-comparison``, so that a computation that was interrupted goes on where it was.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from campaigns import campaign_files
from cells import CELLS
from check import differences, write_check
from figures import draw
from once import compute_once, read_once
from page import PAGE, page
from rows import RowFile, Wanted, judged_runs, tuning_runs
from table import Table

ROWS = Path(__file__).resolve().parents[2] / "logs" / "law-comparison" / "rows.jsonl"
POINTS, TUNING_RUNS = 64, 4


def main() -> int:
    """Compute what is missing, write the page, or check it; returns the exit code."""
    options = _options()
    if options.check:
        return _check()
    if not options.page:
        _compute(options)
        compute_once(Table.read())
        write_check()
    table, once = Table.read(), read_once()
    draw(table, once)
    PAGE.write_text(page(table, once))
    for path, text in campaign_files(table).items():
        path.write_text(text)
    print(f"written: {PAGE}")
    return 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="law_comparison", description="Compare control laws on one collision.")
    parser.add_argument("--cells", nargs="*", choices=CELLS, default=[*CELLS], help="cells to compute; default: all")
    parser.add_argument("--points", type=int, default=POINTS, help="points of the unit square that are tried")
    parser.add_argument("--tuning-runs", type=int, default=TUNING_RUNS, help="runs at each point")
    parser.add_argument("--runs", type=int, help="judged runs of each variant; default: 64 of the baseline, 20 of others")
    parser.add_argument("--rows", type=Path, default=ROWS, help="file of the results of runs")
    only = parser.add_mutually_exclusive_group()
    only.add_argument("--page", action="store_true", help="write page, figures and campaigns from the stored table")
    only.add_argument("--check", action="store_true", help="repeat 8 points of each law; page and campaigns must be current")
    return parser.parse_args()


def _compute(options: argparse.Namespace) -> None:
    """Complete the runs and store the table."""
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


def _check() -> int:
    """Whether page, campaigns and numbers are current; prints what is not."""
    table = Table.read()
    texts = {PAGE: page(table, read_once()), **campaign_files(table)}
    stale = [f"{path}: is not what the stored table gives" for path, text in texts.items() if path.read_text() != text]
    stale += differences()
    for line in stale:
        print(line, file=sys.stderr)
    print(f"docs/law-comparison.md: {f'{len(stale)} differences' if stale else 'is current'}")
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main())
