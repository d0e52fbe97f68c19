"""Cost of a campaign in addition to its simulations: CPU time, throughput of executors, and memory.

``uv run python benchmarks/campaign.py`` prints (1) the CPU time of a run outside the simulation, without and with a
controller model, (2) the CPU time of whole runs of ``baseline-dispersed``, (3) runs per second of a pool of two processes
and of two local Dask workers over twice those of a loop, (4) the memory of a worker over 500 runs. (3) uses baseline runs
of 2 s, (4) of 0.2 s; medians over interleaved repeats. ``--repeats 0`` omits both. (3) requires an idle machine with two
processors.
"""

# ruff: noqa: E402

from __future__ import annotations

from ffsm_mj.cli.main import one_blas_thread

one_blas_thread()

import argparse
import os
import statistics
import time
from collections.abc import Callable
from concurrent.futures import Executor
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

from ffsm_mj.experiments.campaign import Campaign
from ffsm_mj.experiments.executors import Processes, loop
from ffsm_mj.experiments.worker import execute_runs
from ffsm_mj.simulation.loop import Simulation

GOALS = {"pool": 0.95, "dask": 0.90}
OVERHEAD_S = 0.015
_CAMPAIGN = """
campaign: benchmark
scenario: baseline
overrides: {{duration_s: {duration}}}
samples: {{kind: random, n: {n}, seed: 1}}
dispersions: {{{mass}: {{scale: {{uniform: [0.9, 1.1]}}}}}}
metrics: [tip.min_error_m]
limits: {{timeout_s: 60}}
"""


_MASSES = {"": "model.object.box.mass_kg", ", controller model": "controller_model.robot.base.mass_kg"}
"""Dispersed mass of the measured campaigns; one in the controller model requires a second compilation of the scene."""


def campaign(folder: Path, n: int, duration: float, mass: str = _MASSES[""]) -> Campaign:
    """A campaign with a dispersed mass, in its own folder."""
    file = folder / f"campaign-{n}-{duration:g}-{mass}.yaml"
    file.write_text(_CAMPAIGN.format(n=n, duration=duration, mass=mass))
    return Campaign.load(file, folder / file.stem)


def overhead(found: Campaign, runs: int) -> float:
    """CPU time of a run outside its simulation, s: median."""
    job = found._job(exclusive=False)
    simulated: list[float] = []
    whole: Callable[..., Any] = Simulation.run

    def measured(*given: Any) -> Any:
        begun = time.process_time()
        outcome = whole(*given)
        simulated.append(time.process_time() - begun)
        return outcome

    with patch.object(Simulation, "run", measured):
        rows = execute_runs(job, [(i, found.design.overrides(i)) for i in range(runs)])
    return statistics.median(row.cpu_s - spent for row, spent in zip(rows, simulated, strict=True))


def dispersed(folder: Path, runs: int) -> float:
    """CPU time of a run of ``baseline-dispersed`` in a pool of two processes, s: median over the first runs."""
    found = Campaign.load("baseline-dispersed", folder / "dispersed", overrides=["keep.failures=0"])
    job = found._job(exclusive=False)
    with Processes(2) as pool:
        made = [pool.submit(execute_runs, job, [(i, found.design.overrides(i))]) for i in range(runs)]
        return statistics.median(row.cpu_s for future in made for row in future.result())


def rate(found: Campaign, pool: Executor, first: int, runs: int) -> float:
    """Runs per second, one run per task."""
    job = found._job(exclusive=False)
    begun = time.perf_counter()
    made = [pool.submit(execute_runs, job, [(i, found.design.overrides(i))]) for i in range(first, first + runs)]
    for future in made:
        future.result()
    return runs / (time.perf_counter() - begun)


def memory_MiB(pool: Executor) -> float:
    """Resident memory of the only worker of a pool, MiB."""
    worker = pool.submit(os.getpid).result()
    lines = Path(f"/proc/{worker}/status").read_text().splitlines()
    return int(next(line.split()[1] for line in lines if line.startswith("VmRSS"))) / 1024.0


def growth(found: Campaign, runs: int) -> tuple[float, float]:
    """Memory of a worker after two fifths of its runs and after all runs, MiB."""
    with Processes(1) as pool:
        job = found._job(exclusive=False)
        batch = [(i, found.design.overrides(i)) for i in range(runs)]
        pool.submit(execute_runs, job, batch[: runs * 2 // 5]).result()
        early = memory_MiB(pool)
        pool.submit(execute_runs, job, batch[runs * 2 // 5 :]).result()
        return early, memory_MiB(pool)


def executors(stack: ExitStack) -> dict[str, Executor]:
    """A loop, a pool of two processes, and two Dask workers if distributed is installed."""
    found: dict[str, Any] = {"loop": stack.enter_context(loop().open()), "pool": stack.enter_context(Processes(2))}
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        return found
    cluster = stack.enter_context(LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None))
    found["dask"] = stack.enter_context(Client(cluster)).get_executor(pure=False)
    return found


def main() -> None:
    """Print all measurements."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--runs", type=int, default=20, help="runs per executor and repeat")
    parser.add_argument("--memory-runs", type=int, default=500)
    parser.add_argument("--dispersed-runs", type=int, default=16, help="number of whole runs of baseline-dispersed")
    given = parser.parse_args()
    with TemporaryDirectory(prefix="ffsm-campaign-") as folder, ExitStack() as stack:
        for what, mass in _MASSES.items():
            short = campaign(Path(folder), 64, 0.2, mass)
            overhead(short, 4)  # the first runs import modules
            spent_ms = overhead(short, 40) * 1e3
            print(f"outside the simulation{what}  {spent_ms:6.1f} ms per run  (goal {OVERHEAD_S * 1e3:g})")
        if given.dispersed_runs:
            each = dispersed(Path(folder), given.dispersed_runs)
            minutes = each * 512 / 60
            print(f"baseline-dispersed  {each:6.2f} s of CPU per run: 1024 in {minutes:.1f} min on two quiet processors")
        if not given.repeats:
            return
        found = campaign(Path(folder), 512, 2.0)
        pools = executors(stack)
        for pool in pools.values():
            rate(found, pool, 0, 4)
        ratios: dict[str, list[float]] = {name: [] for name in pools if name != "loop"}
        for _ in range(given.repeats):
            rates = {name: rate(found, pool, 0, given.runs) for name, pool in pools.items()}
            for name, each in ratios.items():
                each.append(rates[name] / (2.0 * rates["loop"]))
        for name, each in ratios.items():
            low, middle, high = min(each), statistics.median(each), max(each)
            print(f"{name}, 2 workers / 2 loops  {middle:5.2f}  ({low:.2f} to {high:.2f}; goal {GOALS[name]:.2f})")
        early, late = growth(campaign(Path(folder), given.memory_runs, 0.2), given.memory_runs)
        begun = given.memory_runs * 2 // 5
        print(f"memory of a worker  {early:.0f} MiB after {begun} runs, {late:.0f} after {given.memory_runs}")


if __name__ == "__main__":
    main()
