"""Builds the phases of a run: task, control laws and ends. A phase may have several laws, each with its own actuators."""

from __future__ import annotations

import re
from collections import ChainMap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import mujoco
import numpy as np

from ffsm_controllers import kinds
from ffsm_controllers.endings import Ending, EventTrigger, FinishedTrigger, MeasurementBound, TimeTrigger, Trigger
from ffsm_controllers.parts import Parts
from ffsm_controllers.phases import Phase
from ffsm_controllers.settled import SettlingMonitor
from ffsm_controllers.stop_condition import StopCondition, StopMonitor
from ffsm_mj.assembly.grasps import grasps_of, is_of_robot
from ffsm_mj.assembly.recorded_files import PhaseTables, RecordedFiles
from ffsm_mj.config import StrictModel
from ffsm_mj.controller_protocol import ChecksStart, Controller, ControllerContext, Drives, Finishes, Task
from ffsm_mj.dynamics.site_motion import MovingFrame
from ffsm_mj.dynamics.trajectories import PathMotion, SiteTarget, TargetMotion
from ffsm_mj.errors import Fault, Faults, InputError, ScenarioFaults, described, faults_below, first_few, unknown_name
from ffsm_mj.model.actuators import servo_mask
from ffsm_mj.model.system import System
from ffsm_mj.records.columns import Columns, same_names
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.records.kinds import kind_named
from ffsm_mj.records.signals import Signal, identifier
from ffsm_mj.scenario.phases import PhaseConfig, PhaseEnd, SensorEndConfig
from ffsm_mj.scenario.scenario import ScenarioConfig, TaskConfig

_AXES = {"x": 0, "y": 1, "z": 2}


def task_of(scenario: ScenarioConfig, system: System) -> Task | None:
    """Task of a scenario; None if it has none.

    Raises:
        ScenarioFaults: There is no such tip, or no such site to follow.
    """
    config = scenario.task
    if config is None:
        return None
    with faults_below("task", "tip"):
        site = system.index("site", config.tip)
    axes = tuple(_AXES[axis] for axis in config.axes)
    return Task(site, axes, np.array(config.target_m, dtype=np.float64), _target_motion(config, axes, scenario, system))


def _target_motion(
    config: TaskConfig, axes: tuple[int, ...], scenario: ScenarioConfig, system: System
) -> TargetMotion | None:
    """How the target moves.

    Raises:
        ScenarioFaults: There is no such site to follow, or it is of the robot or of an object that may be grasped.
    """
    trajectory = config.trajectory
    if trajectory is None:
        return None
    if trajectory.site is not None:
        with faults_below("task", "trajectory", "site"):
            site = _target_site(trajectory.site, scenario, system)
        return SiteTarget(MovingFrame(system.mj, site, np.array(trajectory.offset_m)), axes)
    waypoints = trajectory.waypoints or ()
    times = [trajectory.start_s, *(waypoint.at_s for waypoint in waypoints)]
    return PathMotion(times, np.array([config.target_m, *(waypoint.position_m for waypoint in waypoints)]))


def _target_site(name: str, scenario: ScenarioConfig, system: System) -> int:
    """Id of the site that a target is fixed to.

    Raises:
        LookupError: See :func:`_target_motion`.
    """
    full = system.resolve("site", name)
    tree, _, _ = full.partition("/")
    if tree == "robot":
        raise LookupError(f"{full} is a site of the robot; a site of an object is needed")
    if any(system.resolve("site", grasp.object_site).startswith(f"{tree}/") for grasp in scenario.grasps.values()):
        raise LookupError(
            f"{tree} may be grasped, and would then carry the target with the tip; use the law 'track' or 'impedance' "
            "with 'object_site', which know of grasps"
        )
    return system.index("site", full)


_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)


def refuse_same_names(columns: Iterable[Columns], system: System) -> None:
    """Refuse model elements whose names are equal in the log, which keeps only letters, digits and underscores.

    Raises:
        InputError: A line for each two, with the file of the second.
    """
    lines: dict[tuple[str, str], str] = {}
    for one, other in same_names(columns):
        names = f"{one.element or one.description!r} and {other.element or other.description!r}"
        message = f"{_place(system, other.element)}: {names} are both logged as {other.key}; rename one of them"
        lines.setdefault((one.element, other.element), message)
    first: dict[str, str] = {}
    for name in system.names("actuator"):  # their columns may differ in the unit alone, by which they are not looked up
        if (before := first.setdefault(identifier(name), name)) != name:
            place, both = _place(system, f"actuator {name}"), f"'actuator {before}' and 'actuator {name}'"
            message = f"{place}: {both} are both logged as actuators.{identifier(name)}; rename one of them"
            lines.setdefault((f"actuator {before}", f"actuator {name}"), message)
    if lines:
        raise InputError(list(lines.values()))


def _place(system: System, element: str) -> str:
    """``file`` or ``file:line`` of an element by kind and full name, or ``file`` by its full name."""
    kind, _, full = element.partition(" ") if " " in element else ("", "", element)
    model, _, short = full.partition("/")
    files = system.files.get(model)
    if files is None:
        return " and ".join(file.place for file in system.files.values())
    tags = {"joint": ("joint", "freejoint"), "actuator": ("motor", "general")}.get(kind, ())
    named = (
        declared.place for declared in files.elements() if declared.tag in tags and declared.attributes.get("name") == short
    )
    return next(named, files.place)


def refuse_telemetry(phases: Sequence[Phase]) -> None:
    """Refuse control laws whose signals cannot be columns, or differ in meaning under the same name.

    Raises:
        ScenarioFaults: A line for each law.
    """
    known: dict[str, tuple[Signal, str]] = {}
    with Faults() as faults:
        for i, phase in enumerate(phases):
            fault = signals_fault(phase.controller.telemetry_signals)
            for name, law in () if fault else phase.by_grasp.items():
                if tuple(law.telemetry_signals) != tuple(phase.controller.telemetry_signals):
                    fault = f"it reports other signals while {name!r} is closed than before"
            for signal in () if fault else phase.controller.telemetry_signals:
                other, where = known.setdefault(signal.key, (signal, phase.name))
                if other != signal:
                    fault = f"{signal.key} is {signal.description!r} here and {other.description!r} in phase {where!r}"
            if fault:
                key = ("controllers",) if isinstance(phase.controller, Parts) else ("controller", "kind")
                faults.add(f"telemetry of kind {phase.kind!r}: {fault}", "phases", i, *key)


def signals_fault(signals: object, group: str = "controller") -> str:
    """What is wrong with the signals of one law, or of an estimator, of this group; empty if they are valid."""
    if not isinstance(signals, Sequence) or not all(isinstance(signal, Signal) for signal in signals):
        return "telemetry_signals is no sequence of Signal"
    for signal in signals:
        if signal.group != group or not _NAME.fullmatch(signal.name):
            return f"{signal.key!r} is no name in the group {group}, of letters, digits and _"
    names = [signal.key for signal in signals]
    twice = next((name for name in names if names.count(name) > 1), "")
    return f"{twice} is listed twice" if twice else ""


def phase_endings(
    config: PhaseConfig,
    names: Sequence[str],
    controller: Any,
    context: ControllerContext,
    grasped: Mapping[str, str] = MappingProxyType({}),
) -> tuple[Ending, ...]:
    """What ends a phase, in the order in which it counts at one instant.

    Args:
        config: Configuration of the phase.
        names: Names of all phases.
        controller: Its control law.
        context: What that is made for in the scene.
        grasped: Object by the name of the grasp that holds it.

    Raises:
        ScenarioFaults: An end that cannot occur; paths in the phase.
    """
    return tuple(
        Ending(
            end.trigger if isinstance(end.trigger, str) else end.trigger.sensor,
            _trigger(config, end, controller, context, grasped),
            None if end.to is None else names.index(end.to),
        )
        for end in config.ends
    )


def _trigger(
    config: PhaseConfig, end: PhaseEnd, controller: Any, context: ControllerContext, grasped: Mapping[str, str]
) -> Trigger:
    """When an end is due.

    Raises:
        ScenarioFaults: It cannot occur.
    """
    trigger = end.trigger
    if isinstance(trigger, SensorEndConfig):
        with faults_below(*end.keys, *(("sensor",) if end.keys == ("until",) else ())):
            name = context.system.resolve("sensor", trigger.sensor)
        return MeasurementBound(name, trigger.above, trigger.below)
    if trigger == "time":
        return TimeTrigger(float(config.for_s or 0.0))
    if trigger == "stop_when":
        try:
            return StopMonitor(StopCondition.parse(str(config.stop_when)), context.system, context.task, grasped)
        except ValueError as error:
            raise ScenarioFaults([Fault(str(error), ("stop_when",))]) from error
    if trigger == "settled" and config.settled is not None and context.task is not None:
        return SettlingMonitor(config.settled, context.system, context.task)
    if trigger == "finished":
        if not any(isinstance(law, Finishes) for law in laws_of(controller)):
            message = f"{config.kind} never finishes; detumble, joint_path, playback, transfer and laws with is_finished do"
            rest = "; 'until: null' leaves for_s as the end of the phase" if config.for_s and end.keys == ("until",) else ""
            raise ScenarioFaults([Fault(message + rest, end.keys)])
        return FinishedTrigger()
    return EventTrigger(ImpactRecord if trigger == "impact" else kind_named(trigger).record)


def laws_of(controller: Any) -> list[Any]:
    """Control laws of a phase: those of its parts, or the only one."""
    return [part.law for part in controller.parts] if isinstance(controller, Parts) else [controller]


def build_phases(
    scenario: ScenarioConfig,
    context: ControllerContext,
    laws: Mapping[str, Any],
    grasped: Mapping[str, ControllerContext],
    recorded: RecordedFiles,
) -> list[Phase]:
    """The phases with their control laws, in order: each law is created for the scene and for each grasped system.

    Args:
        scenario: Scenario of the run.
        context: What the laws are made for in the scene.
        laws: Control laws of a script, classes by kind, beside those that are installed.
        grasped: What they are made for while an object is grasped, by the name of the grasp.
        recorded: Files that their configurations name.

    Raises:
        ScenarioFaults: A control law cannot be made, or two parts of a phase drive the same actuator.
    """
    classes = ChainMap(dict(laws), kinds().classes)
    phases, names, system = [], [config.name for config in scenario.phases], context.system
    objects = {candidate.name: candidate.tree for candidate in grasps_of(scenario, system) if is_of_robot(system, candidate)}
    with Faults() as faults:
        for i, config in enumerate(scenario.phases):
            known, tables, by_grasp = len(faults.collected), recorded.of_phase(i), dict[str, Any]()
            for grasp, where in {"": context, **grasped}.items():
                with faults.below("phases", i, prefix=f"while {grasp!r} is closed: " if grasp else ""):
                    by_grasp[grasp] = _law(config, classes, where, tables)
                if len(faults.collected) > known:
                    break
            else:
                with faults.below("phases", i):
                    controller = by_grasp.pop("")
                    endings = phase_endings(config, names, controller, context, objects)
                    phases.append(Phase(config.name, config.kind, controller, endings, config.arm, config.release, by_grasp))
    refuse_telemetry(phases)
    return phases


def refuse_start(phase: Phase, config: PhaseConfig, data: Any) -> None:
    """Refuse a first phase with a control law that cannot begin at the initial state.

    Args:
        phase: The first phase.
        config: Its configuration.
        data: What its control laws see at t = 0.

    Raises:
        ScenarioFaults: One cannot; paths in the scenario.
    """
    with Faults() as faults:
        for keys, law in zip(config.laws, laws_of(phase.controller), strict=True):
            for fault in _start_faults(law, data):
                faults.collected.append(replace(fault, path=("phases", 0, *keys, *fault.path)))


def _start_faults(law: Controller, data: Any) -> Sequence[Fault]:
    if not isinstance(law, ChecksStart):
        return ()
    try:
        return law.start_faults(data)
    except Exception as error:  # noqa: BLE001 (a plugin's code: whatever it raises is a fault of this phase)
        return [Fault(f"whether the controller can begin cannot be computed ({described(error)})", ("kind",), error)]


def _law(config: PhaseConfig, classes: Mapping[str, Any], context: ControllerContext, tables: PhaseTables) -> Controller:
    """The control law of a phase, or its parts as one law.

    Parts whose ``joints`` are left out are made last, so that they can leave the joints of the others alone.

    Raises:
        ScenarioFaults: See :func:`build_phases`; paths in the phase.
    """
    if config.controllers is None:
        return _built(classes, config.controller, context, ("controller",), tables)
    by_name: dict[str, Any] = {}
    owners: dict[int, str] = {}
    for name, part in sorted(config.controllers.items(), key=lambda item: _leaves_joints_out(item[1])):
        path = ("controllers", name)
        part_context = replace(_context_of_part(config, name, context), reserved=frozenset(owners))
        law = _built(classes, part, part_context, path, tables)
        if fault := signals_fault(law.telemetry_signals):
            raise ScenarioFaults([Fault(f"telemetry of kind {part.kind!r}: {fault}", (*path, "kind"))])
        claims = claims_of(law)
        _refuse_second_claims(context.system, name, claims, owners)
        owners |= dict.fromkeys(claims, name)
        by_name[name] = law
    laws = {name: (part.kind, by_name[name]) for name, part in config.controllers.items()}
    return Parts(laws, context.system.names("actuator"))


def _context_of_part(config: PhaseConfig, part: str, context: ControllerContext) -> ControllerContext:
    """What the law of a part is made for: the robot with its task, or an object in its place.

    Raises:
        ScenarioFaults: An unknown object, or one that is fixed.
    """
    if part not in config.drives:
        return context
    name, system = config.drives[part], context.system
    moving = [tree.name for tree in (*system.objects, *([system.grasped] if system.grasped is not None else ()))]
    if name not in moving:
        raise ScenarioFaults([Fault(unknown_name("object that moves", name, moving), ("drives", part))])
    return replace(context, system=system.for_law_of(name), task=None)


def _built(
    classes: Mapping[str, Any], config: Any, context: ControllerContext, path: tuple[str, ...], tables: PhaseTables
) -> Controller:
    """One control law.

    Raises:
        ScenarioFaults: It cannot be made; paths in the phase.
    """
    with plugin_errors("controller", *path):
        law: Controller = classes[config.kind](config, replace(context, recorded=tables.get(path, {})))
        unknown = [i for i in claims_of(law) if not 0 <= i < context.system.mj.nu]
    if unknown:
        message = f"driven_actuators of kind {config.kind!r} contains {unknown[0]}; ids are 0 to {context.system.mj.nu - 1}"
        raise ScenarioFaults([Fault(message, (*path, "kind"))])
    return law


@contextmanager
def plugin_errors(what: str, *path: str) -> Iterator[None]:
    """Context in which a law or an estimator is made: whatever the code of a plug-in raises is a fault of its section.

    Raises:
        ScenarioFaults: It cannot be made.
    """
    with faults_below(*path):
        try:
            yield
        except ScenarioFaults:
            raise
        except Exception as error:
            raise ScenarioFaults([Fault(f"the {what} cannot be made ({described(error)})", ("kind",), error)]) from error


def claims_of(law: Controller) -> list[int]:
    """Ids of the actuators that a law states that it drives; empty if it states none."""
    return [int(i) for i in law.driven_actuators] if isinstance(law, Drives) else []


def _leaves_joints_out(config: Any) -> bool:
    """Whether the configuration of a law, or a section of it, has ``joints`` that are left out."""
    return any(
        (name == "joints" and value is None) or (isinstance(value, StrictModel) and _leaves_joints_out(value))
        for name, value in config
    )


def _refuse_second_claims(system: System, name: str, claims: list[int], owners: Mapping[int, str]) -> None:
    """Refuse a part with an actuator of another one, with a fault at each of the two.

    Raises:
        ScenarioFaults: There is one.
    """
    both = {other: [i for i in claims if owners.get(i) == other] for other in dict.fromkeys(owners.values())}
    with Faults() as faults:
        for other, shared in both.items():
            for part, second in ((other, name), (name, other)) if shared else ():
                message = (
                    f"drives {_actuator_names(system, shared)}, and so does the part {second!r}; each actuator has one part"
                )
                faults.add(message, "controllers", part)


def undriven_actuators(system: System, phases: tuple[Phase, ...]) -> Iterator[str]:
    """Messages for motors that nothing drives in a phase that drives others; servos keep their setpoints.

    For a single law only motors of joints are listed, other than those of the base; a law of which it is not known what it
    drives gives a message if it is one of several.
    """
    single: dict[str, list[str]] = {}
    for phase in phases:
        if isinstance(phase.controller, Parts):
            yield from _undriven_by_parts(system, phase, phase.controller)
            continue
        claims = claims_of(phase.controller)
        left = sorted(_motors(system) - set(claims))
        if claims and left:
            single.setdefault(_actuator_names(system, left), []).append(f"{phase.name!r} ({phase.kind})")
    for names, those in single.items():
        where = f"{'phase' if len(those) == 1 else 'phases'} {', '.join(those)}"
        yield f"nothing drives {names} in {where}: these joints move freely"


def _undriven_by_parts(system: System, phase: Phase, parts: Parts) -> Iterator[str]:
    silent = [part for part in parts.parts if not isinstance(part.law, Drives)]
    claims = {i for part in parts.parts for i in claims_of(part.law)}
    left = [int(i) for i in np.flatnonzero(~servo_mask(system.mj)) if i not in claims]
    for part in silent:
        yield (
            f"part {part.name!r} ({part.kind}) of phase {phase.name!r} does not state which actuators it drives; "
            "the run ends if it drives one of another part"
        )
    if left:
        verb = "may drive" if silent else "drives"
        who = " or ".join(repr(part.name) for part in silent)
        yield f"{f'only part {who}' if silent else 'no part'} of phase {phase.name!r} {verb} {_actuator_names(system, left)}"


def _motors(system: System) -> set[int]:
    """Ids of the motors of joints other than those of a base, servos aside."""
    model = system.mj
    on_joints = np.flatnonzero((model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)) & ~servo_mask(model))
    base = {dof for tree in system.trees for dof in range(tree.base_dofs.start, tree.base_dofs.stop)}
    return {int(i) for i in on_joints if model.jnt_dofadr[model.actuator_trnid[i, 0]] not in base}


def _actuator_names(system: System, actuators: list[int]) -> str:
    return first_few([system.names("actuator")[i] for i in actuators])
