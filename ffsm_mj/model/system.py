"""Robot and objects composed into one MuJoCo model, with index maps resolved once and frozen.

Attached models get the prefixes ``robot/`` and ``<object>/``. Frames: world, unless a name says otherwise. A free joint's
``qvel`` is the linear velocity of the body frame's origin in world axes, then the angular velocity in body axes.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from threading import Lock
from typing import Any, Literal
from warnings import catch_warnings

import mujoco

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.model.conservative import gravity_faults, gravity_of, model_faults, spec_faults
from ffsm_mj.model.files import ModelFiles, logged_name
from ffsm_mj.model.fixed import FixedModel, fixed_model, moving_parts, place
from ffsm_mj.model.grasp import Grasp, join
from ffsm_mj.model.mujoco_warnings import collected_warnings, warning_lines
from ffsm_mj.model.part import Part, part
from ffsm_mj.model.properties import PropertyChange
from ffsm_mj.model.scene import compile_scene, empty_scene, take_options

JointKind = Literal["free", "ball", "slide", "hinge"]

_JOINT_KINDS: tuple[JointKind, ...] = ("free", "ball", "slide", "hinge")
_QPOS_SIZE = {"free": 7, "ball": 4, "slide": 1, "hinge": 1}
_DOF_SIZE = {"free": 6, "ball": 3, "slide": 1, "hinge": 1}

# catch_warnings is not thread-safe: two threads could restore Python's warning filters in the wrong order.
_COMPILING = Lock()


@dataclass(frozen=True)
class Joint:
    """A joint: its full name, kind, slices of ``qpos`` and ``qvel``, and the id of its body."""

    name: str
    kind: JointKind
    qpos: slice
    dofs: slice
    body: int


@dataclass(frozen=True)
class Tree:
    """One moving tree of bodies: the robot or an object.

    Attributes:
        name: ``robot`` or the object's key in the scenario.
        root: Body id of the root, the base of the robot.
        bodies: Ids of all bodies of the tree, root first.
        joints: All joints, those of the root body first.
        dofs: The tree's slice of ``qvel``.
        base_dofs: The dofs of the root body relative to the world, as a slice of ``qvel``.
    """

    name: str
    root: int
    bodies: tuple[int, ...]
    joints: tuple[Joint, ...]
    dofs: slice
    base_dofs: slice


@dataclass(frozen=True)
class System:
    """A compiled scene: robot and objects, contacts without force, no gravity if it must be conservative.

    Attributes:
        mj: The MuJoCo model (RK4, contacts disabled, autoreset off).
        robot: Tree of the FFSM.
        objects: Trees of the floating objects, in the order of the scenario.
        fixed: Objects that are fixed to the world, in the order of the scenario.
        files: Files of each model by tree name.
        faults: Elements that break the balance of energy or momentum, as text. Gravity is none: it enters the balance.
        notes: Elements removed from models, settings of the MJCF that are ignored (joint limits), and MuJoCo's warnings.
        changes: Properties of bodies and geoms given in the scenario, with their compiled values.
        grasp: The closed grasp, which makes an object part of the robot's tree; None in the initial scene.
    """

    mj: Any
    robot: Tree
    objects: tuple[Tree, ...]
    fixed: tuple[FixedModel, ...]
    files: Mapping[str, ModelFiles]
    faults: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    joints: Mapping[str, Joint] = field(default_factory=dict)
    changes: tuple[PropertyChange, ...] = ()
    grasp: Grasp | None = None

    @property
    def trees(self) -> tuple[Tree, ...]:
        """The tree of the robot, then those of the objects."""
        return (self.robot, *self.objects)

    @property
    def models(self) -> tuple[Tree | FixedModel, ...]:
        """Moving trees, then fixed objects."""
        return (*self.trees, *self.fixed)

    @property
    def logged_files(self) -> dict[str, bytes]:
        """Content of all model files, by their names in logs and run folders."""
        return {logged_name(tree, name): data for tree, each in self.files.items() for name, data in each.files.items()}

    @cached_property
    def fixed_bodies(self) -> frozenset[int]:
        """Ids of all bodies of fixed objects."""
        return frozenset(body for each in self.fixed for body in each.bodies)

    @cached_property
    def projectors(self) -> dict[str, tuple[FloatArray, ...]]:
        """Cache of :func:`ffsm_mj.dynamics.rigid_body.free_projectors` by tree, shared by all parts of a run."""
        return {}

    def copy(self) -> System:
        """A copy with its own MuJoCo model."""
        return replace(self, mj=copy.copy(self.mj))

    @cached_property
    def _names(self) -> dict[str, tuple[str, ...]]:
        return {}  # by kind, filled on demand

    def names(self, kind: str) -> tuple[str, ...]:
        """Full names of all elements of a kind: ``body``, ``joint``, ``geom``, ``site`` or ``actuator``."""
        if kind not in self._names:
            count = {"body": self.mj.nbody, "joint": self.mj.njnt, "geom": self.mj.ngeom, "site": self.mj.nsite}
            named = (getattr(self.mj, kind)(i).name for i in range(count.get(kind, self.mj.nu)))
            self._names[kind] = tuple(name for name in named if name and name != "world")
        return self._names[kind]

    def resolve(self, kind: str, name: str) -> str:
        """Full name of an element; the prefix may be left out if the rest of the name is unique.

        Raises:
            LookupError: No such element, or more than one; the message lists the valid names.
        """
        names = self.names(kind)
        if name in names:
            return name
        matches = [full for full in names if full.split("/", 1)[-1] == name]
        if len(matches) == 1:
            return matches[0]
        if matches:
            raise LookupError(f"{kind} {name!r} is ambiguous; write one of {', '.join(matches)}")
        raise LookupError(unknown_name(kind, name, names))

    def index(self, kind: str, name: str) -> int:
        """MuJoCo id of an element by full or unambiguous name.

        Raises:
            LookupError: See :meth:`resolve`.
        """
        return int(getattr(self.mj, kind)(self.resolve(kind, name)).id)

    def joint(self, name: str) -> Joint:
        """Joint by full or unambiguous name.

        Raises:
            LookupError: See :meth:`resolve`.
        """
        return self.joints[self.resolve("joint", name)]

    def by_joint(self, qvel: FloatArray) -> dict[str, tuple[float, ...]]:
        """Generalised velocities (nv,) by joint."""
        return {name: tuple(qvel[joint.dofs].tolist()) for name, joint in self.joints.items()}

    def tree_of_body(self, body: int) -> Tree | None:
        """Tree of a body; None if it does not move."""
        return next((tree for tree in self.trees if body in tree.bodies), None)


def compile_system(
    robot: ModelFiles,
    objects: Mapping[str, ModelFiles],
    *,
    time_step_s: float,
    conservative: bool = True,
    grasp: Grasp | None = None,
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

    Raises:
        InputError: A model is malformed, does not have exactly one moving tree, moves although it is fixed, or is not
            conservative.
        ScenarioFaults: A site or a property given in the scenario is impossible.
    """
    files = {"robot": robot, **objects}
    scene = empty_scene(time_step_s)
    faults: list[str] = []
    warned: dict[str, list[str]] = {name: [] for name in ("", *files)}  # by model; those of the scene under the empty name
    parts: list[Part] = []
    asked: dict[str, tuple[float, ...]] = {}
    # The compiler also issues Python warnings, whose filters are global.
    with mujoco.MjVfs() as vfs, collected_warnings(warned[""]), _COMPILING, catch_warnings(action="ignore"):
        for name, model_files in files.items():
            with collected_warnings(warned[name]):
                parts.append(part(name, model_files, vfs))
                warned[name] += parts[-1].warnings
                spec = parts[-1].spec
                faults += spec_faults(spec, model_files, conservative=conservative)
                asked[name] = gravity_of(spec, model_files)
                take_options(scene, spec, asked[name], conservative=conservative)
                if grasp is not None and name == grasp.tree:
                    join(scene, spec, grasp)
                else:
                    scene.attach(spec, prefix=f"{name}/", frame=place(scene, name, model_files.pose))
        refused = [*moving_parts(scene, files), *([] if conservative else gravity_faults(asked, files))]
        if refused:
            raise InputError(refused)
        model = compile_scene(scene, files, vfs)
    changes = tuple(change for each in parts if each.overridden for change in each.overridden.read_back(model))
    faults += model_faults(model, scene, files, conservative=conservative)
    if conservative and faults:
        raise InputError([f"{fault}, or write 'conservative: false' in the scenario" for fault in faults])
    held = grasp.tree if grasp is not None else ""
    trees = [_tree(model, name, each.place) for name, each in files.items() if each.pose is None and name != held]
    return System(
        mj=model,
        robot=trees[0],
        objects=tuple(trees[1:]),
        fixed=tuple(fixed_model(model, name) for name, each in files.items() if each.pose is not None),
        files=files,
        faults=tuple(faults),
        notes=(
            *(what for each in parts for what in each.notes),
            *(_notes(model) if conservative else ()),
            *warning_lines(warned, files),
        ),
        joints={joint.name: joint for tree in trees for joint in tree.joints},
        changes=changes,
        grasp=grasp,
    )


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
                else "Put each in a file of its own"
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


def _joint(model: Any, j: int) -> Joint:
    kind = _JOINT_KINDS[model.jnt_type[j]]
    q, v = int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j])
    return Joint(
        model.joint(j).name, kind, slice(q, q + _QPOS_SIZE[kind]), slice(v, v + _DOF_SIZE[kind]), int(model.jnt_bodyid[j])
    )


def _notes(model: Any) -> tuple[str, ...]:
    names = ", ".join(model.joint(j).name for j in range(model.njnt) if model.jnt_limited[j])
    return (f"joint limits are not enforced: {names}",) if names else ()
