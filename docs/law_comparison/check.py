"""The short comparison that ``--check`` repeats: a changed law, motor or integrator moves its numbers.

Eight points of each law on the window of the baseline, without dispersion, at 5 ms in place of 1 ms. Costs at 5 ms are not
those of the page: laws that chatter lose at the longer period. They are as sensitive to the formulas.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path

from cells import CELLS
from laws import LAWS, Config
from rows import metrics_of, points

import ffsm_mj
from ffsm_mj.all_cores import on_all_cores

CHECKED = Path(__file__).parent / "check.json"
POINTS = 8
_COARSE = {"duration_s": 22.575, "time_step_s": 0.005, "control_period_s": 0.005}
METRICS = ("cost", "error_integral", "effort_integral", "least_error", "impulse")
_TOLERANCE = 1e-6
"""Relative. Other compilers agree to 1e-9; a gain 0.1 % higher changes costs by more than 1e-6."""
_CHATTERING = {"sdre 1": 0.05, "sdre 7": 0.05}
"""Points with gains so high that torques held for 5 ms chatter between their bounds: rounding grows to 4e-3 there."""


def computed() -> dict[str, Config]:
    """Metrics by law and point."""
    wanted = [(law, number) for law in range(len(LAWS)) for number in range(POINTS)]
    return {
        f"{LAWS[law].name} {number}": found for (law, number), found in zip(wanted, on_all_cores(_at, wanted), strict=True)
    }


def _at(wanted: tuple[int, int]) -> Config:
    """Metrics of a law, by its index, at the point of a number."""
    cell, (law, number) = CELLS["baseline"], wanted
    controller = cell.controller(LAWS[law], LAWS[law].at(points(POINTS)[number]))
    run = ffsm_mj.run(cell.scenario, _COARSE | {"phases.regulate.controller": controller})
    metrics = metrics_of(run)
    return {"outcome": run.outcome} | {name: metrics[name] for name in METRICS}


def write_check() -> None:
    """Compute and store them."""
    lines = ",\n".join(f"{json.dumps(key)}: {json.dumps(value)}" for key, value in computed().items())
    CHECKED.write_text(f"{{\n{lines}\n}}\n")


def differences() -> Iterator[str]:
    """What differs from the stored numbers, a line each."""
    stored = json.loads(CHECKED.read_text())
    now = computed()
    for name in sorted(stored.keys() ^ now.keys()):
        yield f"{name}: is stored or computed, not both"
    for name in (name for name in now if name in stored):
        if stored[name]["outcome"] != now[name]["outcome"]:
            yield f"{name}: outcome {now[name]['outcome']}, stored {stored[name]['outcome']}"
        tolerance = _CHATTERING.get(name, _TOLERANCE)
        for metric in METRICS:
            before, after = stored[name][metric], now[name][metric]
            if not math.isclose(before, after, rel_tol=tolerance):
                yield f"{name}: {metric} {after:.8g}, stored {before:.8g} (tolerance {tolerance:g})"
