"""How well a run in real time keeps its pace on this machine: 60 s of ``free-flying-hardware`` at 1 kHz.

    uv run python benchmarks/real_time.py [SECONDS]

The run writes its log, as ``ffsm run --realtime`` does. The machine should have nothing else to do.
"""

from __future__ import annotations

import os
import sys
from tempfile import TemporaryDirectory

import numpy as np

import ffsm_mj
from ffsm_mj.analysis.pacing import Pacing

SHOWN = 5


def main() -> None:
    """Run, print the summary and the ticks that were latest."""
    duration_s = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    print(f"load of the machine over the last minute: {os.getloadavg()[0]:.2f} on {os.cpu_count()} cores")
    with TemporaryDirectory() as folder:
        run = ffsm_mj.run("free-flying-hardware", {"duration_s": duration_s, "realtime.factor": 1.0}, out=f"{folder}/run")
        pacing = Pacing.of(run)
        assert pacing is not None
        print(pacing.line())
        late_us = 1e6 * pacing.late_999_s, 1e6 * pacing.late_median_s
        print(f"99.9 % of the ticks at most {late_us[0]:.0f} us late, half at most {late_us[1]:.1f} us")
        busy = run["clock.busy_s"]
        print(f"a period takes {1e6 * np.median(busy):.0f} us to compute; the longest:")
        for row in np.argsort(busy)[: -SHOWN - 1 : -1]:
            print(f"  up to t = {run.time[row]:.3f} s: {1e3 * busy[row]:.2f} ms")


if __name__ == "__main__":
    main()
