"""Where the microseconds of a control tick go.

``uv run python benchmarks/tick.py [SCENARIO ...]`` prints a table of each scenario (`baseline` and `spatial`),
microseconds per step and per tick, where a tick has more than one step, and per call of each part. Parts that the core calls
one after the other, without Python, are timed alone, many times in a row, at a state of the first phase; those that Python
calls by clocks in whole runs in memory, whose cost is measured and taken off. An indented part is within the one above it.
Of several runs the quickest counts.
"""

# ruff: noqa: E402

from __future__ import annotations

from ffsm_mj.cli.main import one_blas_thread

one_blas_thread()

import argparse
import time
from collections.abc import Callable
from contextlib import ExitStack
from operator import methodcaller
from typing import NamedTuple
from unittest.mock import patch

import mujoco
from loops import steps

from ffsm_controllers.allocation import ThrusterAllocation, WheelAllocation
from ffsm_controllers.free_flying import FreeFlying
from ffsm_mj.assembly.prepare import PreparedRun, prepare
from ffsm_mj.assembly.run import Recording
from ffsm_mj.balance.external import BaseMotors, Thrusters
from ffsm_mj.simulation.rows import RowWriter

CLOCKED = {
    "free-flying law": [(FreeFlying, "control")],
    "of it allocation": [(ThrusterAllocation, "efforts"), (WheelAllocation, "efforts")],
    "push from outside, end of a step": [(Thrusters, "close"), (BaseMotors, "close")],
    "columns of the balance, by blocks": [(RowWriter, "complete")],
}
CALLS, FIRST_TICKS = 5000, 50
WIDTH = 13


class Clock:
    """Adds up the time spent in one method."""

    def __init__(self, function):
        self.function, self.calls, self.spent = function, 0, 0

    def __get__(self, instance, owner):
        def timed(*args, **kwargs):
            start = time.perf_counter_ns()
            try:
                return self.function(instance, *args, **kwargs)
            finally:
                self.spent += time.perf_counter_ns() - start
                self.calls += 1

        return timed


class Nothing:
    """A method that does nothing, with a clock and without."""

    def idle(self):
        """Return."""

    timed = Clock(idle)


def overheads_us() -> tuple[float, float]:
    """What a clock counts of itself per call, and what it costs."""
    nothing, clock, many = Nothing(), Nothing.__dict__["timed"], 100_000
    clock.calls = clock.spent = 0

    def microseconds(call) -> float:
        start = time.perf_counter()
        for _ in range(many):
            call(nothing)
        return 1e6 * (time.perf_counter() - start) / many

    costs = microseconds(methodcaller("timed")) - microseconds(methodcaller("idle"))
    return 1e-3 * clock.spent / clock.calls, costs


class Cost(NamedTuple):
    """Of a part: microseconds in a whole run, and the calls that took them."""

    spent_us: float
    calls: int


class Timed(NamedTuple):
    """Microseconds of a whole run without what the clocks cost, and of its parts."""

    whole_us: float
    parts: dict[str, Cost]


def clocked(prepared: PreparedRun, parts: dict[str, list]) -> Timed:
    """What a run takes, and what each part takes of it."""
    clocks = {name: [Clock(getattr(kind, method)) for kind, method in methods] for name, methods in parts.items()}
    with ExitStack() as patched:
        for name, methods in parts.items():
            for (kind, method), clock in zip(methods, clocks[name], strict=True):
                patched.enter_context(patch.object(kind, method, clock))
        start = time.perf_counter()
        prepared.run()
        whole = 1e6 * (time.perf_counter() - start)
    (counted, cost), costs = overheads_us(), {}
    for name, several in clocks.items():
        calls = sum(clock.calls for clock in several)
        costs[name] = Cost(1e-3 * sum(clock.spent for clock in several) - counted * calls, calls)
    return Timed(whole - cost * sum(one.calls for one in costs.values()), costs)


def quickest(prepared: PreparedRun, parts: dict[str, list], repeats: int) -> Timed:
    """Of some runs the one that took least."""
    return min((clocked(prepared, parts) for _ in range(repeats)), key=lambda run: run.whole_us)


def in_core(prepared: PreparedRun, calls: int) -> dict[str, tuple[float, int]]:
    """Microseconds per call of each part that the core calls, and its calls in a tick."""
    assembly = prepared.assemble()
    with Recording(assembly) as recording:
        simulation, plant, steps = recording.simulation, assembly.plant, prepared.scenario.steps_per_tick
        simulation.begin()
        for _ in range(FIRST_TICKS):
            simulation.advance()
        step_s, flight, work = prepared.scenario.time_step_s, plant.integrator.motion.stepper, plant.balance.work
        filler, watched = simulation._log._rows.filler, simulation._watch.model
        law = assembly.controller.phases[0].law("").law_of_core()
        parts: dict[str, tuple[Callable[[], object], int]] = {
            "step and forward": (lambda: flight.step(step_s), steps),
            "OSDRE": (law.tick, 1),
            "actuators' limits": (plant.actuation._limits.apply, 1),
            "balance": (lambda: (work.open(), work.close(step_s)), steps),
            "row": (lambda: filler.fill(0, 0.0), 1),
            "watch for other contacts": (lambda: mujoco.mj_collision(watched, plant.data), 1 if watched else 0),
        }
        found = {name: (per_call(call, calls) if count else 0.0, count) for name, (call, count) in parts.items()}
        simulation.finish()
    return found


def per_call(call: Callable[[], object], calls: int) -> float:
    """Microseconds of one of many calls in a row, without what a call costs itself."""

    def spent(called: Callable[[], object]) -> float:
        start = time.perf_counter()
        for _ in range(calls):
            called()
        return 1e6 * (time.perf_counter() - start) / calls

    return spent(call) - spent(lambda: None)


def table(name: str, repeats: int) -> None:
    """Time a scenario, and print where the time went."""
    prepared = prepare(name)
    prepared.run()  # imports
    run, ticks = quickest(prepared, CLOCKED, repeats), prepared.scenario.ticks
    alone = [in_core(prepared, CALLS) for _ in range(repeats)]
    counts = {"us per tick": ticks}
    if steps(prepared) != ticks:
        counts = {"us per step": steps(prepared)} | counts
    print(f"{name:44}" + "".join(f"{head:>{WIDTH}}" for head in (*counts, "us per call")))

    def show(label: str, cost: Cost) -> None:
        cells = [f"{cost.spent_us / n:.1f}" if cost.calls else "" for n in (*counts.values(), cost.calls)]
        print(f"{label:44}" + "".join(f"{cell:>{WIDTH}}" for cell in cells))

    told = 0.0
    for part, (_, count) in alone[0].items():
        us = min(each[part][0] for each in alone)
        show(f"{part}, alone", Cost(us * count * ticks, count * ticks))
        told += us * count * ticks
    for part, cost in run.parts.items():
        if cost.calls:
            show(part, cost)
            told += 0.0 if part.startswith("of it") else cost.spent_us
    show("everything else", Cost(run.whole_us - told, ticks))
    show("everything", Cost(run.whole_us, ticks))


def main() -> None:
    """A table for each scenario."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenarios", nargs="*", default=["baseline", "spatial"])
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    for name in options.scenarios:
        table(name, options.repeats)
        print()


if __name__ == "__main__":
    main()
