"""Compare runs of this checkout with those of another revision, both made on this machine.

All shipped scenarios and one campaign, with the extra ``fast`` where a revision has it: the same events, rows within 1e-11
of their scale before the first event and 1e-9 after it, the same exit codes of run and analysis::

    uv run --group dev python -m tests.golden.compare ed46dfb8
    uv run --group dev python -m tests.golden.compare ed46dfb8 --scenarios baseline tap
"""

from __future__ import annotations

import argparse
import json
import os
import sqlite3
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

import ffsm_mj
from ffsm_mj.errors import FfsmError
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.scenario.shipped import scenario_names
from ffsm_mj.verification.agreement import Agreement, is_text, numbers_of

ROOT = Path(__file__).parents[2]
BEFORE, AFTER = 1e-11, 1e-9
"""Differences over the scale of a column before the first event, and after it: an impact multiplies them."""
RENAMED: dict[str, str] = {}
"""Columns by their names in earlier revisions."""
DROPPED = {"balance.contact_force_residual_N"}
"""Columns of earlier revisions that held no result."""
OF_THE_MACHINE = ("wall", "cpu", "memory")
"""Words of columns and metrics that tell of the machine."""
CAMPAIGN, RUNS = "baseline-dispersed", 16


def main() -> int:
    """Run both, and print each difference; 1 if there is any."""
    parser = argparse.ArgumentParser(prog="python -m tests.golden.compare", description=__doc__.partition("\n")[0])
    parser.add_argument("revision", help="revision to compare with, e.g. HEAD~1")
    parser.add_argument("--scenarios", nargs="*", default=scenario_names(), metavar="NAME", help="default: all that ship")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, work_tree(given.revision, Path(folder) / "tree") as other:
        places = [(other, Path(folder) / "before"), (ROOT, Path(folder) / "now")]
        jobs = [(name, place) for name in (*given.scenarios, CAMPAIGN) for place in places]
        with ThreadPoolExecutor(given.jobs) as pool:
            codes = list(pool.map(lambda job: made(job[0], *job[1]), jobs))
        found = 0
        for name, before, now in zip((*given.scenarios, CAMPAIGN), codes[::2], codes[1::2], strict=True):
            told = [] if before == now else [f"exit codes {before}, now {now}"]
            compare = campaign_differences if name == CAMPAIGN else run_differences
            try:
                told += compare(*(out / name for _, out in places))
            except FfsmError as error:  # one of them did not get as far
                told.append(str(error))
            print(f"{name}: {'; '.join(told) or 'the same'}", flush=True)
            found += bool(told)
    return int(found > 0)


@contextmanager
def work_tree(revision: str, place: Path) -> Iterator[Path]:
    """A work tree of a revision with an environment of its own."""
    subprocess.run(["git", "worktree", "add", "--quiet", "--detach", place, revision], cwd=ROOT, check=True)
    try:
        extra = ["--extra", "fast"] if (place / "fast").is_dir() else []
        subprocess.run(["uv", "sync", "--quiet", *extra], cwd=place, env=_environment(), check=True)
        yield place
    finally:
        subprocess.run(["git", "worktree", "remove", "--force", place], cwd=ROOT, check=True)


def _environment() -> dict[str, str]:
    """Without the environment of this process, which is not that of a work tree."""
    return {name: value for name, value in os.environ.items() if name != "VIRTUAL_ENV"}


def made(name: str, tree: Path, out: Path) -> tuple[int, ...]:
    """Exit codes of a scenario's run and of its analysis, or of the campaign's runs, made by a work tree in ``out``/NAME."""
    python = sys.executable if tree == ROOT else str(tree / ".venv" / "bin" / "python")
    ffsm, folder = [python, "-P", "-m", "ffsm_mj"], str(out / name)
    if name == CAMPAIGN:
        commands = [["campaign", "run", name, "-s", f"samples.n={RUNS}", "--workers", "1", "--out", folder]]
    else:
        commands = [["run", name, "--no-rerun", "--out", folder], ["analyze", folder]]
    out.mkdir(exist_ok=True)
    calls = [
        subprocess.run([*ffsm, *each], cwd=out, env=_environment(), capture_output=True, check=False) for each in commands
    ]
    return tuple(call.returncode for call in calls)


def run_differences(before: Path, now: Path) -> list[str]:
    """What differs between the logs of two run folders."""
    return log_differences(*(ffsm_mj.load_run(folder).log for folder in (before, now)))


def log_differences(before: RunLog, now: RunLog) -> list[str]:
    """What differs between two logs."""
    return [*_event_differences(before, now), *_row_differences(before, now)]


def _event_differences(before: RunLog, now: RunLog) -> Iterator[str]:
    for kind in before.kinds:
        olds, news = before.records.get(kind.plural, ()), now.records.get(kind.plural, ())
        if len(olds) != len(news):
            yield f"{len(olds)} {kind.plural}, now {len(news)}"
            continue
        for i, (old, new) in enumerate(zip(olds, news, strict=True)):
            numbers = [each.name for each in fields(old) if not is_text(getattr(old, each.name))]
            allowed = {name: AFTER * (1.0 + _largest(getattr(old, name))) for name in numbers}
            found = Agreement()
            found.record(f"{kind.plural} {i + 1}", old, new, kind.time(old), allowed)
            if found.worst and not found.worst.passes:
                yield f"{found.worst.what} by {found.worst.size:.1e}"


def _largest(value: Any) -> float:
    return float(np.abs(numbers_of(value)).max(initial=0.0))


def _row_differences(before: RunLog, now: RunLog) -> Iterator[str]:
    old_keys = [RENAMED.get(key, key) for key in before.header.layout.keys]
    new_keys = list(now.header.layout.keys)
    if lost := sorted(set(old_keys) - set(new_keys) - DROPPED):
        yield f"columns lost: {', '.join(lost)}"
    if before.rows.shape[0] != now.rows.shape[0]:
        yield f"{before.rows.shape[0]} rows, now {now.rows.shape[0]}"
        return
    first = min(before.instants_s, default=np.inf)
    is_before = np.asarray(before.rows[:, before.header.layout.time]) < first
    for key in [key for key in old_keys if key in new_keys and not any(word in key for word in OF_THE_MACHINE)]:
        a, b = before.rows[:, old_keys.index(key)], now.rows[:, new_keys.index(key)]
        scale = 1.0 + np.max(np.abs(a[np.isfinite(a)]), initial=0.0)
        with np.errstate(invalid="ignore"):  # infinite gaps of pairs far apart
            apart = np.where((a == b) | (np.isnan(a) & np.isnan(b)), 0.0, np.abs(a - b) / scale)
        apart = np.where(np.isnan(apart), np.inf, apart)
        if np.any(apart > np.where(is_before, BEFORE, AFTER)):
            yield f"{key} by {apart.max():.1e} of its scale"


def campaign_differences(before: Path, now: Path) -> list[str]:
    """What differs between the rows of two campaign folders."""
    old, new = (rows_of(folder) for folder in (before, now))
    if len(old) != len(new):
        return [f"{len(old)} rows, now {len(new)}"]
    told = []
    for i, ((was, a), (outcome, b)) in enumerate(zip(old, new, strict=True)):
        wrong = [name for name in {*a} & {*b} if not _same(a[name], b[name], name)]
        if was != outcome or wrong:
            told.append(f"run {i}: {was}, now {outcome}; {', '.join(sorted(wrong))}")
    return told


def rows_of(folder: Path) -> list[tuple[str, dict[str, Any]]]:
    """Outcome and metrics of the rows of a campaign folder, of any version of its table."""
    with closing(sqlite3.connect(folder / "rows.sqlite")) as table:
        rows = table.execute("SELECT outcome, metrics FROM rows ORDER BY i").fetchall()
    return [(outcome, json.loads(metrics)) for outcome, metrics in rows]


def _same(old: Any, new: Any, name: str) -> bool:
    """Whether two metrics are: one may have no value or be a text."""
    if any(word in name for word in OF_THE_MACHINE):
        return True
    numbers = isinstance(old, (int, float)) and isinstance(new, (int, float))
    return bool(old == new) or (numbers and abs(old - new) <= AFTER * (1.0 + abs(old)))


if __name__ == "__main__":
    sys.exit(main())
