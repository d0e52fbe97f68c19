"""What ``accuracy: 1e-9`` costs, as ratios of CPU time within one run: ``uv run python benchmarks/accuracy.py``.

Shipped scenarios against themselves without it, at their own step; ``spatial`` at steps of 10 ms, too long for it, against
the fixed step of 0.5 ms by which it passes as well.
"""

from __future__ import annotations

import statistics
import time
from typing import Any

from ffsm_mj.assembly.prepare import prepare

REPEATS = 3
COARSE = {"time_step_s": 0.01, "control_period_s": 0.01}
FINE = {"time_step_s": 0.0005, "control_period_s": 0.01}


def seconds(scenario: str, **keys: Any) -> float:
    """CPU time of a run in memory."""
    recipe = prepare(scenario, {"duration_s": 5.0, **keys})
    start = time.process_time()
    recipe.run()
    return time.process_time() - start


def ratio(scenario: str, with_it: dict[str, Any], without: dict[str, Any]) -> float:
    """Median over interleaved repeats."""
    pairs = [(seconds(scenario, **with_it, accuracy=1e-9), seconds(scenario, **without)) for _ in range(REPEATS)]
    return statistics.median(a / b for a, b in pairs)


if __name__ == "__main__":
    for name in ("baseline", "spatial", "free-flying-hardware", "capture", "tap"):
        print(f"{name}: {ratio(name, {}, {}):.2f} times the run without accuracy")
    print(f"spatial at 10 ms: {ratio('spatial', COARSE, FINE):.2f} times the run at 0.5 ms without")
