"""Other engines on four scenes in zero gravity: a collision, a grip, free flight and a weld; error against cost.

``UV_PROJECT_ENVIRONMENT=build/engines uv run --group engines python benchmarks/engines.py`` makes an
environment with the engines (1.5 GB), runs every engine that is installed in a process of its own and writes
``docs/engines.json``, ``docs/engines.md`` and its figure. ``--page`` writes page and figure from the JSON; ``--only ENGINE``
replaces the rows of one engine; ``--list`` prints what would be run.
"""

# ruff: noqa: E402

from __future__ import annotations

from ffsm_mj.cli.main import one_blas_thread

one_blas_thread()

import argparse
import json
import multiprocessing
import platform
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from engine_runs import page
from engine_runs.measures import errors
from engine_runs.sweeps import ENGINES, Job

DATA = Path(__file__).parents[1] / "docs" / "engines.json"
REPEATS, LONG_S = 3, 2.0


def measured(job: Job) -> dict[str, Any]:
    """Errors of a job, and its least CPU time of several repeats per simulated second."""
    row: dict[str, Any] = {
        "scene": job.scene.name + (f", e = {job.scene.restitution:g}" if job.scene.name == "collision" else ""),
        "engine": job.engine,
        "setting": job.setting,
        "value": job.value,
    }
    spent: list[float] = []
    while len(spent) < REPEATS and sum(spent) < LONG_S:
        states, seconds = job.run()
        spent.append(seconds)
    found = errors(job.scene, states)
    return row | {"cost": min(spent) / job.scene.duration_s if found else None, "errors": found}


def rows_of(engine: str) -> list[dict[str, Any]]:
    """All jobs of an engine."""
    rows = []
    for job in ENGINES[engine][1]():
        rows.append(measured(job))
        print(json.dumps(rows[-1]), flush=True)
    return rows


def in_own_process(engine: str) -> list[dict[str, Any]]:
    """All jobs of an engine where no other engine is loaded."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(rows_of, engine).result()


def run_engines(engines: Iterable[str]) -> None:
    """Run those that are installed and write the JSON; rows of others stay."""
    data: dict[str, Any] = json.loads(DATA.read_text()) if DATA.exists() else {"versions": {}, "rows": []}
    data["versions"]["Python"] = platform.python_version()
    for engine in engines:
        version = ENGINES[engine][0]()
        if version is None:
            print(f"{engine}: not installed, see docs/engines.md")
            continue
        rows = in_own_process(engine)
        data["versions"][engine] = version
        data["rows"] = [row for row in data["rows"] if row["engine"] != engine] + rows
        write(data)


def write(data: dict[str, Any]) -> None:
    """The JSON, one row a line."""
    order = list(ENGINES)
    rows = sorted(data["rows"], key=lambda row: order.index(row["engine"]))
    lines = ",\n".join(json.dumps(row) for row in rows)
    versions = {name: data["versions"][name] for name in ("Python", *order) if name in data["versions"]}
    DATA.write_text(f'{{"versions": {json.dumps(versions)},\n"rows": [\n{lines}\n]}}\n')


def main() -> None:
    """Run, or only write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=ENGINES, action="append", help="replace the rows of this engine")
    parser.add_argument("--page", action="store_true", help="only write page and figure from the JSON")
    parser.add_argument("--list", action="store_true", help="only print the runs")
    options = parser.parse_args()
    if options.list:
        for engine in options.only or ENGINES:
            for job in ENGINES[engine][1]():
                print(f"{engine:10} {job.scene.name:10} {job.setting:44} {job.value}")
        return
    if not options.page:
        run_engines(options.only or ENGINES)
    page.write(json.loads(DATA.read_text()), DATA.parent)


if __name__ == "__main__":
    main()
