"""Builds the phases of a run with their control laws; a phase may have several, each with actuators of its own."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from ffsm_controllers import kinds
from ffsm_controllers.parts import Parts
from ffsm_controllers.phases import Phase
from ffsm_mj.assembly.column_faults import refuse_telemetry, signals_fault
from ffsm_mj.assembly.grasps import grasps_of, is_of_robot
from ffsm_mj.assembly.phase_endings import phase_endings
from ffsm_mj.assembly.recorded_files import PhaseTables, RecordedFiles
from ffsm_mj.config import StrictModel
from ffsm_mj.controller_protocol import ChecksStart, Controller, ControllerContext, Drives
from ffsm_mj.errors import Fault, ScenarioFaults, described, unknown_name
from ffsm_mj.model.actuators import servo_mask
from ffsm_mj.model.system import System
from ffsm_mj.scenario.phase_config import PhaseConfig
from ffsm_mj.scenario.scenario import ScenarioConfig


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
    phases, faults, names = [], [], [config.name for config in scenario.phases]
    system = context.system
    objects = {each.name: each.tree for each in grasps_of(scenario, system) if is_of_robot(system, each)}
    for i, config in enumerate(scenario.phases):
        made: dict[str, Any] = {}
        tables = recorded.of_phase(i)
        for grasp, where in {"": context, **grasped}.items():
            try:
                made[grasp] = _law(config, classes, where, tables)
            except ScenarioFaults as error:
                prefix = f"while {grasp!r} is closed: " if grasp else ""
                faults += [replace(f, message=prefix + f.message, path=("phases", i, *f.path)) for f in error.faults]
                break
        else:
            try:
                controller = made.pop("")
                endings = phase_endings(config, names, controller, context, objects)
                phases.append(Phase(config.name, config.kind, controller, endings, config.arm, config.release, made))
            except ScenarioFaults as error:
                faults += [replace(fault, path=("phases", i, *fault.path)) for fault in error.faults]
    if faults:
        raise ScenarioFaults(faults)
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
    laws = [part.law for part in phase.controller.parts] if isinstance(phase.controller, Parts) else [phase.controller]
    faults = [
        replace(fault, path=("phases", 0, *keys, *fault.path))
        for keys, law in zip(config.laws, laws, strict=True)
        for fault in _start_faults(law, data)
    ]
    if faults:
        raise ScenarioFaults(faults)


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
        return _made(classes, config.controller, context, ("controller",), tables)
    made: dict[str, Any] = {}
    owners: dict[int, str] = {}
    for name, part in sorted(config.controllers.items(), key=lambda item: _leaves_joints_out(item[1])):
        path = ("controllers", name)
        own = replace(_context_of_part(config, name, context), reserved=frozenset(owners))
        law = _made(classes, part, own, path, tables)
        if fault := signals_fault(law.telemetry_signals):
            raise ScenarioFaults([Fault(f"telemetry of kind {part.kind!r}: {fault}", (*path, "kind"))])
        claims = claims_of(law)
        _refuse_second_claims(context.system, name, claims, owners)
        owners |= dict.fromkeys(claims, name)
        made[name] = law
    laws = {name: (part.kind, made[name]) for name, part in config.controllers.items()}
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


def _made(
    classes: Mapping[str, Any], config: Any, context: ControllerContext, path: tuple[str, ...], tables: PhaseTables
) -> Controller:
    """One control law.

    Raises:
        ScenarioFaults: It cannot be made; paths in the phase.
    """
    try:
        law: Controller = classes[config.kind](config, replace(context, recorded=tables.get(path, {})))
        unknown = [i for i in claims_of(law) if not 0 <= i < context.system.mj.nu]
    except ScenarioFaults as error:
        raise ScenarioFaults([replace(f, path=(*path, *f.path)) for f in error.faults]) from error
    except Exception as error:  # a plugin's code: whatever it raises is a fault of this phase
        message = f"the controller cannot be made ({described(error)})"
        raise ScenarioFaults([Fault(message, (*path, "kind"), error)]) from error
    if unknown:
        message = f"driven_actuators of kind {config.kind!r} contains {unknown[0]}; ids are 0 to {context.system.mj.nu - 1}"
        raise ScenarioFaults([Fault(message, (*path, "kind"))])
    return law


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
    faults = []
    for other, shared in both.items():
        if shared:
            actuators = ", ".join(system.names("actuator")[i] for i in shared)
            for part, second in ((other, name), (name, other)):
                message = f"drives {actuators}, and so does the part {second!r}; each actuator has one part"
                faults.append(Fault(message, ("controllers", part)))
    if faults:
        raise ScenarioFaults(faults)


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
            single.setdefault(_names(system, left), []).append(f"{phase.name!r} ({phase.kind})")
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
        yield f"{f'only part {who}' if silent else 'no part'} of phase {phase.name!r} {verb} {_names(system, left)}"


def _motors(system: System) -> set[int]:
    """Ids of the motors of joints other than those of a base, servos aside."""
    model = system.mj
    on_joints = np.flatnonzero((model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)) & ~servo_mask(model))
    base = {dof for tree in system.trees for dof in range(tree.base_dofs.start, tree.base_dofs.stop)}
    return {int(i) for i in on_joints if model.jnt_dofadr[model.actuator_trnid[i, 0]] not in base}


def _names(system: System, actuators: list[int]) -> str:
    return ", ".join(system.names("actuator")[i] for i in actuators)
