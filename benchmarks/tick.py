"""Where the microseconds of a control tick go: every part of the loop timed in a whole run in memory.

``uv run python benchmarks/tick.py [SCENARIO ...]`` prints a table of each scenario (`baseline` and `spatial`),
microseconds per step and per tick, where a tick has more than one step, and per call of each part, since some are called in
one phase only. An indented part is within the one above it, and timed in a run of its own. Of several runs the quickest
counts. What the clocks cost is measured and taken off.
"""

# ruff: noqa: E402

from __future__ import annotations

from ffsm_mj.cli.main import one_blas_thread

one_blas_thread()

import argparse
import time
from contextlib import ExitStack
from operator import methodcaller
from typing import NamedTuple
from unittest.mock import patch

from loops import steps

from ffsm_controllers.allocation import ThrusterAllocation, WheelAllocation
from ffsm_controllers.free_flying import FreeFlying
from ffsm_controllers.osdre.law import Osdre
from ffsm_mj.actuation.actuation import Actuation
from ffsm_mj.assembly.prepare import PreparedRun, prepare
from ffsm_mj.balance.balance import Balance
from ffsm_mj.balance.base_motors import BaseMotors
from ffsm_mj.balance.thrusters import Thrusters
from ffsm_mj.contact.watch import ContactWatch
from ffsm_mj.log.recorder import Recorder
from ffsm_mj.simulation.integrator import EventDrivenIntegrator
from ffsm_mj.simulation.rows import RowWriter

PARTS = {
    "step, forward and detection": [(EventDrivenIntegrator, "advance")],
    "OSDRE": [(Osdre, "control")],
    "free-flying law": [(FreeFlying, "control")],
    "actuators' limits": [(Actuation, "apply")],
    "balances, start of a step": [(Balance, "open")],
    "balances, end of a step": [(Balance, "close")],
    "row and notes": [(RowWriter, "fill")],
    "watch for other contacts": [(ContactWatch, "look")],
    "energies, momenta, residuals, by blocks": [(Recorder, "commit")],
}
WITHIN = {"free-flying law": ["allocation"], "balances, end of a step": ["push from outside"]}
INSIDE = {
    "allocation": [(ThrusterAllocation, "efforts"), (WheelAllocation, "efforts")],
    "push from outside": [(Thrusters, "close"), (BaseMotors, "close")],
}
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


def table(name: str, repeats: int) -> None:
    """Time a scenario, and print where the time went."""
    prepared = prepare(name)
    prepared.run()  # imports
    run, inside = quickest(prepared, PARTS, repeats), quickest(prepared, INSIDE, repeats).parts
    ticks = prepared.scenario.ticks
    counts = {"us per tick": ticks}
    if steps(prepared) != ticks:
        counts = {"us per step": steps(prepared)} | counts
    print(f"{name:44}" + "".join(f"{head:>{WIDTH}}" for head in (*counts, "us per call")))

    def show(label: str, cost: Cost) -> None:
        cells = [f"{cost.spent_us / n:.1f}" if cost.calls else "" for n in (*counts.values(), cost.calls)]
        print(f"{label:44}" + "".join(f"{cell:>{WIDTH}}" for cell in cells))

    for part in PARTS:
        if run.parts[part].calls:
            show(part, run.parts[part])
            for label in WITHIN.get(part, ()):
                if inside[label].calls:
                    show(f"  of it {label}", inside[label])
    show("loop, phases, pause, calls", Cost(run.whole_us - sum(cost.spent_us for cost in run.parts.values()), ticks))
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
