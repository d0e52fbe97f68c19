"""How the ratio to the bare loop grows: with joints, objects, duration, pairs, and joints under control.

``uv run python benchmarks/growth.py`` prints, for generated scenes (``scenes.py``, beside this file), the CPU
time of the loop of ``mj_step`` and of the whole run in memory; medians over interleaved repeats, ratios within each.
"""

# ruff: noqa: E402

from __future__ import annotations

from ffsm_mj.cli.main import one_blas_thread

one_blas_thread()

import argparse
import statistics
from collections.abc import Callable
from functools import partial

import scenes
from loops import bare, in_memory, steps

from ffsm_mj.assembly.prepare import PreparedRun

JOINTS, OBJECTS, DURATIONS_S = (3, 7, 14, 28), (1, 4, 16), (1.0, 10.0, 60.0)
PAIRS = (1, 200, 2000)
CASES: dict[str, Callable[[], PreparedRun]] = {
    **{f"no control, {n} joints, 1 object, 10 s": partial(scenes.coasting, n) for n in JOINTS},
    **{f"no control, 7 joints, {n} objects, 10 s": partial(scenes.coasting, 7, objects=n) for n in OBJECTS[1:]},
    **{
        f"no control, 7 joints, 1 object, {t:g} s": partial(scenes.coasting, 7, duration_s=t)
        for t in DURATIONS_S
        if t != 10.0
    },
    **{f"no control, 7 joints, {n} distant pairs, 3 s": partial(scenes.beset, n) for n in PAIRS},
    **{f"OSDRE, p = 3, 1 kHz, {n} joints, 3 s": partial(scenes.regulated, n) for n in JOINTS[1:]},
}
BARE, RUN = "bare", "run"


def measured(prepared: PreparedRun, repeats: int) -> dict[str, list[float]]:
    """CPU seconds of the bare loop and of the run, in turn."""
    loops = {BARE: lambda: bare(prepared, stirred=False)}
    loops[RUN] = partial(in_memory, prepared)
    rounds = [{name: loop() for name, loop in loops.items()} for _ in range(repeats)]
    return {name: [one[name] for one in rounds] for name in loops}


def main() -> None:
    """Run every case, print its line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=3)
    repeats = parser.parse_args().repeats
    measured(scenes.coasting(3, duration_s=1.0), 1)  # imports
    print(f"{'':42}{'nv':>4}{'bare, us/step':>15}" + f"{RUN:>10}")
    for name, case in CASES.items():
        prepared = case()
        times = measured(prepared, repeats)
        step_us = 1e6 * statistics.median(times[BARE]) / steps(prepared)
        ratio = statistics.median(a / b for a, b in zip(times[RUN], times[BARE], strict=True))
        print(f"{name:42}{prepared.system.mj.nv:>4}{step_us:>15.1f}{ratio:>10.2f}", flush=True)


if __name__ == "__main__":
    main()
