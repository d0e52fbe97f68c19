"""The runs of the page: the paper's four, and those of the study of what the paper leaves open.

The paper declares the impact at the first control step with the tip within 1 mm of the face. Ours touches exactly when a
gripper of 1 mm radius does, inside a step. A run with ``threshold`` is stopped at the first tick at or after that, the
impact is resolved there, at the tip, and the run goes on from the velocities after it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.prepare import prepare, run, uninterrupted
from ffsm_mj.dynamics.rigid_body import kinetic_energy, mass_matrix
from ffsm_mj.impact import Contact, Impact, resolve
from ffsm_mj.model.system import System
from ffsm_mj.records.events import ImpactRecord

Measures = dict[str, float]


def measure(run: Run, system: System) -> Measures:
    """Values by key, in SI units (``_mm`` in mm, ``error_by_path`` in %); those of an impact only where there is one.

    Args:
        run: A run of one of the paper's scenarios.
        system: Its model.
    """
    error = run.tip_error()
    closest = int(np.argmin(error))
    values = {
        "initial_error": float(error[0]),
        "smallest_error": float(error[closest]),
        "final_error": float(error[-1]),
        "final_error_mm": 1e3 * float(error[-1]),
        "error_by_path": 100.0 * float(error[closest]) / _path(run, closest),
    }
    if run.impacts:
        values |= _impact(run.impacts[0], system) | _after(run)
    return values


def state_at(system: System, qpos: Any, qvel: Any) -> Any:
    """MuJoCo data at a state, everything derived current."""
    data = mujoco.MjData(system.mj)
    data.qpos[:], data.qvel[:] = qpos, qvel
    mujoco.mj_forward(system.mj, data)
    return data


def state_before(record: ImpactRecord, system: System) -> Any:
    """MuJoCo data at the instant of an impact, just before it."""
    return state_at(system, record.qpos, _qvel(record.qvel_before, system))


def _qvel(by_joint: Mapping[str, tuple[float, ...]], system: System) -> FloatArray:
    """Generalised velocities in the model's order; a log does not keep the order of names."""
    qvel = np.empty(system.mj.nv)
    for name, values in by_joint.items():
        qvel[system.joint(name).dofs] = values
    return qvel


def tip_state(system: System, data: Any) -> tuple[Any, Any]:
    """Position in m and velocity in m/s of the tip, in world axes."""
    site = system.index("site", "tip")
    jacobian = np.empty((3, system.mj.nv))
    mujoco.mj_jacSite(system.mj, data, jacobian, None, site)
    return data.site_xpos[site].copy(), jacobian @ data.qvel


def slope(system: System, data: Any) -> Any:
    """Velocities of the robot per unit of the paper's I_e,n, -M^-1 J^T e_x as in (35): its impulse acts on the object."""
    jacobian = np.empty((3, system.mj.nv))
    mujoco.mj_jacSite(system.mj, data, jacobian, None, system.index("site", "tip"))
    dofs = system.robot.dofs
    return -np.linalg.solve(mass_matrix(system.mj, data)[dofs, dofs], jacobian[0, dofs])


def _impact(record: ImpactRecord, system: System) -> Measures:
    after = _qvel(record.qvel_after, system)
    return {"impact_time": record.time_s} | impact_values(
        system, state_before(record, system), after, record.impulse_N_s * record.normal[0], record.angular_impulse_N_m_s[2]
    )


def impact_values(system: System, data: Any, after: Any, impulse: float, angular_impulse: float) -> Measures:
    """What the paper prints of an impact.

    Args:
        system: The model.
        data: The state before.
        after: Generalised velocities after, robot then object.
        impulse: On the object along +x, the paper's I_e,n, N s.
        angular_impulse: On the object about its centre of mass, N m s.
    """
    tip, velocity = tip_state(system, data)
    values = {
        "tip_x": tip[0],
        "tip_y": tip[1],
        "tip_vx": velocity[0],
        "tip_vy": velocity[1],
        "impulse": impulse,
        "angular_impulse": angular_impulse,
        "energy": kinetic_energy(mass_matrix(system.mj, data), data.qvel),
        "object_vx": after[6],
        "object_vy": after[7],
        "object_yaw_rate": after[8],
    }
    for key, numbers in (("before", data.qvel[:6]), ("slope", slope(system, data)), ("after", after[:6])):
        values |= {f"{key}_{i}": number for i, number in enumerate(numbers)}
    return {key: float(value) for key, value in values.items()}


def _after(run: Run) -> Measures:
    """The ways that object and base went over the whole run, and the momenta of the last phase."""
    last = run["phase.index"] == run["phase.index"][-1]
    momenta = [run[f"momentum.robot_{component}"][last] for component in ("P_x_N_s", "P_y_N_s", "L_z_N_m_s")]
    return {
        "object_way": float(run["state.q_object_x_m"][0] - run["state.q_object_x_m"][-1]),
        "base_way": float(run["state.q_robot_base_x_m"][-1] - run["state.q_robot_base_x_m"][0]),
        "P_after_pause": float(np.hypot(momenta[0][-1], momenta[1][-1])),
        "L_after_pause": float(momenta[2][-1]),
    }


def _path(run: Run, end: int) -> float:
    """Length of the tip's path up to a row, m."""
    steps = np.diff(np.column_stack([run[f"state.tip_{axis}_m"][: end + 1] for axis in "xy"]), axis=0)
    return float(np.linalg.norm(steps, axis=1).sum())


SCENARIOS = ("baseline", "no-actuation", "free-flying", "slow-impact")
STEPS_S = (1e-3, 5e-4, 2.5e-4)
_PERIOD_S = 1e-3


@dataclass(frozen=True)
class PaperRun:
    """One run.

    Attributes:
        scenario: A shipped scenario.
        overrides: ``key=value`` as on the command line.
        threshold: Declare the impact as the paper does.
        keep: The run itself is needed, not only its measures.
    """

    scenario: str
    overrides: tuple[str, ...] = ()
    threshold: bool = False
    keep: bool = False


@dataclass(frozen=True)
class Result:
    """Measures of a run, and the run where it is to be kept."""

    values: Measures
    run: Run | None = None

    @property
    def kept(self) -> Run:
        """The run, which was to be kept."""
        if self.run is None:
            raise ValueError("this run was not to be kept")
        return self.run


def paper_run(scenario: str, step_s: float = 1e-3, period_s: float = 1e-3) -> PaperRun:
    """One of the paper's runs; the run itself is kept at the paper's steps."""
    keep = (step_s, period_s) == (1e-3, 1e-3)
    return PaperRun(scenario, (f"time_step_s={step_s}", f"control_period_s={period_s}"), keep=keep)


_LONG = "duration_s=120.0"
_VELOCITY = tuple(f"phases.{i}.controller.parameterization=velocity" for i in (0, 2))
_NO_THRUSTERS = ("phases.1.for_s=2.3", "phases.1.controller={kind: off}")

THRESHOLD = PaperRun("baseline", threshold=True)
VELOCITY = PaperRun("baseline", _VELOCITY, keep=True)
LONG_RUNS = {
    "baseline, no thrusters": PaperRun("baseline", (_LONG,), keep=True),
    "slow impact, no thrusters": PaperRun("slow-impact", (_LONG, *_NO_THRUSTERS), keep=True),
    "free-flying: thrusters in the pause, then at rest": PaperRun("free-flying", (_LONG,), keep=True),
}


def hold_runs(scenario: str) -> tuple[PaperRun, ...]:
    """Runs over the step sizes with the control period of the paper, its 1 ms first."""
    return tuple(paper_run(scenario, step) for step in STEPS_S)


def decided_runs(scenario: str) -> tuple[PaperRun, ...]:
    """Runs over the step sizes in which the controller decides at every step, the paper's 1 ms first."""
    return tuple(paper_run(scenario, step, step) for step in STEPS_S)


def all_runs() -> tuple[PaperRun, ...]:
    """Every run of the page, the long ones first so that no core idles at the end."""
    decided = [run for name in SCENARIOS for run in decided_runs(name)[1:]]
    return (*LONG_RUNS.values(), *reversed(decided), THRESHOLD, VELOCITY, *(r for s in SCENARIOS for r in hold_runs(s)))


def perform(paper: PaperRun) -> Result:
    """Make a run."""
    if paper.threshold:
        return Result(_with_threshold(paper.scenario))
    prepared = prepare(paper.scenario, paper.overrides)
    finished = uninterrupted(prepared.run())
    return Result(measure(finished, prepared.system), finished if paper.keep else None)


def threshold_impact(scenario: str) -> tuple[int, System, Any, Impact]:
    """Tick, model, state before and impact of a scenario in which the impact is declared as the paper does."""
    exact = run(scenario, {"stop_on_impact": True}).impacts[0].time_s
    ticks = math.ceil(exact / _PERIOD_S)
    system, data = _at_tick(scenario, ticks)
    bodies = system.index("body", "payload"), system.index("body", "box")
    impact = resolve(system.mj, data, [Contact(*bodies, tip_state(system, data)[0], np.array([-1.0, 0.0, 0.0]))])
    return ticks, system, data, impact


def _with_threshold(scenario: str) -> Measures:
    ticks, system, data, impact = threshold_impact(scenario)
    impulse, (_, arm, _) = -float(impact.impulses[0]), tip_state(system, data)[0] - data.body("object/box").xpos
    error = _after_impact(scenario, ticks, system, data.qpos, impact.after.qvel).tip_error()
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
    row = uninterrupted(approach.run()).log.rows[-1]
    system = approach.system
    nq, nv = system.mj.nq, system.mj.nv
    return system, state_at(system, row[1 : 1 + nq], row[1 + nq : 1 + nq + nv])


def _after_impact(scenario: str, ticks: int, system: System, qpos: Any, qvel: Any) -> Run:
    """The phases after the impact, from a state on; the gripper, which already overlaps the face, hits nothing any more."""
    whole = prepare(scenario).scenario
    overrides = {
        "contacts": {"rules": []},
        "phases": [phase.model_dump(mode="json", exclude_none=True) for phase in whole.phases[1:]],
        "duration_s": round(whole.duration_s - ticks * _PERIOD_S, 9),
        "initial": {
            "joints": {name: float(qpos[joint.qpos][0]) for name, joint in system.joints.items()},
            "rates": {name: float(qvel[joint.dofs][0]) for name, joint in system.joints.items()},
        },
    }
    return uninterrupted(run(scenario, overrides))
