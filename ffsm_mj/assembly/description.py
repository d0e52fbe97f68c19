"""Description of an assembled scenario as lines of text, and notes on what a user should know before it runs."""

from __future__ import annotations

from collections.abc import Sequence

from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.assembly.contact_notes import contact_notes, mesh_notes, rule_lines
from ffsm_mj.assembly.control_laws import undriven_actuators
from ffsm_mj.assembly.damping import unstable_damping
from ffsm_mj.assembly.initial_scene import initial_lines, initial_notes
from ffsm_mj.assembly.loop_notes import friction_notes, loop_lines, loop_notes
from ffsm_mj.assembly.pair_notes import disarmed_pairs, unwatched_overlaps
from ffsm_mj.assembly.spring_modes import spring_lines
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact_models.impact.records import force_unit
from ffsm_mj.contact_models.joint_friction.coordinates import friction_coordinates
from ffsm_mj.dynamics.stiff_actuators import StiffActuators
from ffsm_mj.model.actuators import servo_mask
from ffsm_mj.model.inputs import further_inputs
from ffsm_mj.model.system import System
from ffsm_mj.records.metadata import gravity_line, gravity_metadata
from ffsm_mj.scenario.grasps import never_armed
from ffsm_mj.scenario.phase_graph import graph_lines, is_branching
from ffsm_mj.scenario.scenario import ScenarioConfig
from ffsm_mj.sensing.sensor import Sensor


def notes(assembly: Assembly) -> list[str]:
    """What a user should know about the scenario before it runs, one line each."""
    return [
        *(change.sentence for change in assembly.changes),
        *assembly.system.notes,
        *contact_notes(assembly.contacts, assembly.system),
        *(
            f"{a} and {b} overlap at the start, and no contact force will separate them"
            for a, b in unwatched_overlaps(assembly)
        ),
        *assembly.start_notes,
        *initial_notes(assembly),
        *unstable_damping(assembly),
        *undriven_actuators(assembly.system, assembly.controller.phases),
        *disarmed_pairs(assembly),
        *loop_notes(assembly),
        *friction_notes(assembly),
        *never_armed(assembly.scenario),
    ]


def describe(assembly: Assembly) -> list[str]:
    """Lines of text that describe the run, with notes."""
    scenario, system, initial = assembly.scenario, assembly.system, assembly.scenario.initial
    lines = [
        f"{scenario.name}: valid",
        *(f"  {tree.name}: bodies {len(tree.bodies)}, dofs {tree.dofs.stop - tree.dofs.start}" for tree in system.trees),
        *(f"  {each.name}: fixed, bodies {len(each.bodies)}" for each in system.fixed),
        *(f"  {line}" for line in rule_lines(assembly.contacts)),
        *_limited_joints(assembly.limits),
        *spring_lines(scenario, system, assembly.data),
        *_servos(assembly),
        *_dry_friction(system),
        *loop_lines(assembly),
        *_sensors(assembly),
        *([f"  goes on from {initial.from_} at t = {initial.at_s:g} s"] if initial.from_ is not None else []),
        *_phases(scenario),
        f"  {scenario.ticks} control ticks of {scenario.control_period_s:g} s, steps of {scenario.time_step_s:g} s",
        *initial_lines(assembly),
    ]
    falls = gravity_line(gravity_metadata(system.mj.opt.gravity))
    lines += [f"breaks conservation: {fault}" for fault in system.faults] or [
        falls or "conservative: nothing in the models breaks it"
    ]
    return lines + [f"note: {note}" for note in (*notes(assembly), *mesh_notes(assembly.contacts, system))]


def _phases(scenario: ScenarioConfig) -> list[str]:
    """The phases in a line, or their graph where they branch."""
    phases = scenario.phases
    if not is_branching(phases):
        return [f"  phases: {', '.join(f'{phase.name} ({phase.kind})' for phase in phases)}"]
    return ["  phases:", *(f"    {line}" for line in graph_lines(phases))]


def _sensors(assembly: Assembly) -> list[str]:
    """A heading with the estimator and a line for each sensor; none if there are no sensors."""
    sampler = assembly.plant.sampler
    if sampler is None:
        return []
    lines = [
        f"    {each.name}: {each.model.kind}, every {each.interval_s:g} s"
        + _lateness(each)
        + (", nothing arrives within the run" if _never_arrives(each, assembly.scenario.duration_s) else "")
        for each in sampler.by_name.values()
    ]
    return [f"  sensors (estimator {assembly.scenario.estimator.kind})", *lines]


def _lateness(sensor: Sensor) -> str:
    """How late samples of a sensor are, and the share that is lost."""
    latest_s = sensor.delay_s + sensor.delay_jitter_s
    late = f"{sensor.delay_s:g} to {latest_s:g}" if sensor.delay_jitter_s else f"{latest_s:g}"
    return (f", {late} s late" if latest_s else "") + (f", {sensor.dropout:.3g} of all lost" if sensor.dropout else "")


def _never_arrives(sensor: Sensor, duration_s: float) -> bool:
    return sensor.dropout == 1.0 or sensor.earliest_s >= duration_s


def _limited_joints(limits: Sequence[JointLimit]) -> list[str]:
    """A heading and a line for each joint that stops at its limits; none if there are no such joints."""
    ends = zip(limits[::2], limits[1::2], strict=True)
    joints = [
        f"    {low.joint}: {low.limit:.4g} to {high.limit:.4g} {low.unit}, e = {low.restitution:g}" for low, high in ends
    ]
    return ["  joints that stop at their limits", *joints] if joints else []


def _servos(assembly: Assembly) -> list[str]:
    """A line on the servos, their fastest rate at the initial state, and the steps that it asks for; none without servos."""
    model, integrator = assembly.system.mj, assembly.plant.integrator
    servos = int((servo_mask(model) & ~further_inputs(model)).sum())
    if not servos:
        return []
    motion = integrator.motion
    fastest = max(StiffActuators(model, assembly.data, motion.constrained).fastest())
    kind = "implicit" if motion.stiff is not None else "explicit"
    divided = " and divided where their error needs it" if integrator.control is not None else ""
    steps = f"steps are {kind}{divided}"
    return [f"  servos: {servos}, fastest rate {fastest:.4g} 1/s with springs, dampers and activations; {steps}"]


def _dry_friction(system: System) -> list[str]:
    """A heading and a line for each joint and tendon with dry friction; none if there are none."""
    on = friction_coordinates(system)
    if on is None:
        return []
    kinds = ["joint"] * len(on.dofs) + ["tendon"] * len(on.tendons)
    each = zip(kinds, on.names, on.limits, on.units, strict=True)
    return [
        "  dry friction",
        *(f"    {kind} {name}: {limit:.4g} {force_unit(unit)}" for kind, name, limit, unit in each),
    ]
