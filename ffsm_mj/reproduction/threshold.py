"""The baseline with the impact declared as the paper declares it: at the first control step with the tip within 1 mm.

Ours touches exactly when a gripper of 1 mm radius does, inside a step. Here the run is stopped at the first tick at or
after that, the impact is resolved there, at the tip, and the run goes on from the velocities after it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.assembly.prepare import prepare, run
from ffsm_mj.impact import Contact, Impact, resolve
from ffsm_mj.model.system import System
from ffsm_mj.reproduction.measure import Measures, impact_values, state_at, tip_state

_PERIOD_S = 1e-3


def threshold_impact(scenario: str) -> tuple[int, System, Any, Impact]:
    """Tick, model, state before and impact of a scenario under the paper's way of declaring it."""
    exact = run(scenario, {"stop_on_impact": True}).impacts[0].time_s
    ticks = math.ceil(exact / _PERIOD_S)
    system, data = _at_tick(scenario, ticks)
    bodies = system.index("body", "payload"), system.index("body", "box")
    impact = resolve(system.mj, data, [Contact(*bodies, tip_state(system, data)[0], np.array([-1.0, 0.0, 0.0]))])
    return ticks, system, data, impact


def run_with_threshold(scenario: str) -> Measures:
    """Measures of a scenario under the paper's way of declaring an impact."""
    ticks, system, data, impact = threshold_impact(scenario)
    impulse, (_, arm, _) = -float(impact.impulses[0]), tip_state(system, data)[0] - data.body("object/box").xpos
    error = _rest(scenario, ticks, system, data.qpos, impact.after.qvel).tip_error()
    return {
        "impact_time": ticks * _PERIOD_S,
        **impact_values(system, data, impact.after.qvel, impulse, -impulse * arm),
        "smallest_error": float(error.min()),
        "final_error": float(error[-1]),
    }


def _at_tick(scenario: str, ticks: int) -> tuple[System, Any]:
    """The state that the approach reaches at a tick when nothing is hit."""
    untouched = ["contacts.rules=[]", "phases.0.until=end", f"duration_s={ticks * _PERIOD_S:.9g}"]
    phase = prepare(scenario).scenario.phases[0].model_dump(mode="json", exclude_none=True)
    approach = prepare(scenario, [f"phases={[phase]}", *untouched])
    row = approach.run().log.rows[-1]
    system = approach.system
    nq, nv = system.mj.nq, system.mj.nv
    return system, state_at(system, row[1 : 1 + nq], row[1 + nq : 1 + nq + nv])


def _rest(scenario: str, ticks: int, system: System, qpos: Any, qvel: Any) -> Run:
    """The phases after the impact, from a state on; the gripper, which already overlaps the face, hits nothing any more."""
    whole = prepare(scenario).scenario
    phases = [phase.model_dump(mode="json", exclude_none=True) for phase in whole.phases[1:]]
    joints = {name: float(qpos[joint.qpos][0]) for name, joint in system.joints.items()}
    rates = {name: float(qvel[joint.dofs][0]) for name, joint in system.joints.items()}
    duration = whole.duration_s - ticks * _PERIOD_S
    return run(
        scenario,
        {
            "contacts": {"rules": []},
            "phases": phases,
            "duration_s": round(duration, 9),
            "initial": {"joints": joints, "rates": rates},
        },
    )
