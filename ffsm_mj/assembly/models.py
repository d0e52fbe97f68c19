"""Models of a scenario: finds and reads their files, compiles the scene and the controller models."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from ffsm_mj.assembly.grasps import GraspedSystem, grasped_systems_of
from ffsm_mj.errors import Faults
from ffsm_mj.model.composition import compile_system
from ffsm_mj.model.decompose import with_pieces
from ffsm_mj.model.edits import AddedSite, motors_of, to_strip
from ffsm_mj.model.files import ModelFiles, read_model
from ffsm_mj.model.grasp import Grasp
from ffsm_mj.model.inline import InlineModel
from ffsm_mj.model.magnetorquers import magnetorquers_of
from ffsm_mj.model.properties import Overrides
from ffsm_mj.model.system import System
from ffsm_mj.scenario.scenario import ScenarioConfig
from ffsm_mj.scenario.source import YamlSource
from ffsm_mj.similar_names import similar_file

_CONTROLLER_MODEL = ("model", "controller_model")
"""Keys of the changes in a controller model: those of the plant come first."""

Reader = Callable[[Path, Sequence[Path], Sequence[Path]], ModelFiles]
"""Function that reads a model, as :func:`ffsm_mj.model.files.read_model`."""


def compile_scenario(
    scenario: ScenarioConfig, source: YamlSource, read: Reader = read_model
) -> tuple[System, System | None, Mapping[str, GraspedSystem]]:
    """Compile robot and objects of a scenario.

    Args:
        scenario: The validated scenario.
        source: Locations of its keys.
        read: Reads a model; a campaign passes a reader that keeps the files.

    Returns:
        The scene, its controller model (None if it is the scene), and the systems with a grasped object by grasp.

    Raises:
        InputError: A file is missing or malformed, or a model is not a free-floating system.
    """
    files = model_files(scenario, source, read)
    with source.locating():
        system = _compiled(scenario, files, "model")
        controller_model = _compiled(scenario, files, *_CONTROLLER_MODEL) if scenario.has_controller_model else None
        grasped = grasped_systems_of(
            scenario,
            system,
            lambda grasp, of_controller: _compiled(
                scenario, files, *(_CONTROLLER_MODEL if of_controller else ("model",)), grasp=grasp
            ),
        )
    return system, controller_model, grasped


def _compiled(scenario: ScenarioConfig, files: Mapping[str, ModelFiles], *keys: str, grasp: Grasp | None = None) -> System:
    """Compile the scene with the changes of these keys, and with a grasped object if a grasp is given.

    Raises:
        ScenarioFaults: See :func:`ffsm_mj.model.composition.compile_system`.
        InputError: See there.
    """
    changed = {
        name: replace(
            file, overrides=tuple(Overrides(key, patch) for key in keys if (patch := getattr(scenario, key).get(name)))
        )
        for name, file in files.items()
    }
    robot = changed.pop("robot")
    if scenario.has_rigid_laws and keys == _CONTROLLER_MODEL:
        robot = replace(robot, flex={})
    added = (config.added(name) for name, config in scenario.sensors.items())
    return compile_system(
        robot,
        changed,
        time_step_s=scenario.time_step_s,
        conservative=scenario.conservative,
        grasp=grasp,
        sensors=[sensor for sensor in added if sensor is not None],
        magnetorquers=magnetorquers_of(scenario.actuators),
    )


def model_files(scenario: ScenarioConfig, source: YamlSource, read: Reader = read_model) -> dict[str, ModelFiles]:
    """Files of all models, the robot's first, with stripped elements and added sites.

    Raises:
        InputError: A file is missing or malformed.
    """
    readers: dict[str, Callable[[], ModelFiles]] = {}
    homes: dict[str, Path | None] = {}
    models = {("robot",): scenario.robot} | {("objects", name): part for name, part in scenario.objects.items()}
    with source.locating(), Faults() as faults:
        for keys, part in models.items():
            inline = part.model if isinstance(part.model, InlineModel) else None
            name = "scene" if part.body else keys[-1]  # models of one file are stored once
            path = source.beside((*keys, "mjcf"), f"{name}.xml" if inline is not None else str(part.model))
            if inline is None and not os.path.isfile(path):  # without an exception for a name that is too long
                what = "is a folder, not a model file:" if os.path.isdir(path) else "no such model file"
                faults.add(f"{what} {path}{similar_file(path)}", *keys, "mjcf")
            folders = []
            for key in ("asset_folders", "package_paths"):
                folders.append(tuple(source.beside((*keys, key), folder) for folder in getattr(part, key)))
                for i, folder in enumerate(folders[-1]):
                    if not os.path.isdir(folder):
                        faults.add(f"no such folder: {folder}", *keys, key, i)
            # A reader keeps files, which those in memory are already.
            reader = partial(read, path) if inline is None else partial(read_model, path, contents=inline.files(path.name))
            readers[keys[-1]] = partial(reader, *folders)
            homes[keys[-1]] = path.parent if inline is None else None
    parts = {keys[-1]: part for keys, part in models.items()}
    kinds = {name: config.kind for name, config in scenario.actuators.items()}
    poses = {name: part.fixed_at for name, part in scenario.objects.items()}
    files = {
        name: replace(
            read_files(),
            strip=to_strip(parts[name].strip, parts[name].limits),
            motors=motors_of(name, kinds),
            pose=poses.get(name),
            body=parts[name].body or "",
            cones=parts[name].cones,
            sites=tuple(AddedSite(site, **dict(added)) for site, added in parts[name].sites.items()),
        )
        for name, read_files in readers.items()
    }
    with source.locating():
        for name, part in parts.items():
            keys = (name,) if name == "robot" else ("objects", name)
            files[name] = with_pieces(files[name], part.decompose, homes[name], keys)
    return files | {"robot": replace(files["robot"], flex=scenario.robot.joint_flex)}
