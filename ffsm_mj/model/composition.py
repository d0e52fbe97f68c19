"""Composition of robot and objects to one compiled system."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from threading import Lock
from typing import Any, NamedTuple
from warnings import catch_warnings

import mujoco
import numpy as np

from ffsm_mj.errors import Fault, InputError, ScenarioFaults
from ffsm_mj.model.actuators import actuator_faults, dampers_to_targets, effort_limits, smooth_controllers
from ffsm_mj.model.cones import add_cones
from ffsm_mj.model.decompose import decomposed_geoms
from ffsm_mj.model.edits import add_flex, add_sites, make_motors, strip
from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.grasp import Grasp, join
from ffsm_mj.model.height_fields import fixed_terrain
from ffsm_mj.model.inputs import ambiguous_inputs, separate_inputs
from ffsm_mj.model.magnetorquers import Magnetorquer, add_magnetorquers
from ffsm_mj.model.mujoco_process import collected_warnings, warning_lines
from ffsm_mj.model.one_file import add_shared_elements
from ffsm_mj.model.overrides import ModelOverrides, override
from ffsm_mj.model.places import Places
from ffsm_mj.model.properties import Pose
from ffsm_mj.model.sensors import AddedSensor, ModelSensor, add_sensors, sensors_of_model
from ffsm_mj.model.settings import outermost_faults, setting_faults, setting_notes
from ffsm_mj.model.source import REFUSALS, compile_spec, describe_error, load_completely, load_spec, warnings_alone
from ffsm_mj.model.system import FixedModel, Joint, JointKind, System, Tree, ancestors
from ffsm_mj.model.unsupported import (
    FLUID,
    authored_options,
    conservation_faults,
    empty_ranges,
    equality_places,
    equality_refusals,
    fluid_faults,
    gravity_of,
    number_faults,
    refusals,
    scene_faults,
    shared_vector_faults,
)

# With MuJoCo's default of 1e-6, distances of cylinders and ellipsoids are wrong by 7e-7 m, and normals flip near contact.
_CCD_TOLERANCE = 1e-12
_CCD_ITERATIONS = 200

_SCENE_OPTIONS = tuple(name for name in dir(mujoco.MjSpec().option) if not name.startswith("_"))
_GEOM_CONTACT = ("condim", "friction", "gap", "margin", "priority", "solimp", "solmix", "solref")
_PAIR_CONTACT = ("condim", "friction", "gap", "margin", "solimp", "solref", "solreffriction")
_SIZES = ("memory", "nconmax", "njmax", "nemax", "nstack", "nuserdata")
_JOINT_KINDS: tuple[JointKind, ...] = ("free", "ball", "slide", "hinge")
_QPOS_SIZE = {"free": 7, "ball": 4, "slide": 1, "hinge": 1}
_DOF_SIZE = {"free": 6, "ball": 3, "slide": 1, "hinge": 1}

# catch_warnings is not thread-safe: two threads could restore Python's warning filters in the wrong order.
_COMPILING = Lock()


class Part(NamedTuple):
    """A prepared model.

    Attributes:
        spec: Its specification; all its elements have names.
        notes: Removed elements, and ignored settings, as text.
        overridden: Changed properties, to be verified in the compiled scene; None if there are none.
        warnings: MuJoCo's warnings about the model compiled alone.
        sensors: Its sensors by full name.
        delays_s: Delays of its actuators by full name, s.
    """

    spec: Any
    notes: list[str]
    overridden: ModelOverrides | None
    warnings: tuple[str, ...]
    sensors: dict[str, ModelSensor]
    delays_s: dict[str, float]


def part(name: str, files: ModelFiles, vfs: Any) -> Part:
    """Prepare one model: remove elements, make servos motors, change properties, add sites and flexible drives, in order.

    Args:
        name: Name of the model in the scene.
        files: Files of the model, and what to change.
        vfs: MuJoCo's virtual files; those of the model are added. They are needed until the scene is compiled.

    Raises:
        InputError: MuJoCo refuses the model, a joint has an empty range, a setting would make another plant of it, or a
            sensor cannot be measured.
        ScenarioFaults: A site, a flexible drive or a property is impossible.
    """
    spec, timing, notes = load_completely(files, vfs)
    removed = strip(spec, files.strip)
    notes += [f"removed from {name}: {'; '.join(removed)}"] if removed else []
    make_motors(spec, files.motors)
    for key in spec.keys:  # keyframes have a value per control and activation; they are not used here
        key.ctrl, key.act = [], []
    notes += setting_notes(spec, name, files)
    notes += [
        f"{files.place}: interp of {what} has no effect: delayed values are those of the last sample"
        for what in timing.interpolated
    ]
    findings = ((kind, f"{name}/{element}", what) for kind, element, what in (*empty_ranges(spec), *ambiguous_inputs(spec)))
    faults = Places(spec, {name: files}).sentences(findings)
    if faults := [*faults, *setting_faults(spec, files), *outermost_faults(spec, files)]:
        raise InputError(faults)
    overridden = override(spec, name, files, vfs) if files.overrides else None
    warnings = overridden.warnings if overridden is not None else warnings_alone(files, vfs)
    keys = ("robot",) if name == "robot" else ("objects", name)
    add_sites(spec, files.sites, keys)
    add_cones(spec, files.cones, keys, fixed=files.pose is not None)
    add_flex(spec, files.flex)
    sensors, further = sensors_of_model(spec, name, files, timing)
    controllers = {actuator.name: actuator.name for actuator in spec.actuators} | separate_inputs(spec)
    delays, of_file = timing.actuator_delays_s, controllers.items()
    delays_s = {f"{name}/{actuator}": delays[controller] for actuator, controller in of_file if controller in delays}
    return Part(spec, notes + further, overridden, warnings, sensors, delays_s)


def _empty_scene(time_step_s: float) -> Any:
    """An empty scene: no gravity, contacts without force, RK4 with a step of ``time_step_s``."""
    scene = mujoco.MjSpec()
    scene.modelname = "ffsm-mj scene"
    scene.option.gravity = [0.0, 0.0, 0.0]
    scene.option.timestep = time_step_s
    scene.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    scene.option.ccd_tolerance = _CCD_TOLERANCE
    scene.option.ccd_iterations = _CCD_ITERATIONS
    # Contact models replace MuJoCo's contact forces, its joint limits and its dry friction, which are soft, and rows its
    # equality constraints; an automatic reset would hide that a run diverges.
    # Sensors are evaluated at their own times.
    for flag in ("CONTACT", "LIMIT", "FRICTIONLOSS", "EQUALITY", "AUTORESET", "SENSOR"):
        scene.option.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))
    return scene


def _compile_scene(scene: Any, files: Mapping[str, ModelFiles], vfs: Any) -> Any:
    """Compile the scene, and refuse values that MuJoCo accepts but a simulation cannot use."""
    try:
        model = compile_spec(scene, vfs)
    except REFUSALS as error:
        _refuse_overrides(files, vfs)
        raise InputError(describe_error(files.values(), vfs, error)) from error
    # Masses of fixed bodies are zero, so that sums over bodies leave them out.
    bodies = [body for name, file in files.items() if file.pose is not None for body in _fixed_model(model, name).bodies]
    if bodies:
        for numbers in (model.body_mass, model.body_inertia, model.body_subtreemass):
            numbers[bodies] = 0.0
        model.body_subtreemass[0] = model.body_mass.sum()
    if faults := Places(scene, files).sentences(number_faults(model)):
        raise InputError(faults)
    return model


def _refuse_overrides(files: Mapping[str, ModelFiles], vfs: Any) -> None:
    """Refuse changed properties with which a model no longer compiles.

    Raises:
        ScenarioFaults: There is such a model.
    """
    for name, file in files.items():
        if file.overrides:
            spec = load_spec(file, vfs)
            override(spec, name, file, vfs)
            try:
                compile_spec(spec, vfs)
            except REFUSALS as error:
                text = " ".join(str(error).split())
                fault = Fault(f"MuJoCo refuses the model with these properties: {text}", (file.overrides[-1].key, name))
                raise ScenarioFaults([fault]) from error


def _take_options(scene: Any, spec: Any, gravity: tuple[float, ...], *, conservative: bool) -> None:
    """Make the options of scene and model equal before attaching: the scene's, with the surroundings that it may adopt.

    Args:
        scene: The scene.
        spec: The model.
        gravity: Gravity of the model, m/s^2.
        conservative: Whether the scenario must be conservative.
    """
    if "magnetic" in authored_options(spec):
        scene.option.magnetic = spec.option.magnetic
    if not conservative:
        if any(gravity):
            scene.option.gravity = gravity
        for name in FLUID:
            if np.any(getattr(spec.option, name)):
                setattr(scene.option, name, getattr(spec.option, name))
    for name in _SCENE_OPTIONS:
        setattr(spec.option, name, getattr(scene.option, name))
    for name in _SIZES:
        setattr(spec, name, getattr(scene, name))


def _left_out(scene: Any, spec: Any, files: ModelFiles, *, conservative: bool) -> Iterator[str]:
    """One note that lists what a model file says of the simulator and the surroundings and a scene leaves out, if anything.

    A conservative scene is a vacuum without gravity. Others adopt gravity and the medium of their models.

    Args:
        scene: Specification of the scene, with its own options.
        spec: Specification of the model, with the options of its file.
        files: Its files.
        conservative: Whether the scenario must be conservative.
    """
    adopted = {"magnetic", "gravity", *(() if conservative else FLUID)}
    options = [
        name
        for name in authored_options(spec)
        if name not in adopted and not np.array_equal(getattr(spec.option, name), getattr(scene.option, name))
    ]
    weight = gravity_of(spec, files) if conservative else ()
    compensated = conservative and any(body.gravcomp for body in spec.bodies)
    blank = mujoco.MjSpec()
    listed = [
        *([f"gravity {' '.join(f'{value:g}' for value in weight)}"] if any(weight) else ()),
        *(["gravcomp"] if compensated else ()),
        *options,
        *_differing(spec.geoms, blank.worldbody.add_geom(), _GEOM_CONTACT, "geoms"),
        *_differing(spec.pairs, blank.add_pair(), _PAIR_CONTACT, "pairs"),
    ]
    if listed:
        yield (
            f"{files.place}: left out, since the scenario has its own ('time_step_s', 'contacts', and 'conservative: false' "
            f"for gravity and fluids): {', '.join(listed)}"
        )


def _differing(elements: Any, default: Any, names: Iterable[str], noun: str) -> Iterator[str]:
    """Attributes that differ from MuJoCo's defaults in some element, as a phrase; none if there are none."""

    def differs(element: Any, name: str) -> bool:  # a specification marks a number that its file does not give by NaN
        return not np.array_equal(getattr(element, name), getattr(default, name), equal_nan=True)

    if differing := [name for name in names if any(differs(element, name) for element in elements)]:
        yield f"{', '.join(differing)} of {noun}"


def compile_system(
    robot: ModelFiles,
    objects: Mapping[str, ModelFiles],
    *,
    time_step_s: float,
    conservative: bool = True,
    grasp: Grasp | None = None,
    sensors: Sequence[AddedSensor] = (),
    magnetorquers: Sequence[Magnetorquer] = (),
) -> System:
    """Compile robot and objects into one model with index maps; nothing is read from disk.

    Runs, analyses and views all use this function. Each model is prepared and attached, fixed objects at their poses.
    Changed properties are verified in the compiled scene.

    Args:
        robot: MJCF or URDF of the robot: one tree whose root is the base.
        objects: MJCF or URDF of each object by name, which becomes its prefix; one with a pose is fixed.
        time_step_s: Integration step in s.
        conservative: Refuse elements that break the conservation of energy or momentum.
        grasp: Closed grasp: the object is part of the robot's tree, at a pose that is written to the model later.
        sensors: Sensors to add.
        magnetorquers: Magnetorquers to add.

    Raises:
        InputError: A model is malformed, does not have exactly one moving tree, moves although it is fixed, or is not
            conservative.
        ScenarioFaults: A site or a property given in the scenario is impossible.
    """
    files = {"robot": robot, **objects}
    scene = _empty_scene(time_step_s)
    warned: dict[str, list[str]] = {name: [] for name in ("", *files)}  # by model; those of the scene under the empty name
    # The compiler also issues Python warnings, whose filters are global.
    with mujoco.MjVfs() as vfs, collected_warnings(warned[""]), _COMPILING, catch_warnings(action="ignore"):
        parts, faults = _attach(scene, files, grasp, vfs, warned, conservative=conservative)
        add_magnetorquers(scene, magnetorquers)
        added = add_sensors(scene, sensors, grasped=grasp is not None)
        model = _compile_scene(scene, files, vfs)
    model.actuator_actearly[:] = 0  # a force follows from the activation of the same instant, which stages integrate
    smooth_controllers(model)
    changes = tuple(change for changed in parts if changed.overridden for change in changed.overridden.read_back(model))
    dampers_to_targets(model)
    places = Places(scene, files)
    faults += places.sentences(conservation_faults(model))
    (limits, of_limits), equalities = effort_limits(model), equality_places(model, places)
    added_names = {one.name for one in magnetorquers}  # the model has no force of theirs
    of_actuators = [fault for fault in actuator_faults(model) if fault[1] not in added_names]
    refused = places.sentences((*of_actuators, *of_limits, *refusals(model)))
    refused += [f"{where} {what}" for e, where in equalities.items() for what in equality_refusals(model, e)]
    if refused:
        raise InputError(refused)
    if conservative and faults:
        raise InputError([f"{fault}, or write 'conservative: false' in the scenario" for fault in faults])
    grasped = grasp.tree if grasp is not None else ""
    trees = [_tree(model, name, file.place) for name, file in files.items() if file.pose is None and name != grasped]
    notes = dict.fromkeys(note for part in parts for note in part.notes)  # models of one file have the same
    return System(
        mj=model,
        robot=trees[0],
        objects=tuple(trees[1:]),
        fixed=tuple(_fixed_model(model, name) for name, file in files.items() if file.pose is not None),
        files=files,
        faults=tuple(faults),
        notes=(*notes, *warning_lines(warned, {name: file.place for name, file in files.items()})),
        joints={joint.name: joint for tree in trees for joint in tree.joints},
        changes=changes,
        grasp=grasp,
        grasped=_grasped(model, trees[0], grasp) if grasp is not None else None,
        sensors={name: sensor for part in parts for name, sensor in part.sensors.items()} | added,
        effort_limits=limits,
        magnetorquers=tuple(magnetorquers),
        equalities=equalities,
        pieces={**fixed_terrain(model, scene, files), **dict(decomposed_geoms(model, files))},
        cones={int(model.geom(f"{name}/{cone.name}").id): cone for name, file in files.items() for cone in file.cones},
        actuator_delays_s={name: delay for part in parts for name, delay in part.delays_s.items()},
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
            parts[-1].notes.extend(_left_out(scene, whole, model_files, conservative=conservative))
            gravity[name] = gravity_of(spec, model_files)
            if "magnetic" in authored_options(spec):
                magnetic[name] = tuple(map(float, spec.option.magnetic))
            _take_options(scene, spec, gravity[name], conservative=conservative)
            if grasp is not None and name == grasp.tree:
                join(scene, spec, grasp)
            else:
                scene.attach(spec, prefix=f"{name}/", frame=place(scene, name, model_files.pose))
    parts[0].notes.extend(add_shared_elements(scene, files, lambda file: load_spec(file, vfs)))
    refused = Places(scene, files).sentences(scene_faults(scene, files))
    if not conservative:
        refused += shared_vector_faults("gravity", {name: vector for name, vector in gravity.items() if any(vector)}, files)
    if refused := [*refused, *shared_vector_faults("magnetic field", magnetic, files)]:
        raise InputError(refused)
    return parts, faults


def place(scene: Any, name: str, pose: Pose | None) -> Any:
    """Frame of a scene to which a model is attached: one of the world, or of a body at the pose at which it is fixed."""
    if pose is None:
        return scene.worldbody.add_frame()
    # MuJoCo reserves the body name "world", so the name is free.
    return scene.worldbody.add_body(name=f"{name}/world", pos=pose.position_m, quat=pose.quaternion).add_frame()


def _fixed_model(model: Any, name: str) -> FixedModel:
    """Index map of one fixed model of a compiled scene."""
    root = int(model.body(f"{name}/world").id)
    return FixedModel(name, root, tuple(np.flatnonzero(model.body_rootid == root).tolist()))


def _tree(model: Any, name: str, place: str) -> Tree:
    """Index map of one attached model.

    Raises:
        InputError: The file has no moving body, or several that are not connected.
    """
    bodies = [i for i in range(1, model.nbody) if model.body(i).name.startswith(f"{name}/")]
    roots = [i for i in bodies if model.body_parentid[i] == 0 and model.body_dofnum[model.body_rootid == i].sum() > 0]
    if len(roots) != 1:
        tops = ", ".join(model.body(i).name.split("/", 1)[1] for i in roots) or "none"
        raise InputError(
            f"{place}: a model must be one tree of moving bodies below <worldbody>; found {len(roots)} ({tops}). "
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
