"""Where the microseconds of a control tick go: every part of the loop timed in a whole run of the baseline, in memory.

``uv run --extra fast python benchmarks/tick.py`` prints microseconds per tick, in plain Python and compiled (without the
extra: in plain Python only). What the clock itself costs is measured and taken off.
"""

# ruff: noqa: E402

from __future__ import annotations

from ffsm_mj.cli.main import one_blas_thread

one_blas_thread()

import os
import time
from unittest.mock import patch

from ffsm_controllers.osdre.law import Osdre
from ffsm_controllers.osdre.riccati_planar import PlanarRiccati

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.compiled import is_compiled
from ffsm_mj.contact.course import Course
from ffsm_mj.contact.watch import ContactWatch
from ffsm_mj.log.recorder import Recorder
from ffsm_mj.plant.actuation import Actuation
from ffsm_mj.plant.ledger import Ledger
from ffsm_mj.simulation.rows import RowWriter

PARTS = {
    "step, forward and detection": (Course, "advance"),
    "OSDRE": (Osdre, "control"),
    "actuators' limits": (Actuation, "apply"),
    "ledgers, start of a step": (Ledger, "open"),
    "ledgers, end of a step": (Ledger, "close"),
    "row and notes": (RowWriter, "fill"),
    "watch for other contacts": (ContactWatch, "look"),
    "energies, momenta, residuals, by blocks": (Recorder, "commit"),
}
INSIDE = {"  of OSDRE: Riccati equation": (PlanarRiccati, "solve")}


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


def timed(parts) -> tuple[dict[str, float], float]:
    """Microseconds per tick of each part, and of everything, from two runs: with clocks and without."""
    prepared = prepare("baseline")
    ticks = prepared.scenario.ticks
    start = time.perf_counter()
    prepared.run()
    total = 1e6 * (time.perf_counter() - start) / ticks
    clocks = {name: Clock(getattr(kind, method)) for name, (kind, method) in parts.items()}
    patches = [patch.object(kind, method, clocks[name]) for name, (kind, method) in parts.items()]
    for one in patches:
        one.start()
    try:
        prepare("baseline").run()
    finally:
        for one in patches:
            one.stop()
    own = overhead_ns()
    return {name: 1e-3 * (clock.spent - own * clock.calls) / ticks for name, clock in clocks.items()}, total


def main() -> None:
    """Time both ways and print a table."""
    ways = {"plain": "0", "compiled": "1"} if is_compiled() else {"plain": "0"}
    columns, totals = {}, {}
    for way, switch in ways.items():
        os.environ["FFSM_COMPILED"] = switch
        timed(PARTS)
        columns[way], totals[way] = timed(PARTS)
        if way == "plain":  # the compiled solver is inside the compiled law
            columns[way] |= timed(INSIDE)[0]
    print(f"{'us per tick':42}" + "".join(f"{way:>10}" for way in ways))
    for name in (*list(PARTS)[:2], *INSIDE, *list(PARTS)[2:]):
        print(f"{name:42}" + "".join(f"{columns[way][name]:10.1f}" if name in columns[way] else f"{'':10}" for way in ways))
    rest = {way: totals[way] - sum(columns[way][name] for name in PARTS) for way in ways}
    print(f"{'loop, phases, pause, calls':42}" + "".join(f"{rest[way]:10.1f}" for way in ways))
    print(f"{'everything':42}" + "".join(f"{totals[way]:10.1f}" for way in ways))


if __name__ == "__main__":
    main()
