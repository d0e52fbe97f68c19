"""Cost of stepping: a run in one go, the same by ``Simulator.step`` tick by tick, and reset, get_state and set_state.

``uv run python benchmarks/stepping.py``: process time, the best of several
interleaved runs. Both simulate the baseline for 10 s at ticks of 1 ms, in memory, from a scenario that is compiled once.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare

SCENARIO, SETTINGS = "baseline", {"duration_s": 10.0}


def seconds(part: Callable[[], object]) -> float:
    """Process time of a part."""
    began = time.process_time()
    part()
    return time.process_time() - began


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--repeats", type=int, default=9, help="runs of each kind")
    repeats = parser.parse_args().repeats
    prepared, simulator = prepare(SCENARIO, SETTINGS), ffsm_mj.Simulator(SCENARIO, SETTINGS)

    def whole() -> None:
        assert prepared.run().outcome == "completed"

    def steps() -> None:
        simulator.reset()
        while not simulator.step().ended:
            pass
        simulator.close()

    whole()
    times = [(seconds(whole), seconds(steps)) for _ in range(repeats)]
    run_s, steps_s = (min(each) for each in zip(*times, strict=True))
    ticks = prepared.scenario.ticks
    print(f"{1e6 * run_s / ticks:.1f} us per tick in one go,", end=" ")
    print(f"{1e6 * (steps_s - run_s) / ticks:.1f} us more per step, ratio {steps_s / run_s:.3f}")
    alone = ffsm_mj.Simulator(SCENARIO, SETTINGS, record=False)
    resets = [seconds(alone.reset) for _ in range(repeats)]
    alone.step(until=8.0)
    state = alone.get_state()
    saves = [seconds(alone.get_state) for _ in range(repeats)]
    restores = [seconds(lambda: alone.set_state(state)) for _ in range(repeats)]
    told = f"reset {1e3 * min(resets):.0f} ms, get_state {1e3 * min(saves):.2f} ms of {len(state.to_bytes()) / 1e3:.0f} kB"
    print(f"{told}, set_state {1e3 * min(restores):.2f} ms")


if __name__ == "__main__":
    main()
