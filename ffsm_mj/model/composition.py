"""Composition of robot and objects to one compiled system."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from threading import Lock
from typing import Any
from warnings import catch_warnings

import mujoco

from ffsm_mj.errors import InputError
from ffsm_mj.model.actuators import actuator_faults, effort_limits, smooth_controllers
from ffsm_mj.model.added_sensors import AddedSensor, add_sensors
from ffsm_mj.model.conservative import (
    base_armatures,
    fluid_faults,
    friction_faults,
    gravity_of,
    magnetic_of,
    model_faults,
    shared_vector_faults,
)
from ffsm_mj.model.equalities import equality_faults, equality_places
from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.fixed import fixed_model, moving_parts, place
from ffsm_mj.model.grasp import Grasp, join
from ffsm_mj.model.joint_limits import unsupported_limits
from ffsm_mj.model.mujoco_warnings import collected_warnings, warning_lines
from ffsm_mj.model.one_file import add_shared_elements
from ffsm_mj.model.part import Part, part
from ffsm_mj.model.scene import compile_scene, empty_scene, left_out, take_options
from ffsm_mj.model.source import load_spec
from ffsm_mj.model.system import Joint, JointKind, System, Tree, ancestors
from ffsm_mj.model.tendons import armature_faults, limit_faults

_JOINT_KINDS: tuple[JointKind, ...] = ("free", "ball", "slide", "hinge")
_QPOS_SIZE = {"free": 7, "ball": 4, "slide": 1, "hinge": 1}
_DOF_SIZE = {"free": 6, "ball": 3, "slide": 1, "hinge": 1}

# catch_warnings is not thread-safe: two threads could restore Python's warning filters in the wrong order.
_COMPILING = Lock()


def compile_system(
    robot: ModelFiles,
    objects: Mapping[str, ModelFiles],
    *,
    time_step_s: float,
    conservative: bool = True,
    grasp: Grasp | None = None,
    sensors: Sequence[AddedSensor] = (),
) -> System:
    """Compile robot and objects into one model with index maps; nothing is read from disk.

    Runs, analyses and views all use this function. Each model is prepared by :func:`ffsm_mj.model.part.part` and attached,
    fixed objects at their poses. Changed properties are verified in the compiled scene.

    Args:
        robot: MJCF or URDF of the robot: one tree whose root is the base.
        objects: MJCF or URDF of each object by name, which becomes its prefix; one with a pose is fixed.
        time_step_s: Integration step in s.
        conservative: Refuse elements that break the conservation of energy or momentum.
        grasp: Closed grasp: the object is part of the robot's tree, at a pose that is written to the model later.
        sensors: Sensors to add.

    Raises:
        InputError: A model is malformed, does not have exactly one moving tree, moves although it is fixed, or is not
            conservative.
        ScenarioFaults: A site or a property given in the scenario is impossible.
    """
    files = {"robot": robot, **objects}
    scene = empty_scene(time_step_s)
    warned: dict[str, list[str]] = {name: [] for name in ("", *files)}  # by model; those of the scene under the empty name
    # The compiler also issues Python warnings, whose filters are global.
    with mujoco.MjVfs() as vfs, collected_warnings(warned[""]), _COMPILING, catch_warnings(action="ignore"):
        parts, faults = _attach(scene, files, grasp, vfs, warned, conservative=conservative)
        added = add_sensors(scene, sensors, grasped=grasp is not None)
        model = compile_scene(scene, files, vfs)
    model.actuator_actearly[:] = 0  # a force follows from the activation of the same instant, which stages integrate
    smooth_controllers(model)
    changes = tuple(change for each in parts if each.overridden for change in each.overridden.read_back(model))
    faults += model_faults(model, scene, files)
    limits, refused = effort_limits(model, scene, files)
    equalities = equality_places(model, scene, files)
    refused += [*equality_faults(model, equalities), *armature_faults(model, scene, files)]
    refused += [*friction_faults(model, scene, files), *limit_faults(model, scene, files)]
    if refused := actuator_faults(model, scene, files) + refused:
        raise InputError(refused)
    if conservative and faults:
        raise InputError([f"{fault}, or write 'conservative: false' in the scenario" for fault in faults])
    grasped = grasp.tree if grasp is not None else ""
    trees = [_tree(model, name, each.place) for name, each in files.items() if each.pose is None and name != grasped]
    notes = dict.fromkeys(note for each in parts for note in each.notes)  # models of one file have the same
    return System(
        mj=model,
        robot=trees[0],
        objects=tuple(trees[1:]),
        fixed=tuple(fixed_model(model, name) for name, each in files.items() if each.pose is not None),
        files=files,
        faults=tuple(faults),
        notes=(*notes, *warning_lines(warned, files)),
        joints={joint.name: joint for tree in trees for joint in tree.joints},
        changes=changes,
        grasp=grasp,
        grasped=_grasped(model, trees[0], grasp) if grasp is not None else None,
        sensors={name: sensor for each in parts for name, sensor in each.sensors.by_name.items()} | added,
        effort_limits=limits,
        equalities=equalities,
        actuator_delays_s={name: delay for each in parts for name, delay in each.delays_s.items()},
    )


def _attach(
    scene: Any,
    files: Mapping[str, ModelFiles],
    grasp: Grasp | None,
    vfs: Any,
    warned: Mapping[str, list[str]],
    *,
    conservative: bool,
) -> tuple[list[Part], list[str]]:
    """Attach all models to a scene; returns the prepared models, and the faults of their options.

    Raises:
        InputError: MuJoCo refuses a model, a fixed model has moving parts, models have different gravity or magnetic fields,
            or limits are no stops of a joint.
        ScenarioFaults: A site or a property is impossible.
    """
    parts: list[Part] = []
    faults: list[str] = []
    gravity, magnetic = dict[str, tuple[float, ...]](), dict[str, tuple[float, ...]]()
    for name, model_files in files.items():
        with collected_warnings(warned[name]):
            parts.append(part(name, model_files, vfs))
            warned[name].extend(parts[-1].warnings)
            spec = parts[-1].spec
            faults += [] if conservative else fluid_faults(spec, model_files)
            whole = spec if not model_files.body else load_spec(replace(model_files, body=""), vfs)
            parts[-1].notes.extend(left_out(scene, whole, model_files, conservative=conservative))
            gravity[name] = gravity_of(spec, model_files)
            magnetic |= magnetic_of(spec, name)
            take_options(scene, spec, gravity[name], conservative=conservative)
            if grasp is not None and name == grasp.tree:
                join(scene, spec, grasp)
            else:
                scene.attach(spec, prefix=f"{name}/", frame=place(scene, name, model_files.pose))
    parts[0].notes.extend(add_shared_elements(scene, files, lambda each: load_spec(each, vfs)))
    refused = [
        *moving_parts(scene, files),
        *unsupported_limits(scene, files),
        *base_armatures(scene, files),
        *([] if conservative else shared_vector_faults("gravity", {n: g for n, g in gravity.items() if any(g)}, files)),
        *shared_vector_faults("magnetic field", magnetic, files),
    ]
    if refused:
        raise InputError(refused)
    return parts, faults


def _tree(model: Any, name: str, place: str) -> Tree:
    """Index map of one attached model.

    Raises:
        InputError: The file has no moving body, or several that are not connected.
    """
    bodies = [i for i in range(1, model.nbody) if model.body(i).name.startswith(f"{name}/")]
    roots = [i for i in bodies if model.body_parentid[i] == 0 and model.body_dofnum[model.body_rootid == i].sum() > 0]
    if len(roots) != 1:
        found = ", ".join(model.body(i).name.split("/", 1)[1] for i in roots) or "none"
        raise InputError(
            f"{place}: a model must be one tree of moving bodies below <worldbody>; found {len(roots)} ({found}). "
            + (
                "Give the root body a <freejoint/> or slide and hinge joints"
                if not roots
                else "Name one with 'body' beside 'mjcf', or all of them with 'scene: {mjcf: FILE, robot: BODY}'"
            )
        )
    members = tuple(i for i in range(1, model.nbody) if model.body_rootid[i] == roots[0])  # including a grasped object
    joints = tuple(_joint(model, j) for j in range(model.njnt) if model.jnt_bodyid[j] in members)
    base = [joint for joint in joints if joint.body == roots[0]]
    if not base:
        raise InputError(
            f"{place}: the root body {model.body(roots[0]).name.split('/', 1)[1]!r} has no joint, so it cannot float"
        )
    return Tree(
        name=name,
        root=roots[0],
        bodies=members,
        joints=joints,
        dofs=slice(joints[0].dofs.start, joints[-1].dofs.stop),
        base_dofs=slice(base[0].dofs.start, base[-1].dofs.stop),
    )


def _grasped(model: Any, robot: Tree, grasp: Grasp) -> Tree:
    """A grasped object: a part of the tree of the robot, whose base and dofs are its own."""
    root = int(model.body(grasp.root).id)
    bodies = tuple(body for body in robot.bodies if root in ancestors(model, body))
    joints = tuple(joint for joint in robot.joints if joint.body in bodies)
    return Tree(grasp.tree, root, bodies, joints, robot.dofs, robot.base_dofs)


def _joint(model: Any, j: int) -> Joint:
    kind = _JOINT_KINDS[model.jnt_type[j]]
    q, v = int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j])
    return Joint(
        model.joint(j).name, kind, slice(q, q + _QPOS_SIZE[kind]), slice(v, v + _DOF_SIZE[kind]), int(model.jnt_bodyid[j])
    )
