"""A scenario to start from for an MJCF file that holds robot, objects and surroundings."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ffsm_mj.assembly.contact_rules import overlapping, resolve_contacts
from ffsm_mj.assembly.initial_state import initial_state
from ffsm_mj.assembly.models import compile_scenario, model_files
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import InputError, ScenarioFaults, one_line
from ffsm_mj.invocation import command
from ffsm_mj.scenario.loading import load_scenario
from ffsm_mj.templates.robot import relative
from ffsm_mj.templates.robot_text import flow, flow_maps
from ffsm_mj.templates.vendor import Decomposable, decomposable, needed_strips
from ffsm_mj.yaml import write_flow


@dataclass(frozen=True)
class SceneRequest:
    """What a scenario is asked for.

    Attributes:
        name: Of the scenario.
        scene: The file.
        robot: Root body of the robot.
        out: Folder to write to.
        decompose: Method for meshes that are not convex; empty: they stay their hulls.
    """

    name: str
    scene: Path
    robot: str
    out: Path
    decompose: str = ""


def write_scene(asked: SceneRequest) -> list[str]:
    """Write a scenario for a scene in one file, which stays as it is; nothing is left of it where it would not do.

    Returns:
        Lines that tell what was written.

    Raises:
        InputError: The scenario exists, or the file cannot be taken.
    """
    path = asked.out / f"{asked.name}.yaml"
    if os.path.lexists(path):
        raise InputError(f"new: {path} exists; nothing is written over it")
    asked.out.mkdir(parents=True, exist_ok=True)
    try:
        path.write_text(_text(asked, {}), encoding="utf-8")
        files = model_files(*load_scenario(path))
        moving = {name: file for name, file in files.items() if file.pose is None}
        strips = {name: strip for name, file in moving.items() if (strip := needed_strips(file))}
        changes = {name: {"strip": flow(words)} for name, words in strips.items()}
        path.write_text(_text(asked, changes), encoding="utf-8")
        decomposed = _decomposed(path, asked) if asked.decompose else {}
        for name, one in decomposed.items():
            if one.wanted:
                changes.setdefault(name, {})["decompose"] = flow_maps(one.data)
        path.write_text(_text(asked, changes), encoding="utf-8")
        overlaps = _overlaps(path)
        path.write_text(_text(asked, changes, overlaps), encoding="utf-8")
        prepared = prepare(path)
    except BaseException as error:
        path.unlink(missing_ok=True)
        if isinstance(error, InputError):
            raise InputError([_of_options(line, path) for line in error.lines]) from error
        raise
    objects = ", ".join(model.name for model in prepared.system.models if model.name != "robot") or "none"
    return [
        f"files in {asked.out}: {path.name}",
        f"robot: {asked.robot}; objects: {objects}",
        f"removed: {'; '.join(f'{name}: {flow(words)}' for name, words in strips.items()) or 'nothing'}",
        *(f"mesh {name}/{line}" for name, one in decomposed.items() for line in one.lines),
        *([f"contacts ignored, as they overlap at the start: {len(overlaps)}"] if overlaps else []),
        f"next: {command('check', path)} && {command('run', path)}",
    ]


def _of_options(line: str, path: Path) -> str:
    """A line about the scenario, which is gone again, as one about the options that it was written from."""
    start = f"{one_line(str(path))}:"
    if not line.startswith(start):
        return line
    rest = re.sub(r"^(\d+:)*\s*", "", line.removeprefix(start))
    for key, option in (("scene.mjcf", "--scene"), ("scene.robot", "--robot")):
        if rest.startswith(f"{key}:"):
            return f"new: {option}{rest.removeprefix(key)}"
    return f"new: as {path.name}: {rest}"


def _overlaps(path: Path) -> list[tuple[str, str]]:
    """Geoms that overlap at the start, as those of a file whose robot stands on its floor by its weight."""
    scenario, source = load_scenario(path)
    system = compile_scenario(scenario, source)[0]
    try:
        data = initial_state(scenario, system).data
        contacts = resolve_contacts(scenario.contacts, system)
    except ScenarioFaults as faulty:
        raise source.located(faulty.faults) from faulty
    return [pair.geoms for pair, _ in overlapping(system, data, contacts)]


def _decomposed(path: Path, asked: SceneRequest) -> dict[str, Decomposable]:
    """Meshes of each model that are not convex."""
    scenario, source = load_scenario(path)
    system = compile_scenario(scenario, source)[0]
    home = asked.scene.parent
    return {name: decomposable(file, system, name, asked.decompose, home) for name, file in system.files.items()}


def _text(asked: SceneRequest, changes: Mapping[str, Mapping[str, str]], overlaps: Sequence[tuple[str, str]] = ()) -> str:
    """The scenario, commented; with the keys that it has for models by name, as YAML, and contacts ignored that overlap."""
    texts = {
        name: f"{{{', '.join(f'{key}: {value}' for key, value in change.items())}}}" for name, change in changes.items()
    }
    robot = [f"robot: {texts['robot']}"] if "robot" in texts else []
    others = [f"  {name}: {text}" for name, text in texts.items() if name != "robot"]
    lines = [
        f"# The scene of {asked.scene.name}. Edit this file freely:",
        f"# 'ffsm check {asked.name}.yaml' validates it; the user guide describes every key.",
        f"name: {write_flow(asked.name)}",
        "duration_s: 4.0",
        "time_step_s: 0.001",
        "accuracy: 1e-9 # steps that are too long for this accuracy are divided",
        "control_period_s: 0.005",
        "",
        "# The robot is one tree of the file. The others are objects with the names of their root bodies, and what the file",
        "# fixes to the world is the object 'surroundings'. Its first keyframe is the initial state.",
        f"scene: {{mjcf: {write_flow(relative(asked.scene, asked.out))}, robot: {write_flow(asked.robot)}}}",
        *(
            ["# 'strip' is removed before compilation, as it is not modelled; 'decompose' makes pieces of meshes."]
            if changes
            else []
        ),
        *robot,
        *(["objects:", *others] if others else []),
        "",
        "# restitution: 1 conserves the energy, 0 gives the largest loss.",
        "contacts:",
        "  default: {restitution: 0.5}",
        "  ignored:",
        "    - {between: [robot, self], reason: links overlap at their joints}",
        *(f"    - {{between: {flow(pair)}, reason: they overlap at the start}}" for pair in overlaps),
        "",
        "phases:",
        "  # Motors are off, and servos keep the pose of the start.",
        '  - {name: coast, until: end, controller: {kind: "off"}}',
    ]
    return "\n".join(lines) + "\n"
