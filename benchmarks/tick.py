"""Where the microseconds of a control tick go: every part of the loop timed in a whole run in memory.

``uv run --extra fast python benchmarks/tick.py [SCENARIO ...]`` prints a table of each scenario (`baseline` and `spatial`),
in plain Python and compiled (without the extra: in plain Python only): microseconds per step and per tick, where a tick has
more than one step, and per call of each part, since some are called in one phase only. An indented part is within the one
above it, and timed in a run of its own. Of several runs the least counts. What the clock itself costs is measured and taken
off.
"""

# ruff: noqa: E402

from __future__ import annotations

from ffsm_mj.cli.main import one_blas_thread

one_blas_thread()

import argparse
import time
from contextlib import ExitStack
from functools import partial
from typing import NamedTuple
from unittest.mock import patch

import twins
from ffsm_controllers.allocation import ThrusterAllocation, WheelAllocation
from ffsm_controllers.free_flying import FreeFlying
from ffsm_controllers.osdre.law import Osdre
from ffsm_controllers.osdre.riccati_doubling import Doubling
from ffsm_controllers.osdre.riccati_planar import PlanarRiccati
from loops import steps

from ffsm_mj.assembly.prepare import Prepared, prepare
from ffsm_mj.books.external_work import ExternalWork
from ffsm_mj.contact.course import Course
from ffsm_mj.contact.watch import ContactWatch
from ffsm_mj.log.recorder import Recorder
from ffsm_mj.plant.actuation import Actuation
from ffsm_mj.plant.ledger import Ledger
from ffsm_mj.simulation.rows import RowWriter

PARTS = {
    "step, forward and detection": [(Course, "advance")],
    "OSDRE": [(Osdre, "control")],
    "free-flying law": [(FreeFlying, "control")],
    "actuators' limits": [(Actuation, "apply")],
    "ledgers, start of a step": [(Ledger, "open")],
    "ledgers, end of a step": [(Ledger, "close")],
    "row and notes": [(RowWriter, "fill")],
    "watch for other contacts": [(ContactWatch, "look")],
    "energies, momenta, residuals, by blocks": [(Recorder, "commit")],
}
WITHIN = {"OSDRE": ["Riccati equation"], "free-flying law": ["allocation"], "ledgers, end of a step": ["push from outside"]}
INSIDE = {
    "Riccati equation": [(PlanarRiccati, "solve"), (Doubling, "solve")],
    "allocation": [(ThrusterAllocation, "efforts"), (WheelAllocation, "efforts")],
    "push from outside": [(ExternalWork, "close")],
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


def overhead_ns() -> float:
    """What a clock counts of itself, per call."""

    class Nothing:
        do = Clock(lambda _self: None)

    nothing, clock = Nothing(), Nothing.__dict__["do"]
    for _ in range(100_000):
        nothing.do()
    return clock.spent / clock.calls


class Cost(NamedTuple):
    """Of a part: microseconds in a whole run, and the calls that took them."""

    spent_us: float
    calls: int


def whole(prepared: Prepared, repeats: int) -> float:
    """Microseconds of a run without clocks, the least of some."""

    def once() -> float:
        start = time.perf_counter()
        prepared.run()
        return 1e6 * (time.perf_counter() - start)

    return min(once() for _ in range(repeats))


def each(prepared: Prepared, parts: dict[str, list], repeats: int) -> dict[str, Cost]:
    """What each part takes, the least of some runs."""
    runs = [clocked(prepared, parts) for _ in range(repeats)]
    return {name: min(run[name] for run in runs) for name in parts}


def clocked(prepared: Prepared, parts: dict[str, list]) -> dict[str, Cost]:
    """What each part takes of a run."""
    clocks = {name: [Clock(getattr(kind, method)) for kind, method in methods] for name, methods in parts.items()}
    with ExitStack() as patched:
        for name, methods in parts.items():
            for (kind, method), clock in zip(methods, clocks[name], strict=True):
                patched.enter_context(patch.object(kind, method, clock))
        prepared.run()
    own, costs = overhead_ns(), {}
    for name, several in clocks.items():
        calls = sum(clock.calls for clock in several)
        costs[name] = Cost(1e-3 * (sum(clock.spent for clock in several) - own * calls), calls)
    return costs


def table(name: str, repeats: int) -> None:
    """Time a scenario each way, and print where the time went."""
    prepared, ways = prepare(name), twins.ways()
    prepared.run()  # imports
    wholes = [way(partial(whole, prepared, repeats)) for way in ways.values()]
    parts = [way(partial(each, prepared, PARTS, repeats)) for way in ways.values()]
    inside = [way(partial(each, prepared, INSIDE, repeats)) for way in ways.values()]
    ticks = prepared.scenario.ticks
    counts = {"us per tick": ticks}
    if steps(prepared) != ticks:
        counts = {"us per step": steps(prepared)} | counts
    heads = [*counts, "us per call"]
    print(f"{name:44}" + "".join(f"{way:>{WIDTH * len(heads)}}" for way in ways))
    print(f"{'':44}" + "".join(f"{head:>{WIDTH}}" for head in heads * len(ways)))

    def show(label: str, costs: list[Cost]) -> None:
        cells = [f"{cost.spent_us / n:.1f}" if cost.calls else "" for cost in costs for n in (*counts.values(), cost.calls)]
        print(f"{label:44}" + "".join(f"{cell:>{WIDTH}}" for cell in cells))

    for part in PARTS:
        if any(costs[part].calls for costs in parts):
            show(part, [costs[part] for costs in parts])
            for label in WITHIN.get(part, ()):
                if any(costs[label].calls for costs in inside):
                    show(f"  of it {label}", [costs[label] for costs in inside])
    booked = [sum(cost.spent_us for cost in costs.values()) for costs in parts]
    show(
        "loop, phases, pause, calls", [Cost(total - of_parts, ticks) for total, of_parts in zip(wholes, booked, strict=True)]
    )
    show("everything", [Cost(total, ticks) for total in wholes])


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
