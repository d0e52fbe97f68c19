"""A scenario turned into things that run: model, initial state, impact pairs, plant limits, controllers. Nothing moves."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from ffsm_controllers import kinds
from ffsm_controllers.phases import Phase, PhaseMachine

from ffsm_mj.assembly.initial_state import initial_state
from ffsm_mj.assembly.run_size import too_large
from ffsm_mj.contact.pairs import ImpactPair
from ffsm_mj.contact.watch import ContactWatch
from ffsm_mj.controller_protocol import ControllerContext, Task
from ffsm_mj.errors import Fault, ScenarioFaults, described, unknown_name
from ffsm_mj.impact.time_of_impact import GAP_TOLERANCE
from ffsm_mj.model.files import read_model
from ffsm_mj.model.system import System, compile_system
from ffsm_mj.plant.actuation import Actuation
from ffsm_mj.records.signals import Layout, build_layout
from ffsm_mj.scenario.scenario import Scenario, located
from ffsm_mj.scenario.source import YamlSource

_AXES = {"x": 0, "y": 1, "z": 2}


@dataclass(frozen=True)
class Assembly:
    """Parts of a run, checked against each other.

    Attributes:
        scenario: What was asked for.
        system: Robot and objects.
        data: Initial state, all derived quantities current.
        pairs: Impact pairs.
        known_pairs: Geom pairs that need no watching: impact pairs and ignored ones.
        actuation: Plant limits.
        controller: The phase machine.
        task: The tip's task, if any.
        layout: Columns of the log.
    """

    scenario: Scenario
    system: System
    data: Any
    pairs: tuple[ImpactPair, ...]
    known_pairs: frozenset[frozenset[int]]
    actuation: Actuation
    controller: PhaseMachine
    task: Task | None
    layout: Layout


def assemble(scenario: Scenario, source: YamlSource) -> Assembly:
    """Build everything a run needs.

    Raises:
        InputError: One line per fault, with the place in the scenario or the model.
    """
    system = compile_scenario(scenario, source)
    try:
        data = initial_state(scenario, system)
        pairs = impact_pairs(scenario, system)
        known = _known_pairs(scenario, system, pairs)
        _refuse_undetectable(system, data, pairs)
        actuation = Actuation(system, scenario.actuators)
        task = task_of(scenario, system)
        controller = _controller(scenario, ControllerContext(system, task, scenario.control_period_s))
        layout = build_layout(system, actuation.signals, controller.telemetry_signals, tip=task is not None)
        if fault := too_large(scenario.ticks, len(layout.signals), scenario.log.max_size_GB):
            raise ScenarioFaults([Fault(fault, ("duration_s",))])
    except ScenarioFaults as faults:
        raise located(faults, source) from faults
    return Assembly(scenario, system, data, pairs, known, actuation, controller, task, layout)


def compile_scenario(scenario: Scenario, source: YamlSource) -> System:
    """Compile robot and objects of a scenario.

    Raises:
        InputError: A file is missing or malformed, or a model is not what a free-floating system needs.
    """
    paths: dict[str, tuple[Path, list[Path]]] = {}
    faults = []
    models = {("robot",): scenario.robot} | {("objects", name): part for name, part in scenario.objects.items()}
    for keys, part in models.items():
        path = _beside(source, (*keys, "mjcf"), part.mjcf)
        if not os.path.isfile(path):  # without an exception for a name that is too long
            what = "is a folder, not a model file:" if os.path.isdir(path) else "no such model file"
            faults.append(Fault(f"{what} {path}", (*keys, "mjcf")))
        folders = [_beside(source, (*keys, "asset_folders"), folder) for folder in part.asset_folders]
        for i, folder in enumerate(folders):
            if not os.path.isdir(folder):
                faults.append(Fault(f"no such folder: {folder}", (*keys, "asset_folders", i)))
        paths[keys[-1]] = path, folders
    if faults:
        raise located(ScenarioFaults(faults), source)
    files = {name: read_model(path, folders) for name, (path, folders) in paths.items()}
    robot = files.pop("robot")
    return compile_system(robot, files, time_step_s=scenario.time_step_s, conservative=scenario.conservative)


def _beside(source: YamlSource, keys: tuple[str, ...], name: str) -> Path:
    """A path in a scenario: relative to the file that states it."""
    return Path(os.path.normpath(source.folder(keys) / name))


def impact_pairs(scenario: Scenario, system: System) -> tuple[ImpactPair, ...]:
    """Impact pairs of a scenario, in its order.

    Raises:
        ScenarioFaults: A geom that there is not, on the wrong side, or without an exact distance.
    """
    pairs, faults = [], []
    for i, config in enumerate(scenario.impact_pairs):
        for key in ("robot_geom", "object_geom"):
            fault = _geom_fault(system, key, getattr(config, key))
            if fault:
                faults.append(Fault(fault, ("impact_pairs", i, key)))
        if faults:
            continue
        try:
            pairs.append(ImpactPair(system, config.robot_geom, config.object_geom, config.restitution))
        except LookupError as error:
            faults.append(Fault(str(error.args[0]), ("impact_pairs", i)))
    if faults:
        raise ScenarioFaults(faults)
    return tuple(pairs)


def _geom_fault(system: System, key: str, name: str) -> str:
    """What is wrong with a geom's name on one side of an impact pair, or nothing."""
    side = "the robot" if key == "robot_geom" else "an object"
    valid = [full for full in system.names("geom") if full.startswith(f"{system.robot.name}/") == (side == "the robot")]
    try:
        full = system.resolve("geom", name)
    except LookupError as error:
        message = str(error.args[0])
        return unknown_name(f"geom of {side}", name, valid) if message.startswith("unknown") else message
    return "" if full in valid else f"{full} is no geom of {side}; allowed: {', '.join(sorted(valid))}"


def _refuse_contradictions(pairs: tuple[ImpactPair, ...], ignored: set[frozenset[int]]) -> None:
    """A pair is resolved once, or ignored; not both."""
    faults: list[Fault] = []
    seen: set[tuple[str, str]] = set()
    for i, pair in enumerate(pairs):
        name = f"{pair.robot_geom} - {pair.object_geom}"
        if (pair.robot_geom, pair.object_geom) in seen:
            faults.append(Fault(f"{name} is listed twice", ("impact_pairs", i)))
        if pair.geoms in ignored:
            faults.append(Fault(f"{name} is also in ignored_pairs", ("impact_pairs", i)))
        seen.add((pair.robot_geom, pair.object_geom))
    if faults:
        raise ScenarioFaults(faults)


def _refuse_undetectable(system: System, data: Any, pairs: tuple[ImpactPair, ...]) -> None:
    """Refuse pairs that overlap at the start, or whose speed no energy bounds."""
    faults = []
    for i, pair in enumerate(pairs):
        if math.isinf(pair.reach_per_root_energy(system.mj, data)):
            message = f"a moment of inertia of {pair.robot_geom} or {pair.object_geom} is less than rounding of the others"
            faults.append(Fault(f"{message}: no energy bounds how fast it spins", ("impact_pairs", i)))
        gap = pair.gap(system.mj, data, 1.0)
        if gap < -GAP_TOLERANCE:
            message = f"{pair.robot_geom} and {pair.object_geom} overlap by {-gap:.6g} m at the start; move one of them"
            faults.append(Fault(message, ("impact_pairs", i)))
    if faults:
        raise ScenarioFaults(faults)


def _known_pairs(scenario: Scenario, system: System, pairs: tuple[ImpactPair, ...]) -> frozenset[frozenset[int]]:
    known: set[frozenset[int]] = set()
    faults = []
    for i, config in enumerate(scenario.ignored_pairs):
        sides = []
        for k, name in enumerate(config.pair):
            geoms = _geoms_of(system, name)
            if not geoms:
                names = {tree.name for tree in system.trees} | {*system.names("body"), *system.names("geom")}
                faults.append(Fault(unknown_name("geom, body or model", name, names), ("ignored_pairs", i, "pair", k)))
            sides.append(geoms)
        known |= {frozenset((a, b)) for a in sides[0] for b in sides[1]}
    if faults:
        raise ScenarioFaults(faults)
    _refuse_contradictions(pairs, known)
    return frozenset(known | {pair.geoms for pair in pairs})


def _geoms_of(system: System, name: str) -> list[int]:
    """Geoms that a name stands for: those of a model, of a body, or the geom itself."""
    model = system.mj
    for tree in system.trees:
        if tree.name == name:
            return [g for g in range(model.ngeom) if model.geom_bodyid[g] in tree.bodies]
    for kind in ("geom", "body"):
        try:
            index = system.index(kind, name)
        except LookupError:
            continue
        return [index] if kind == "geom" else [g for g in range(model.ngeom) if model.geom_bodyid[g] == index]
    return []


def task_of(scenario: Scenario, system: System) -> Task | None:
    """Task of a scenario, or None where it has none.

    Raises:
        ScenarioFaults: There is no such tip.
    """
    config = scenario.task
    if config is None:
        return None
    try:
        site = system.index("site", config.tip)
    except LookupError as error:
        raise ScenarioFaults([Fault(str(error.args[0]), ("task", "tip"))]) from error
    return Task(site, tuple(_AXES[axis] for axis in config.axes), np.array(config.target_m, dtype=np.float64))


def _controller(scenario: Scenario, context: ControllerContext) -> PhaseMachine:
    classes: Mapping[str, Any] = kinds().classes
    phases, faults = [], []
    for i, config in enumerate(scenario.phases):
        kind = config.controller.kind
        try:
            controller = classes[kind](config.controller, context)
        except ScenarioFaults as error:
            faults += [Fault(f.message, ("phases", i, "controller", *f.path)) for f in error.faults]
            continue
        except Exception as error:  # noqa: BLE001 (a plugin's code: whatever it raises is a fault of this phase)
            faults.append(Fault(f"the controller cannot be made ({described(error)})", ("phases", i, "controller", "kind")))
            continue
        phases.append(Phase(config.name, kind, controller, config.until == "impact", config.for_s))
    if faults:
        raise ScenarioFaults(faults)
    return PhaseMachine(phases)


def unwatched_overlaps(assembly: Assembly) -> Iterator[tuple[str, str]]:
    """Names of geom pairs that overlap at the start and are neither impact pairs nor ignored."""
    watch = ContactWatch(assembly.system.mj, assembly.data, assembly.known_pairs)
    watch.look(0.0)
    for record in watch.finish(0.0):
        yield record.geoms[0], record.geoms[1]
