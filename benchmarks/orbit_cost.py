"""What an orbit costs: runs of one scene in orbit and without, in turn.

``uv run python benchmarks/orbit_cost.py`` prints, for generated scenes (``scenes.py``, beside this file), microseconds of
CPU time per control tick of a whole run in memory, one step a tick, without and with ``environment.orbit``, and their ratio.
Runs are short and take turns; of each the quickest of its repeats counts, so that a loaded machine tells the same.
"""

# ruff: noqa: E402

from __future__ import annotations

from ffsm_mj.cli.main import one_blas_thread

one_blas_thread()

import argparse
from collections.abc import Callable
from functools import partial

import scenes
from loops import in_memory, steps

from ffsm_mj.assembly.prepare import PreparedRun

GOAL = 1.15
DURATION_S = 2.0
ORBIT = {"environment": {"orbit": {"altitude_km": 400.0}}}
CASES: dict[str, Callable[..., PreparedRun]] = {
    "no control, two free bodies": partial(scenes.coasting, 0),
    "no control, 3 joints, 1 object": partial(scenes.coasting, 3),
    "no control, 7 joints, 1 object": partial(scenes.coasting, 7),
    "no control, 7 joints, 4 objects": partial(scenes.coasting, 7, objects=4),
    "no control, 14 joints, 1 object": partial(scenes.coasting, 14),
    "OSDRE, three outputs at 1 kHz, 7 joints": partial(scenes.regulated, 7),
}


def measured(case: Callable[..., PreparedRun], repeats: int) -> tuple[float, float]:
    """Microseconds per tick without the orbit and with it."""
    free, around = case(duration_s=DURATION_S), case(duration_s=DURATION_S, changes=ORBIT)
    rounds = [(in_memory(free), in_memory(around)) for _ in range(repeats)]
    without, within = (1e6 * min(times) / steps(free) for times in zip(*rounds, strict=True))
    return without, within


def main() -> None:
    """Run every case, and print its line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=40)
    repeats = parser.parse_args().repeats
    print(f"{'':42}{'free, us':>10}{'orbit, us':>11}{'ratio':>8}   goal {GOAL}")
    for name, case in CASES.items():
        free, around = measured(case, repeats)
        print(f"{name:42}{free:>10.1f}{around:>11.1f}{around / free:>8.2f}", flush=True)


if __name__ == "__main__":
    main()
