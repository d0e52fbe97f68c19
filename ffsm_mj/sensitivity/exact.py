"""Exact derivatives of time and impulse of the first impact, where they exist.

They exist with respect to the restitution of the pair, and to the initial state of a run that coasts to the impact: the
change of the state there, from two free flights of displaced scenes, times the gradients of the linearized impact. What
control laws, thrusters and ends of phases do in between is a staircase of control ticks, and is refused by name.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.assembly.prepare import PreparedRun
from ffsm_mj.errors import InputError
from ffsm_mj.impact import Saltation, linearize
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.sensitivity.outcomes import Outcome, values
from ffsm_mj.sensitivity.parameters import Parameter
from ffsm_mj.sensitivity.result import Sensitivity

_GRADIENTS = {"impacts.0.time_s": "time", "impacts.0.impulse_N_s": "impulse"}
_STEP = 1e-6
"""Displacement of a coordinate: truncation 1e-12, rounding of a flight of some thousand steps 1e-13 / 1e-6."""


def exact(prepared: PreparedRun, nominal: Run, of: Sequence[Outcome], wrt: Sequence[Parameter]) -> Sensitivity:
    """Derivatives of outcomes.

    Raises:
        InputError: One of them does not exist, named.
        UnsupportedContactError: The impact has no derivative.
    """
    for outcome in of:
        if outcome.name not in _GRADIENTS:
            raise InputError(
                f"exact: {outcome.name} has no derivative here, only {', '.join(_GRADIENTS)}; use kind='secant'"
            )
    record, assembly = _first(nominal), prepared.assemble()
    pair = next(each for each in assembly.pairs if each.name == record.pair)
    data = assembly.data
    data.qpos[:] = record.qpos
    data.qvel[:] = np.concatenate([record.qvel_before[name] for name in assembly.system.joints])
    mujoco.mj_forward(assembly.system.mj, data)
    law = prepared.scenario.impact.law
    hit = linearize(assembly.system.mj, data, pair, restitution=record.restitution_used, mu=record.mu, law=law)
    columns = [_column(prepared, nominal, assembly, record, hit, of, parameter) for parameter in wrt]
    nothing = np.full((len(of), len(wrt)), np.nan)
    same, sides = tuple(True for _ in wrt), tuple("both" for _ in wrt)
    nominal_values = values(nominal, of)
    return Sensitivity("exact", tuple(of), tuple(wrt), nominal_values, nothing, nothing, np.array(columns).T, same, sides)


def _first(nominal: Run) -> ImpactRecord:
    """The first impact.

    Raises:
        InputError: There is none, or several contacts at once.
    """
    found = [record for record in nominal.impacts if record.event == 0]
    if len(found) != 1:
        raise InputError(f"exact: the first impact of the run has {len(found)} contacts; a derivative exists for one")
    if nominal.captures:
        raise InputError("exact: a grasp closes in the run; use kind='secant'")
    return found[0]


def _column(
    prepared: PreparedRun,
    nominal: Run,
    assembly: Assembly,
    record: ImpactRecord,
    hit: Saltation,
    of: Sequence[Outcome],
    parameter: Parameter,
) -> list[float]:
    """Derivatives of the outcomes by one parameter.

    Raises:
        InputError: They do not exist.
    """
    names = [_GRADIENTS[outcome.name] for outcome in of]
    part, _, rest = parameter.target.key.partition(".")
    if part == "contacts" and rest.endswith("restitution"):
        if not _is_of(prepared, parameter, record):
            return [0.0 for _ in names]
        return [hit.impulse_by_restitution if name == "impulse" else 0.0 for name in names]
    if part != "initial":
        raise InputError(
            f"exact: no derivative by {parameter.key}, only by initial and contacts.*.restitution; use kind='secant'"
        )
    _refuse_control(nominal, record)
    change = _flown(prepared, assembly, record.time_s, parameter)
    return [float(getattr(hit, name) @ change) for name in names]


def _is_of(prepared: PreparedRun, parameter: Parameter, record: ImpactRecord) -> bool:
    """Whether a restitution is that of the rule of an impact."""
    parts = parameter.target.key.split(".")
    rules = prepared.scenario.contacts.rules or ()
    if parts[1] != "rules":
        raise InputError(f"exact: no derivative by {parameter.key}: name the restitution of a rule; use kind='secant'")
    names = [each.name for each in prepared.assemble().contacts.rules]
    return int(parts[2]) < len(rules) and names[int(parts[2])] == record.rule


def _refuse_control(nominal: Run, record: ImpactRecord) -> None:
    """Refuse runs in which a control law acts before the impact.

    Raises:
        InputError: The law and its phase.
    """
    for phase in nominal.phases:
        if phase.start_s < record.time_s and phase.controller != "off":
            raise InputError(
                f"exact: {phase.controller} of phase {phase.name!r} acts before the impact at {record.time_s:.6g} s: "
                "its efforts change at control ticks, no derivative is computed; use kind='secant'"
            )


def _flown(prepared: PreparedRun, assembly: Assembly, time_s: float, parameter: Parameter) -> FloatArray:
    """Change of the state just before the impact per unit of an initial coordinate or rate, (2 nv,)."""
    model, ends = assembly.system.mj, []
    for sign in (-1.0, 1.0):
        changed = prepared.changed(prepared.source.overridden([parameter.override(sign * _STEP)])).assemble()
        ends.append(_flight(model, changed.data, time_s, prepared.scenario.time_step_s))
    (low_q, low_v), (high_q, high_v) = ends
    dq = np.empty(model.nv)
    mujoco.mj_differentiatePos(model, dq, 2.0 * _STEP, low_q, high_q)
    return np.concatenate((dq, (high_v - low_v) / (2.0 * _STEP)))


def _flight(model: Any, data: Any, time_s: float, step_s: float) -> tuple[FloatArray, FloatArray]:
    """State after free flight for a time, without contacts or efforts."""
    steps = round(time_s / step_s - 0.5)
    own = mujoco.MjData(model)
    own.qpos[:], own.qvel[:] = data.qpos, data.qvel
    before = model.opt.timestep
    try:
        for duration in (*[step_s] * steps, time_s - steps * step_s):
            model.opt.timestep = duration
            if duration > 0.0:
                mujoco.mj_step(model, own)
    finally:
        model.opt.timestep = before
    return np.array(own.qpos), np.array(own.qvel)
