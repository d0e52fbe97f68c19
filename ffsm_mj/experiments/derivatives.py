"""Exact derivatives of time and impulse of the first impact, or of time and loss of the first closing of a grasp.

They exist with respect to the restitution of the pair, and to the initial state of a run that coasts to the event: the
change of the state there, from two free flights of displaced scenes, times the gradients of the linearized event. What
control laws, thrusters and ends of phases do in between is a staircase of control ticks, and is refused by name.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.assembly.grasps import grasps_of
from ffsm_mj.assembly.prepare import PreparedRun
from ffsm_mj.contact_models.grasp.records import GraspRecord
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.errors import InputError
from ffsm_mj.experiments.uncertainty import Parameter, Quantity, Sensitivity, values
from ffsm_mj.impact import GraspSaltation, Saltation, linearize, linearize_grasp
from ffsm_mj.records.events import ImpactRecord

_OF_IMPACT = {"impacts.0.time_s": "time", "impacts.0.impulse_N_s": "impulse"}
_OF_GRASP = {"grasps.0.time_s": "time", "grasps.0.loss_J": "loss"}
_GRADIENTS = _OF_IMPACT | _OF_GRASP
_STEP = 1e-6
"""Displacement of a coordinate: truncation 1e-12, rounding of a flight of some thousand steps 1e-13 / 1e-6."""


def exact(prepared: PreparedRun, nominal: Run, of: Sequence[Quantity], wrt: Sequence[Parameter]) -> Sensitivity:
    """Derivatives of quantities.

    Raises:
        InputError: One of them does not exist, named.
        UnsupportedContactError: The impact has no derivative.
    """
    for quantity in of:
        if quantity.name not in _GRADIENTS:
            raise InputError(
                f"exact: {quantity.name} has no derivative here, only {', '.join(_GRADIENTS)}; use kind='secant'"
            )
    of_grasp = [quantity.name in _OF_GRASP for quantity in of]
    if any(of_grasp) and not all(of_grasp):
        raise InputError("exact: quantities of an impact and of a grasp; name those of one event")
    assembly = prepared.assemble()
    if place := next(iter(assembly.system.equalities.values()), ""):
        raise InputError(f"exact: {place} constrains the motion, of which there is no derivative here; use kind='secant'")
    event = _grasp(prepared, nominal, assembly) if any(of_grasp) else _impact(prepared, nominal, assembly)
    columns = [_column(prepared, nominal, assembly, event, of, parameter) for parameter in wrt]
    nothing = np.full((len(of), len(wrt)), np.nan)
    same, sides = tuple(True for _ in wrt), tuple("both" for _ in wrt)
    nominal_values = values(nominal, of)
    return Sensitivity("exact", tuple(of), tuple(wrt), nominal_values, nothing, nothing, np.array(columns).T, same, sides)


class _Event(NamedTuple):
    """An event up to which a run coasts.

    Attributes:
        name: ``impact`` or ``grasp``.
        time_s: Its time, s.
        effects: Its linearization.
        rule: Contact rule of an impact; empty for the closing of a grasp.
    """

    name: str
    time_s: float
    effects: Saltation | GraspSaltation
    rule: str


def _impact(prepared: PreparedRun, nominal: Run, assembly: Assembly) -> _Event:
    """The first impact, linearized.

    Raises:
        InputError: There is none, or several contacts at once.
    """
    record = _first(nominal)
    pair = next(candidate for candidate in assembly.pairs if candidate.name == record.pair)
    data, force = _state_before(assembly, record)
    law, e = prepared.scenario.impact.law, record.restitution_used
    hit = linearize(
        *(assembly.system.mj, data, pair),
        restitution=e,
        mu=record.mu,
        compliance_ratio=record.compliance_ratio,
        law=law,
        effort_before=force,
    )
    return _Event("impact", record.time_s, hit, record.rule)


def _grasp(prepared: PreparedRun, nominal: Run, assembly: Assembly) -> _Event:
    """The first closing of a grasp, linearized.

    Raises:
        InputError: There is none, an impact comes before it, or it closes at an impact.
    """
    records = nominal.records.get("grasp_impulses", ())
    if not records:
        raise InputError("exact: no grasp closes in the run")
    record = records[0]
    when = prepared.scenario.grasps[record.grasp].when.within
    if when is None or any(impact.time_s <= record.time_s for impact in nominal.impacts):
        raise InputError(f"exact: an impact occurs before grasp {record.grasp!r} closes, or at it; use kind='secant'")
    data, force = _state_before(assembly, record)
    grasp = next(candidate for candidate in grasps_of(prepared.scenario, assembly.system) if candidate.name == record.grasp)
    closing = linearize_grasp(assembly.system, data, grasp, when.bounds, effort_before=force)
    return _Event("grasp", record.time_s, closing, "")


def _state_before(assembly: Assembly, record: ImpactRecord | GraspRecord) -> tuple[Any, FloatArray]:
    """Data at the state before an event, and generalised forces of external fields there, (nv,)."""
    data, force = assembly.data, np.zeros(assembly.system.mj.nv)
    data.qpos[:], data.time = record.qpos, record.time_s
    data.qvel[:] = np.concatenate([record.qvel_before[name] for name in assembly.system.joints])
    mujoco.mj_forward(assembly.system.mj, data)
    if (field := assembly.plant.fields_in(assembly.system)) is not None:
        field.add_to(data, force)
    return data, force


def _first(nominal: Run) -> ImpactRecord:
    """The first impact.

    Raises:
        InputError: There is none, or several contacts at once.
    """
    impacts = [record for record in nominal.impacts if record.event == 0]
    if len(impacts) != 1:
        raise InputError(f"exact: the first impact of the run has {len(impacts)} contacts; a derivative exists for one")
    if nominal.grasps:
        raise InputError("exact: a grasp closes in the run; use kind='secant', or name grasps.0.time_s or grasps.0.loss_J")
    return impacts[0]


def _column(
    prepared: PreparedRun,
    nominal: Run,
    assembly: Assembly,
    event: _Event,
    of: Sequence[Quantity],
    parameter: Parameter,
) -> list[float]:
    """Derivatives of the quantities by one parameter.

    Raises:
        InputError: They do not exist.
    """
    names = [_GRADIENTS[quantity.name] for quantity in of]
    part, _, rest = parameter.target.key.partition(".")
    if part == "contacts" and rest.endswith("restitution"):
        if not isinstance(event.effects, Saltation) or not _is_of(prepared, parameter, event.rule):
            return [0.0 for _ in names]
        return [event.effects.impulse_by_restitution if name == "impulse" else 0.0 for name in names]
    if part != "initial":
        raise InputError(
            f"exact: no derivative by {parameter.key}, only by initial and contacts.*.restitution; use kind='secant'"
        )
    _refuse_control(nominal, event)
    change = _end_change(prepared, assembly, event.time_s, parameter)
    return [float(getattr(event.effects, name) @ change) for name in names]


def _is_of(prepared: PreparedRun, parameter: Parameter, rule: str) -> bool:
    """Whether a restitution is that of a rule."""
    parts = parameter.target.key.split(".")
    rules = prepared.scenario.contacts.rules or ()
    if parts[1] != "rules":
        raise InputError(f"exact: no derivative by {parameter.key}: name the restitution of a rule; use kind='secant'")
    names = [listed.name for listed in prepared.assemble().contacts.rules]
    return int(parts[2]) < len(rules) and names[int(parts[2])] == rule


def _refuse_control(nominal: Run, event: _Event) -> None:
    """Refuse runs in which a control law acts before the event.

    Raises:
        InputError: The law and its phase.
    """
    for phase in nominal.phases:
        if phase.start_s < event.time_s and phase.controller != "off":
            raise InputError(
                f"exact: {phase.controller} of phase {phase.name!r} acts before the {event.name} at {event.time_s:.6g} s: "
                "its efforts change at control ticks, no derivative is computed; use kind='secant'"
            )


def _end_change(prepared: PreparedRun, assembly: Assembly, time_s: float, parameter: Parameter) -> FloatArray:
    """Change of the state just before the event per unit of an initial coordinate or rate, (2 nv,)."""
    model, ends = assembly.system.mj, []
    for sign in (-1.0, 1.0):
        changed = prepared.changed(prepared.source.overridden([parameter.override(sign * _STEP)])).assemble()
        ends.append(_free_flight(changed, time_s, prepared.scenario.time_step_s))
    (low_q, low_v), (high_q, high_v) = ends
    dq = np.empty(model.nv)
    mujoco.mj_differentiatePos(model, dq, 2.0 * _STEP, low_q, high_q)
    return np.concatenate((dq, (high_v - low_v) / (2.0 * _STEP)))


def _free_flight(assembly: Assembly, time_s: float, step_s: float) -> tuple[FloatArray, FloatArray]:
    """State after free flight for a time, under external fields, without contacts or efforts."""
    model, data, steps = assembly.system.mj, assembly.data, round(time_s / step_s - 0.5)
    scratch, field = mujoco.MjData(model), assembly.plant.fields_in(assembly.system)
    scratch.qpos[:], scratch.qvel[:] = data.qpos, data.qvel
    mujoco.mj_forward(model, scratch)
    motion = Motion(model, scratch)
    motion.push_with([] if field is None else [field.push])
    for duration in (*[step_s] * steps, time_s - steps * step_s):
        if duration > 0.0:
            motion.step(duration)
    return np.array(scratch.qpos), np.array(scratch.qvel)
