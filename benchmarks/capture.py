"""What a capture costs: ticks of one run before an object is held and while it is, and the events between them.

``uv run python benchmarks/capture.py`` prints microseconds per control tick of `capture-planar`, free and held,
under one and the same OSDRE law, with everything on and the log in memory; milliseconds that a capture and a release take
before the control law is asked; and ticks of the same scene where no capture is declared. All is wall time. A tick is that
of the stretches of twenty which only one of twenty undercuts, so that a loaded machine tells the same, and its share of what
is worked out a block of rows at a time, by the quickest block. Of the repeats, which take turns, the least.
"""

# ruff: noqa: E402

from __future__ import annotations

from ffsm_mj.cli.main import one_blas_thread

one_blas_thread()

import argparse
import time
from typing import NamedTuple
from unittest.mock import patch

import numpy as np

from ffsm_mj.assembly.prepare import PreparedRun, prepare
from ffsm_mj.assembly.run import simulate
from ffsm_mj.contact_models.interface import EventEffect, EventSource
from ffsm_mj.log.recorder import RECORDED_ROWS, Recorder
from ffsm_mj.simulation.loop import Simulation
from ffsm_mj.simulation.progress import EventDue
from ffsm_mj.simulation.steps import GridStep

HIT_S, HELD_S, AFTER_S = 7.77, 4.0, 1.0
GOAL = 1.3
EVENT_GOAL_MS = 2.0
WIDTHS = (8, 8, 8, 6, 12, 13, 13)
STRETCH, SHARE = 20, 0.05
"""Ticks that are timed together, and the share of them that may be quicker than what is told."""
LAW = {"kind": "osdre", "joints": ["joint_1", "joint_2", "joint_3"], "Q": [1.0, 1.0, 0.5, 0.5], "R": [1.0, 1.0, 1.0]}


class Cost(NamedTuple):
    """Microseconds per tick, free and held, and of its share of a block; milliseconds of each event. nan: there was none."""

    free_us: float
    held_us: float
    free_block_us: float
    held_block_us: float
    capture_ms: float
    release_ms: float


def holding() -> PreparedRun:
    """The box is caught, held and let go, under one law."""
    phases = [
        {"name": "approach", "until": "grasp", "arm": ["grasp"], "controller": LAW},
        {"name": "carry", "for_s": HELD_S, "controller": LAW},
        {"name": "leave", "until": "end", "release": ["grasp"], "controller": LAW},
    ]
    return prepare("capture-planar", {"phases": phases, "duration_s": HIT_S + HELD_S + AFTER_S})


def undeclared() -> PreparedRun:
    """The same until shortly before it would be caught, by nobody."""
    phases = [{"name": "approach", "until": "end", "controller": LAW}]
    return prepare("capture-planar", {"grasps": {}, "phases": phases, "duration_s": HIT_S - 0.1})


def measured(prepared: PreparedRun) -> Cost:
    """What a run of it costs."""
    ticks: list[tuple[float, bool]] = []
    blocks: list[tuple[float, bool]] = []
    events: list[tuple[str, float]] = []
    began = in_blocks = 0.0
    after, apply, pass_on = Simulation._settle, GridStep._apply, Recorder.pass_on
    assembly = prepared.assemble()

    def noted(_time_s: float, _duration_s: float) -> None:
        ticks.append((time.perf_counter() - in_blocks, bool(assembly.plant.integrator.motion.grasp)))

    def passing(self: Recorder) -> None:
        nonlocal in_blocks
        rows, start = self.line, time.perf_counter()
        pass_on(self)
        spent = time.perf_counter() - start
        in_blocks += spent
        if rows == RECORDED_ROWS:
            blocks.append((spent / rows, ticks[-1][1]))

    def applying(self: GridStep, contact_model: EventSource) -> EventEffect | None:
        nonlocal began
        began = time.perf_counter()
        return apply(self, contact_model)

    def done(self: Simulation, due: EventDue, commanded: bool = False) -> None:
        events.extend((type(each).__name__, 1e3 * (time.perf_counter() - began)) for each in due.records)
        after(self, due, commanded)

    with (
        patch.object(Simulation, "_settle", done),
        patch.object(GridStep, "_apply", applying),
        patch.object(Recorder, "pass_on", passing),
    ):
        run = simulate(assembly, report=noted)
    assert run.outcome == "completed", run.message
    took = dict(events)
    free, held = (_of_stretches(ticks, held=held) for held in (False, True))
    of_blocks = (
        min((1e6 * spent for spent, holding in blocks if holding == held), default=np.nan) for held in (False, True)
    )
    return Cost(free, held, *of_blocks, *(took.get(name, float("nan")) for name in ("GraspRecord", "ReleaseRecord")))


def _of_stretches(ticks: list[tuple[float, bool]], *, held: bool) -> float:
    """Microseconds per tick while something is held, or nothing is; nan where that is never."""
    clock, holds = (np.array(part) for part in zip(*ticks, strict=True))
    starts = range(0, len(ticks) - STRETCH, STRETCH)
    stretches = [clock[i + STRETCH] - clock[i] for i in starts if np.all(holds[i : i + STRETCH + 1] == held)]
    return 1e6 * float(np.quantile(stretches, SHARE)) / STRETCH if stretches else float("nan")


def main() -> None:
    """Run and print a line, in us per tick."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    repeats = parser.parse_args().repeats
    caught, alone = holding(), undeclared()
    simulate(alone.assemble())  # imports
    heads = [*zip(("free", "held", "ratio", "goal", "undeclared", "capture, ms", "release, ms"), WIDTHS, strict=True)]
    print("".join(f"{head:>{width}}" for head, width in heads))
    costs = [measured(each) for _ in range(repeats) for each in (caught, alone)]
    least, alone_least = (Cost(*map(min, zip(*some, strict=True))) for some in (costs[::2], costs[1::2]))
    free, held = least.free_us + least.free_block_us, least.held_us + least.held_block_us
    without = alone_least.free_us + alone_least.free_block_us
    ticks = f"{free:.1f}", f"{held:.1f}", f"{held / free:.2f}", GOAL, f"{without:.1f}"
    cells = zip((*ticks, f"{least.capture_ms:.2f}", f"{least.release_ms:.2f}"), WIDTHS, strict=True)
    print("".join(f"{cell:>{width}}" for cell, width in cells), flush=True)
    print(f"goal for a capture and a release: {EVENT_GOAL_MS:g} ms each")


if __name__ == "__main__":
    main()
