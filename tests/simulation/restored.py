"""Runs that go on from states: in this process, or in one that knows only the bytes of the states."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

import ffsm_mj

DURATIONS_S = {
    "air-bearing": 1.5,
    "baseline": 8.2,
    "berth": 14.0,
    "capture": 24.0,
    "capture-camera": 24.0,
    "capture-detumble": 24.0,
    "capture-flexible": 18.5,
    "capture-orbit": 16.0,
    "capture-planar": 8.2,
    "free-flying": 8.2,
    "free-flying-hardware": 8.2,
    "gripper-2f85": 0.12,
    "no-actuation": 8.2,
    "push": 9.0,
    "servo-arm": 0.3,
    "slow-impact": 14.0,
    "spatial": 3.0,
    "tap": 1.0,
}
"""Enough of a scenario for its events, s; others last as long as they are."""


def overrides(scenario: str, *, whole: bool = False) -> dict[str, Any]:
    """Overrides of a scenario: shorter runs, unless whole ones are asked for."""
    return {"duration_s": DURATIONS_S[scenario]} if scenario in DURATIONS_S and not whole else {}


def told(run: Any) -> dict[str, Any]:
    """What a run says: its rows, its events but the beginnings of phases, the reports of its phases, how it ended."""
    events = [repr(each) for each in run.log.events if type(each).__name__ != "PhaseRecord"]
    summary = run.summary()
    reports = {each["name"]: each["reports"] for each in summary["controller"]["phases"]}
    ended = [run.outcome, summary["sub_steps"], summary["smallest_step_s"]]
    return {"rows": np.array(run.log.rows[:]), "events": events, "reports": reports, "ended": ended}


def rest(scenario: str, given: dict[str, Any], state: bytes) -> dict[str, Any]:
    """What the rest of a run says, from a state on."""
    simulator = ffsm_mj.Simulator(scenario, given)
    simulator.set_state(ffsm_mj.SimulatorState.from_bytes(state))
    while not simulator.ended:
        simulator.step()
    return told(simulator.close())


def is_rest_of(whole: dict[str, Any], part: dict[str, Any]) -> bool:
    """Whether a part of a run is the end of a whole one, bit for bit."""
    rows, events = part["rows"], part["events"]
    same = np.array_equal(whole["rows"][-len(rows) :], rows, equal_nan=True) if len(rows) else False
    same &= whole["events"][len(whole["events"]) - len(events) :] == events
    same &= all(json.dumps(whole["reports"][name]) == json.dumps(each) for name, each in part["reports"].items())
    return bool(same and whole["ended"] == part["ended"])


def main(folder: Path) -> None:
    """Simulate on from the states of a folder; write what the runs say beside them."""
    job = json.loads((folder / "job.json").read_text())
    for file in sorted(folder.glob("*.state")):
        part = rest(job["scenario"], job["overrides"], file.read_bytes())
        np.save(file.with_suffix(".npy"), part.pop("rows"))
        file.with_suffix(".json").write_text(json.dumps(part))


if __name__ == "__main__":
    main(Path(sys.argv[1]))


def goes_on(path, at_s):
    """What a run tells, and what one tells that goes on from bytes of its state at a time, s."""
    with ffsm_mj.Simulator(path) as simulator:
        simulator.reset()
        while simulator.time_s < at_s:
            simulator.step()
        state = simulator.get_state().to_bytes()
        while not simulator.ended:
            simulator.step()
        whole = told(simulator.close())
    return whole, rest(path, {}, state)
