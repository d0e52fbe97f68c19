"""Kill -9 at random moments of real runs: how much of each log is left, and whether it proves what it holds.

``uv run python benchmarks/kills.py --kills 120`` starts ``ffsm run baseline`` so many times, kills it between its first byte
on disk and its end, and lets ``ffsm analyze`` judge the log. Seconds lost are those between the last write and the kill.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.cli.main import main as ffsm
from ffsm_mj.errors import FfsmError


@dataclass(frozen=True)
class Kill:
    """What one killed run left: an error, or simulated seconds, wall seconds lost, what ``ffsm analyze`` said."""

    error: str = ""
    logged_s: float = 0.0
    lost_wall_s: float = 0.0
    lost_simulated_s: float = 0.0
    laws: int = 0
    broken: int = 0
    impacts: int = 0
    said_so: bool = False


def start(folder: Path) -> tuple[subprocess.Popen[bytes], float]:
    """A real run in a process of its own, and when its log appeared."""
    command = [sys.executable, "-m", "ffsm_mj.cli.main", "run", "baseline", "--no-rerun", "--out", str(folder)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not (folder / "run.mcap.partial").exists() and process.poll() is None:
        time.sleep(0.001)
    return process, time.time()


def whole_run() -> float:
    """Wall seconds from the first byte on disk to the end of a run that nobody kills."""
    with tempfile.TemporaryDirectory() as folder:
        process, begun = start(Path(folder) / "run")
        process.wait()
        return time.time() - begun


def kill(after_s: float) -> Kill | None:
    """Kill one run some time after its first byte; None where it was faster."""
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        process, begun = start(run)
        time.sleep(max(0.0, begun + after_s - time.time()))
        os.kill(process.pid, signal.SIGKILL)
        killed = time.time()
        process.wait()
        log = run / "run.mcap.partial"
        return judge(run, begun, killed, log.stat().st_mtime) if log.exists() else None


def judge(run: Path, begun: float, killed: float, written: float) -> Kill:
    """What the log of a killed run says."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = ffsm(["analyze", str(run)])
    try:
        read = ffsm_mj.load_run(run)
        laws = all_checks(read)
    except FfsmError as error:
        return Kill(error=str(error).split(": ", 1)[-1])
    if code == 2:
        return Kill(error="no sample yet")
    lost = max(0.0, killed - written)
    pace = read.time[-1] / max(written - begun, 1e-3)
    return Kill(
        logged_s=float(read.time[-1]),
        lost_wall_s=lost,
        lost_simulated_s=lost * pace,
        laws=len(laws),
        broken=sum(not law.passes for law in laws),
        impacts=len(read.impacts),
        said_so=code == 0 and "incomplete" in said.getvalue(),
    )


def spread(values: list[float]) -> str:
    """Median, 95th percentile and greatest."""
    ordered = sorted(values)
    most_of_them = ordered[int(0.95 * (len(ordered) - 1))]
    return f"median {statistics.median(ordered):.3f}, 95 % {most_of_them:.3f}, most {ordered[-1]:.3f}"


def main() -> None:
    """Kill, judge, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=120)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng, length = random.Random(options.seed), whole_run()
    kills: list[Kill] = []
    while len(kills) < options.kills:
        result = kill(rng.uniform(0.0, length))
        if result is not None:
            kills.append(result)
    readable = [k for k in kills if not k.error]
    print(f"{len(kills)} kills over {length:.1f} s of wall time per run")
    print(
        f"readable, with samples: {len(readable)}; called incomplete by 'ffsm analyze': {sum(k.said_so for k in readable)}"
    )
    for error in sorted({k.error for k in kills if k.error}):
        print(f"  {sum(k.error == error for k in kills)} with {error}")
    print(
        f"logged before the kill, s: from {min(k.logged_s for k in readable):.3f} to {max(k.logged_s for k in readable):.3f}"
    )
    print(f"wall seconds lost: {spread([k.lost_wall_s for k in readable])}")
    print(f"simulated seconds lost: {spread([k.lost_simulated_s for k in readable])}")
    print(f"laws: {sum(k.laws - k.broken for k in readable)} of {sum(k.laws for k in readable)} hold")
    print(f"logs that reach the impact at 7.769 s: {sum(k.logged_s > 7.77 for k in readable)}", end=", ")
    print(f"with their impact: {sum(k.impacts > 0 for k in readable)}")


if __name__ == "__main__":
    main()
