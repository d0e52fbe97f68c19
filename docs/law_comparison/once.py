"""Single runs of the comparison: every law after one logged collision, and every law with the whole task."""

from __future__ import annotations

import json
import math
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from cells import CELLS, REACH_END_S
from floor import floor
from laws import LAWS, Config, Law
from table import Table

import ffsm_mj
from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray

ONCE = Path(__file__).parent / "once.json"
RESTART_S = 9.0
"""Instant in the safety pause at which the logged run goes on, s."""
END_S = 30.0
_EVERY = 50
"""Rows between two points of a curve."""


def compute_once(table: Table) -> None:
    """Compute and store the single runs: nominal ones, without dispersion."""
    tuned = {law.name: table.tuned("baseline", law.name) for law in LAWS}
    with TemporaryDirectory() as folder:
        log = Path(folder) / "run"
        before = ffsm_mj.run("baseline", out=log, rerun=False)
        told = _of_collision(before)
        found = {"restart": _restarts(log, tuned), "whole_task": {law.name: _whole_task(law) for law in LAWS}}
    ONCE.write_text(json.dumps(found | told, indent=1) + "\n")


def _of_collision(run: Run) -> Config:
    """Times of the collision, and the floor of the error after it."""
    times, start = np.arange(0.0, END_S, 0.05), run.phases[-1].start_s
    least = [round(float(value), 6) for value in floor(run, times) * (times >= start)]
    return {"impact_s": run.impacts[0].time_s, "start_s": start, "floor": least}


def read_once() -> Config:
    """The stored single runs."""
    return dict(json.loads(ONCE.read_text()))


def _restarts(log: Path, tuned: dict[str, tuple[float, float]]) -> dict[str, Config]:
    """Each law with default and tuned parameters, from one logged state in the pause after the impact."""
    cell, found = CELLS["baseline"], {}
    for law in LAWS:
        for variant, values in (("default", law.default), ("tuned", tuned[law.name])):
            given = {"phases.regulate.controller": cell.controller(law, values)}
            run = ffsm_mj.resume(log, RESTART_S, given)
            found[f"{law.name} {variant}"] = {
                "law_us_per_tick": round(1e6 * run.summary()["law_wall_s_per_tick"], 1),
                "errors": [round(float(value), 5) for value in run.tip_error()[::_EVERY]],
            }
    return found


def _whole_task(law: Law) -> Config:
    """The law with default parameters from the start to the end of ``baseline``."""
    controller = CELLS["baseline"].controller(law, law.default)
    if law.name == "osdre":
        given: Config = {}
    else:
        given = {f"phases.{phase}.controller": controller for phase in ("approach", "regulate")}
    run = ffsm_mj.run("baseline", given)
    hit = run.impacts[0] if run.impacts else None
    return {
        "outcome": run.outcome,
        "impacts": len(run.impacts),
        "time_s": _digits(hit.time_s if hit else math.nan),
        "approach_m_s": _digits(hit.approach_speed_m_s if hit else math.nan),
        "impulse_N_s": _digits(hit.impulse_N_s if hit else math.nan),
        "final_error_m": _digits(float(run.tip_error()[-1])),
        "overlaps": len(run.unhandled_contacts),
    }


def _digits(value: float) -> float | None:
    return float(f"{value:.6g}") if math.isfinite(value) else None


def curve(found: dict[str, Any]) -> tuple[FloatArray, FloatArray]:
    """Times, s, and errors, m, of a restarted run."""
    errors = np.array(found["errors"])
    return RESTART_S + 1e-3 * _EVERY * np.arange(len(errors)), errors


def restart_is_exact() -> float:
    """Largest difference of the coordinates of a restarted run from those of the whole run with that law, m and rad."""
    cell, law = CELLS["baseline"], LAWS[2]
    given = {"phases.regulate.controller": cell.controller(law, law.default), "duration_s": REACH_END_S}
    with TemporaryDirectory() as folder:
        log = Path(folder) / "run"
        ffsm_mj.run("baseline", {"duration_s": REACH_END_S}, out=log, rerun=False)
        rest: Run = ffsm_mj.resume(log, RESTART_S, given)
    whole = ffsm_mj.run("baseline", given)
    return float(np.abs(whole.qpos[-len(rest.qpos) :] - rest.qpos).max())
