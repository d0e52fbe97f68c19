"""A scenario that begins at a state of a log, written out as numbers that may be changed and dispersed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ffsm_mj.analysis.run import Run, load_run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.origin import INSTANT
from ffsm_mj.assembly.prepare import PreparedRun, prepare
from ffsm_mj.errors import InputError, working_on
from ffsm_mj.invocation import command
from ffsm_mj.log.run_folder import SCENARIO
from ffsm_mj.records.events import PhaseRecord
from ffsm_mj.records.signals import identifier
from ffsm_mj.scenario.phases import is_branching
from ffsm_mj.scenario.scenario import ScenarioConfig
from ffsm_mj.templates.robot import new_files, relative
from ffsm_mj.yaml import write_flow


def write_start(name: str, out: Path, folder: Path, at_s: float) -> list[str]:
    """Write a scenario that begins at the first control tick of a run at or after an instant.

    Args:
        name: Of the scenario.
        out: Folder to write to.
        folder: Run folder.
        at_s: The instant, s.

    Returns:
        Lines that tell what was written.

    Raises:
        InputError: The file exists, or a scenario cannot begin at this instant.
    """
    name, (path, *_) = new_files(name, out)
    if not (folder / SCENARIO).is_file():
        raise InputError(f"new: --from: {folder} is no run folder that can go on: it has no {SCENARIO}")
    with working_on(folder):
        before, run = prepare(folder / SCENARIO), load_run(folder)
        row = int(np.searchsorted(run.time, at_s - INSTANT * before.scenario.control_period_s))
        phase = _refused(run, before.scenario, row, f"new: --from: {at_s:g} s")
    now = float(run.time[row])
    kept = before.scenario.phases[phase.index :]
    lines = [
        f"# The state of {folder} at {now:g} s as a start. Control laws, estimator, sensors and delays begin anew here;",
        "# with 'initial: {from: ..., at_s: ...}' they would go on, but the state could not be changed.",
        f"extends: {write_flow(f'{relative(folder, out)}/{SCENARIO}')}",
        f"name: {write_flow(name)}",
        f"duration_s: {before.scenario.duration_s - now:.12g}",
        "initial:",
        *(["  from: null", "  at_s: null"] if before.scenario.initial.from_ is not None else []),
        *_state_lines(before, run, row),
        "phases: # the one under way, and those after it",
        f"  - {{name: {write_flow(phase.name)}{_left(kept[0].for_s, now - phase.start_s)}}}",
        *(f"  - {{name: {write_flow(after.name)}}}" for after in kept[1:]),
    ]
    out.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    try:
        prepare(path)
    except BaseException:  # a start that the scenario refuses, or an interruption: nothing is left of it
        path.unlink()
        raise
    return [
        f"files in {out}: {path.name}",
        f"begins at {now:g} s of {folder}, in phase {phase.name!r}; control laws, estimator, sensors and delays begin anew",
        f"next: {command('check', path)} && {command('run', path)}",
    ]


def _refused(run: Run, scenario: ScenarioConfig, row: int, what: str) -> PhaseRecord:
    """The phase under way in a row.

    Raises:
        InputError: There is no such row, or ``initial`` cannot express what there is.
    """
    if row == len(run.time) or not row:
        lasts = f"which lasts from {run.time[0]:g} to {run.time[-1]:g} s"
        raise InputError(f"{what} is not an instant after the start of the run, {lasts}")
    now, goes_on = run.time[row], "; 'initial: {from: RUN, at_s: TIME}' of a scenario goes on from there"
    closed = [one.grasp for one in run.grasps if one.time_s <= now and (one.release_s is None or one.release_s > now)]
    if closed:
        raise InputError(f"{what}: grasp {closed[0]!r} is closed, which no start can have; take an instant before{goes_on}")
    if scenario.environment is not None and scenario.environment.orbit is not None:
        raise InputError(f"{what}: with an orbit a start is at t = 0 of it{goes_on}")
    phase = [phase for phase in run.phases if phase.start_s <= now + INSTANT * scenario.control_period_s][-1]
    if phase.index and is_branching(scenario.phases):
        raise InputError(f"{what}: phase {phase.name!r} of phases that branch is not the first one{goes_on}")
    return phase


def _left(for_s: float | None, elapsed_s: float) -> str:
    """What is left of the duration of the phase under way, as a further key; empty if it has none, or all of it."""
    return f", for_s: {for_s - elapsed_s:.12g}" if for_s is not None and elapsed_s > 0.0 else ""


def _state_lines(before: PreparedRun, run: Run, row: int) -> Iterator[str]:
    """Coordinates, rates and activations, all digits; by the names that the scenario has for them, or full ones."""
    system, initial = before.system, before.scenario.initial
    used = {system.joint(name).name: name for part in (initial.joints, initial.rates) for name in part}
    joints = system.joints.values()
    actuators = system.names("actuator")
    used |= {actuators[system.index("actuator", name)]: name for name in initial.activations}
    parts = {
        "joints: # rad or m": {joint.name: run.qpos[row][joint.qpos] for joint in joints},
        "rates: # rad/s or m/s": {joint.name: run.qvel[row][joint.dofs] for joint in joints},
        "activations: # of servos": {name: _activation(run, row, name) for name in actuators},
    }
    for key, states in parts.items():
        values = {name: state.tolist() for name, state in states.items() if len(state)}
        yield from [f"  {key}"] if values else []
        for name, some in values.items():
            yield f"    {write_flow(used.get(name, name))}: {write_flow(some if len(some) > 1 else some[0])}"


def _activation(run: Run, row: int, actuator: str) -> FloatArray:
    """Activations of an actuator, (n,): none of a motor."""
    field = f"actuators.{identifier(actuator)}_activation"
    keys = [key for key in run.keys if key == field or key.removeprefix(f"{field}_").isdecimal()]
    return np.array([run[key][row] for key in keys])
