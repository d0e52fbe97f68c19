"""How well a run in real time keeps its pace on this machine: 60 s of ``free-flying-hardware`` at 1 kHz.

    uv run python benchmarks/real_time.py [SECONDS]

The run writes its log, as ``ffsm run --realtime`` does. The machine should have nothing else to do; what it can do at best
is measured first, by a loop of the same length that only waits.
"""

from __future__ import annotations

import os
import sys
from tempfile import TemporaryDirectory

import numpy as np

import ffsm_mj
from ffsm_mj.analysis.pacing import Pacing
from ffsm_mj.simulation.wall_clock import WallClock

SHOWN = 5
PERIOD_S = 1e-3
PROMPT_S = 1e-4


def idle_late_s(duration_s: float) -> np.ndarray:
    """How late the ticks of a loop begin that does nothing in them, s."""
    clock = WallClock(1.0, None, PERIOD_S)
    late = np.zeros(round(duration_s / PERIOD_S))
    clock.begin(0.0)
    for tick in range(1, len(late)):
        clock.wait(tick * PERIOD_S, lambda: None)
        late[tick] = clock.columns.live[0]
    return late


def main() -> None:
    """Run, print the summary and the ticks that were latest."""
    duration_s = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    print(f"load of the machine over the last minute: {os.getloadavg()[0]:.2f} on {os.cpu_count()} cores")
    late = idle_late_s(duration_s)
    print(f"a loop that only waits: {100.0 * np.mean(late <= PROMPT_S):.4g} % of its ticks within 100 us, ", end="")
    print(f"99.9 % at most {1e6 * np.quantile(late, 0.999):.0f} us late, the latest {1e3 * late.max():.3g} ms")
    with TemporaryDirectory() as folder:
        run = ffsm_mj.run("free-flying-hardware", {"duration_s": duration_s, "realtime.factor": 1.0}, out=f"{folder}/run")
        pacing = Pacing.of(run)
        assert pacing is not None
        print(pacing.line())
        late_us = 1e6 * pacing.late_999_s, 1e6 * pacing.late_median_s
        print(f"99.9 % of the ticks at most {late_us[0]:.0f} us late, half at most {late_us[1]:.1f} us")
        busy, time = run["clock.busy_s"], run.time
        of_events = np.searchsorted(time, [event.time_s for event in run.impacts])
        overruns = np.flatnonzero(np.diff(run["clock.overruns"], prepend=0.0))
        print(f"overruns in periods without an impact: {len(set(overruns.tolist()) - set(of_events.tolist()))}")
        print(f"a period takes {1e6 * np.median(busy):.0f} us to compute; the longest:")
        for row in np.argsort(busy)[: -SHOWN - 1 : -1]:
            print(f"  up to t = {time[row]:.3f} s: {1e3 * busy[row]:.2f} ms{' (impact)' if row in of_events else ''}")


if __name__ == "__main__":
    main()
