"""What a capture costs: ticks of one run before an object is held and while it is, and the events between them.

``uv run --extra fast python benchmarks/capture.py`` prints microseconds of CPU time per control tick of `capture-planar`,
free and held, under one and the same OSDRE law, with everything on and the log in memory; what a capture and a release take
in wall time, before the control law is asked; and ticks of the same scene where no capture is declared. Of each run the
quickest stretch of a thousand ticks counts, of the repeats the median; ratios are within one repeat.
"""

# ruff: noqa: E402

from __future__ import annotations

from ffsm_mj.cli.main import one_blas_thread

one_blas_thread()

import argparse
import statistics
import time
from functools import partial
from typing import NamedTuple
from unittest.mock import patch

import numpy as np
import twins

from ffsm_mj.assembly.prepare import Prepared, prepare
from ffsm_mj.assembly.run import simulate
from ffsm_mj.log.recorder import BLOCK_ROWS
from ffsm_mj.simulation.loop import Simulation

HIT_S, HELD_S, AFTER_S = 7.77, 4.0, 1.0
GOALS = {"plain": 1.2, "compiled": 1.3}
EVENT_GOAL_MS = 2.0
EVERY = BLOCK_ROWS // 4
"""Stretches begin so many ticks apart."""
LAW = {"kind": "osdre", "joints": ["joint_1", "joint_2", "joint_3"], "Q": [1.0, 1.0, 0.5, 0.5], "R": [1.0, 1.0, 1.0]}


class Cost(NamedTuple):
    """Microseconds of CPU time per tick, free and held, and milliseconds of each event; nan where there was none."""

    free_us: float
    held_us: float
    capture_ms: float
    release_ms: float


def holding() -> Prepared:
    """The box is caught, held and let go, under one law."""
    phases = [
        {"name": "approach", "until": "capture", "arm": ["grasp"], "controller": LAW},
        {"name": "carry", "for_s": HELD_S, "controller": LAW},
        {"name": "leave", "until": "end", "release": ["grasp"], "controller": LAW},
    ]
    return prepare("capture-planar", {"phases": phases, "duration_s": HIT_S + HELD_S + AFTER_S})


def undeclared() -> Prepared:
    """The same until shortly before it would be caught, by nobody."""
    phases = [{"name": "approach", "until": "end", "controller": LAW}]
    return prepare("capture-planar", {"captures": {}, "phases": phases, "duration_s": HIT_S - 0.1})


def measured(prepared: Prepared) -> Cost:
    """What a run of it costs."""
    ticks: list[tuple[float, str]] = []
    events: list[tuple[str, float]] = []
    began = 0.0
    record, act, after = Simulation._record, Simulation._act, Simulation._after_event

    def noted(self: Simulation, time_s: float) -> None:
        record(self, time_s)
        ticks.append((time.process_time(), self._plant.course.motion.grasp))

    def acting(self: Simulation, *args: object) -> None:
        nonlocal began
        began = time.perf_counter()
        act(self, *args)

    def done(self: Simulation, effect, time_s: float) -> None:
        events.extend((type(each).__name__, 1e3 * (time.perf_counter() - began)) for each in effect.records)
        after(self, effect, time_s)

    with patch.multiple(Simulation, _record=noted, _act=acting, _after_event=done):
        run = simulate(prepared.assemble())
    assert run.outcome == "completed", run.message
    took = dict(events)
    quickest = (_quickest(ticks, held=held) for held in (False, True))
    return Cost(*quickest, *(took.get(name, float("nan")) for name in ("CaptureRecord", "ReleaseRecord")))


def _quickest(ticks: list[tuple[float, str]], *, held: bool) -> float:
    """Microseconds per tick of the quickest stretch throughout which something is held, or nothing is; nan without one."""
    clock, holds = np.array([at for at, _ in ticks]), np.array([bool(grasp) for _, grasp in ticks])
    least = float("nan")
    for start in range(0, len(ticks) - BLOCK_ROWS, EVERY):
        stretch = slice(start, start + BLOCK_ROWS + 1)
        if np.all(holds[stretch] == held):
            least = np.fmin(least, 1e6 * (clock[stretch][-1] - clock[start]) / BLOCK_ROWS)
    return float(least)


def main() -> None:
    """Run both ways, print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    repeats = parser.parse_args().repeats
    caught, alone = holding(), undeclared()
    simulate(alone.assemble())  # imports
    heads = {
        "free": 8,
        "held": 8,
        "ratio": 8,
        "goal": 6,
        "undeclared": 12,
        "free/it": 9,
        "capture, ms": 13,
        "release, ms": 13,
    }
    print(f"{'us per tick':12}" + "".join(f"{head:>{width}}" for head, width in heads.items()))
    for way, run in twins.ways().items():
        rounds = [(run(partial(measured, caught)), run(partial(measured, alone)).free_us) for _ in range(repeats)]
        costs = [cost for cost, _ in rounds]
        free, held, capture, release = (statistics.median(part) for part in zip(*costs, strict=True))
        ratio = statistics.median(cost.held_us / cost.free_us for cost in costs)
        without = statistics.median(none for _, none in rounds)
        declared = statistics.median(cost.free_us / none for cost, none in rounds)
        print(
            f"{way:12}{free:>8.1f}{held:>8.1f}{ratio:>8.2f}{GOALS[way]:>6.1f}{without:>12.1f}{declared:>9.2f}"
            f"{capture:>13.2f}{release:>13.2f}",
            flush=True,
        )
    print(f"goal for a capture and a release: {EVENT_GOAL_MS:g} ms each")


if __name__ == "__main__":
    main()
