"""The compiled scene: one MuJoCo model of robot and objects, with index maps of their trees and joints.

Attached models get the prefixes ``robot/`` and ``<object>/``. Frames: world, unless a name says otherwise. A free joint's
``qvel`` is the linear velocity of the body frame's origin in world axes, then the angular velocity in body axes.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.errors import full_name, names_like
from ffsm_mj.model.cones import ConeConfig
from ffsm_mj.model.files import ModelFiles, logged_name, stored_with
from ffsm_mj.model.grasp import Grasp
from ffsm_mj.model.magnetorquers import Magnetorquer
from ffsm_mj.model.properties import PropertyChange
from ffsm_mj.model.sensors import ModelSensor
from ffsm_mj.polytope import Polytope

JointKind = Literal["free", "ball", "slide", "hinge"]
_JOINT, _SITE = int(mujoco.mjtWrap.mjWRAP_JOINT), int(mujoco.mjtWrap.mjWRAP_SITE)
_SPHERE, _CYLINDER = int(mujoco.mjtWrap.mjWRAP_SPHERE), int(mujoco.mjtWrap.mjWRAP_CYLINDER)


def ancestors(model: Any, body: int) -> Iterator[int]:
    """A body and all bodies above it, up to the base."""
    while body:
        yield body
        body = int(model.body_parentid[body])


def driven_bodies(model: Any, actuator: int) -> list[int]:
    """Bodies that an actuator acts on: those of its joint, of its sites, or of what its tendon is attached to."""
    kind = mujoco.mjtTrn(int(model.actuator_trntype[actuator]))
    targets = [target for target in model.actuator_trnid[actuator].tolist() if target >= 0]
    if kind == mujoco.mjtTrn.mjTRN_TENDON:
        return tendon_bodies(model, targets[0])
    if kind in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
        return [int(model.jnt_bodyid[targets[0]])]
    return targets if kind == mujoco.mjtTrn.mjTRN_BODY else model.site_bodyid[targets].tolist()


def followers(model: Any) -> dict[int, int]:
    """Joints that follow another one by an active equality constraint: id of the joint that leads by id of the follower."""
    active = (model.eq_active0 != 0) & (model.eq_type == mujoco.mjtEq.mjEQ_JOINT) & (model.eq_obj2id >= 0)
    return dict(zip(model.eq_obj1id[active].tolist(), model.eq_obj2id[active].tolist(), strict=True))


def is_fixed_tendon(model: Any, tendon: int) -> bool:
    """Whether a tendon is a combination of joint coordinates, not a string."""
    return int(model.wrap_type[model.tendon_adr[tendon]]) == _JOINT


def tendon_unit(model: Any, tendon: int) -> str:
    """Unit of its length: ``rad`` for a combination of hinges alone, else ``m``."""
    path = range(int(model.tendon_adr[tendon]), int(model.tendon_adr[tendon] + model.tendon_num[tendon]))
    hinges = all(
        model.wrap_type[i] == _JOINT and model.jnt_type[model.wrap_objid[i]] == mujoco.mjtJoint.mjJNT_HINGE for i in path
    )
    return "rad" if hinges else "m"


def tendon_bodies(model: Any, tendon: int) -> list[int]:
    """Bodies that a tendon is attached to: those of its joints, of its sites and of the geoms that it wraps."""
    first, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
    attached = [(int(model.wrap_type[i]), int(model.wrap_objid[i])) for i in range(first, first + count)]
    bodies = {_JOINT: model.jnt_bodyid, _SITE: model.site_bodyid, _SPHERE: model.geom_bodyid, _CYLINDER: model.geom_bodyid}
    return [int(bodies[kind][element]) for kind, element in attached if kind in bodies]  # pulleys are on no body


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
class FixedModel:
    """One model that is fixed to the world.

    Attributes:
        name: Key of the object in the scenario.
        root: Id of the body that represents the ``<worldbody>`` of its file, at its pose.
        bodies: Ids of all its bodies, root first.
    """

    name: str
    root: int
    bodies: tuple[int, ...]


@dataclass(frozen=True)
class System:
    """A compiled scene: robot and objects, contacts without force, no gravity if it must be conservative.

    Attributes:
        mj: The MuJoCo model (RK4, contacts disabled, autoreset off).
        robot: Tree of the FFSM.
        objects: Trees of the floating objects, in the order of the scenario.
        fixed: Objects that are fixed to the world, in the order of the scenario.
        files: Files of each model by tree name.
        effort_limits: Least and greatest effort of each actuator by the limits of its joint, N or N m, (nu, 2).
        faults: Elements that break the balance of energy or momentum, as text. Gravity is none: it enters the balance.
        notes: Elements removed from models, settings of the MJCF that are ignored, and MuJoCo's warnings.
        changes: Properties of bodies and geoms given in the scenario, with their compiled values.
        grasp: The closed grasp, which makes an object part of the robot's tree; None in the initial scene.
        grasped: The grasped object: its bodies and joints, and the dofs of the tree that it is a part of; None without one.
        sensors: Sensors of the models by full name, in MuJoCo's order.
        actuator_delays_s: Delays of actuators in the model files by full name, s.
        magnetorquers: Magnetorquers that the scenario adds.
        equalities: Places of the equality constraints that are active from the start, by their ids in the model.
        pieces: Convex pieces of geoms that are not convex, by geom id, in the axes of the geom.
        cones: Inner surfaces of cones by the ids of the geoms that stand for them.
    """

    mj: Any
    robot: Tree
    objects: tuple[Tree, ...]
    fixed: tuple[FixedModel, ...]
    files: Mapping[str, ModelFiles]
    effort_limits: FloatArray
    faults: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    joints: Mapping[str, Joint] = field(default_factory=dict)
    changes: tuple[PropertyChange, ...] = ()
    grasp: Grasp | None = None
    grasped: Tree | None = None
    sensors: Mapping[str, ModelSensor] = field(default_factory=dict)
    actuator_delays_s: Mapping[str, float] = field(default_factory=dict)
    magnetorquers: tuple[Magnetorquer, ...] = ()
    equalities: Mapping[int, str] = field(default_factory=dict)
    pieces: Mapping[int, tuple[Polytope, ...]] = field(default_factory=dict)
    cones: Mapping[int, ConeConfig] = field(default_factory=dict)

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
        return {
            logged_name(stored_with(tree, self.files), name): data
            for tree, file in self.files.items()
            for name, data in file.files.items()
        }

    @cached_property
    def fixed_bodies(self) -> frozenset[int]:
        """Ids of all bodies of fixed objects."""
        return frozenset(body for fixed_model in self.fixed for body in fixed_model.bodies)

    @cached_property
    def projectors(self) -> dict[str, tuple[FloatArray, ...]]:
        """Cache of :func:`ffsm_mj.dynamics.rigid_body.free_projectors` by tree, shared by all copies."""
        return {}

    def copy(self) -> System:
        """A copy with its own MuJoCo model; names and projectors that are found for one serve all."""
        other = replace(self, mj=copy.copy(self.mj))
        vars(other).update(_names=self._names, projectors=self.projectors)
        return other

    @cached_property
    def _names(self) -> dict[str, tuple[str, ...]]:
        return {}  # by kind, filled on demand

    def names(self, kind: str) -> tuple[str, ...]:
        """Full names of all elements of a kind, such as ``body``, ``joint``, ``geom``, ``site`` or ``sensor``."""
        if kind not in self._names:
            count = {
                "body": self.mj.nbody,
                "joint": self.mj.njnt,
                "geom": self.mj.ngeom,
                "site": self.mj.nsite,
                "sensor": self.mj.nsensor,
                "tendon": self.mj.ntendon,
            }
            named = (getattr(self.mj, kind)(i).name for i in range(count.get(kind, self.mj.nu)))
            self._names[kind] = tuple(name for name in named if name and name != "world")
        return self._names[kind]

    def resolve(self, kind: str, name: str) -> str:
        """Full name of an element; the prefix may be left out if the rest of the name is unique.

        Raises:
            LookupError: No such element, or more than one; the message lists the valid names.
        """
        return full_name(kind, name, self.names(kind))

    def limited(self, name: str) -> tuple[str, bool]:
        """Full name of a joint or tendon, and whether it is one with limits.

        Raises:
            LookupError: See :meth:`resolve`.
        """
        try:
            joint = self.resolve("joint", name)
        except LookupError:
            if not names_like(name, self.names("tendon")):
                raise
            tendon = self.resolve("tendon", name)
            return tendon, bool(self.mj.tendon_limited[self.mj.tendon(tendon).id])
        return joint, bool(self.mj.jnt_limited[self.mj.joint(joint).id])

    def index(self, kind: str, name: str) -> int:
        """MuJoCo id of an element by full or unambiguous name.

        Raises:
            LookupError: See :meth:`resolve`.
        """
        return int(getattr(self.mj, kind)(self.resolve(kind, name)).id)

    def for_law_of(self, name: str) -> System:
        """The same scene for a control law that drives an object, which takes the place of the robot in it.

        Args:
            name: Name of the object, which moves. A grasped one keeps its own joints, and moves with all others of the tree.
        """
        if self.grasped is not None and self.grasped.name == name:
            return replace(self, robot=self.grasped)
        driven = next(tree for tree in self.objects if tree.name == name)
        return replace(self, robot=driven, objects=tuple(tree for tree in self.trees if tree is not driven))

    @cached_property
    def dof_trees(self) -> IntArray:
        """Index in ``trees`` of the tree of each degree of freedom, (nv,)."""
        trees = np.zeros(self.mj.nv, dtype=np.intp)
        for i, tree in enumerate(self.trees):
            trees[tree.dofs] = i
        return trees

    @cached_property
    def actuator_trees(self) -> tuple[int, ...]:
        """Index in ``trees`` of the tree that each actuator drives, by its transmission; -1: none that moves, (nu,)."""
        of_body = {body: i for i, tree in enumerate(self.trees) for body in tree.bodies}
        moved = ([of_body[body] for body in driven_bodies(self.mj, i) if body in of_body] for i in range(self.mj.nu))
        return tuple(trees[0] if trees else -1 for trees in moved)

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


class SharedJoints(NamedTuple):
    """Places of shared joints in two systems, in the same order in both.

    Attributes:
        qpos: Indices in ``qpos`` of the first system, and of the second, (n,) each.
        dofs: Indices in ``qvel`` of the first system, and of the second, (m,) each.
    """

    qpos: tuple[IntArray, IntArray]
    dofs: tuple[IntArray, IntArray]


def shared_joints(first: System, second: System) -> SharedJoints:
    """Joints that have the same name in both systems."""
    names = [name for name in first.joints if name in second.joints]
    systems = [[system.joints[name] for name in names] for system in (first, second)]
    qpos, dofs = ([_indices([getattr(joint, key) for joint in joints]) for joints in systems] for key in ("qpos", "dofs"))
    return SharedJoints((qpos[0], qpos[1]), (dofs[0], dofs[1]))


def _indices(parts: list[slice]) -> IntArray:
    return np.array([i for part in parts for i in range(part.start, part.stop)], dtype=np.intp)


_BALANCED = 1e-9
"""Relative difference of principal inertias, and offset of the mass centre from the axis in m, that count as rounding."""


def rotors(system: System) -> tuple[Joint, ...]:
    """Joints of the rotors of reaction wheels, in the order of the model.

    A rotor is a body without children that one unlimited hinge joins to the base of the robot, with a driven joint, its mass
    centre on the axis and its inertia symmetric about it. Its momentum is then the spin I_a times the joint rate along the
    axis, in addition to what it has as a part of the base.
    """
    return tuple(joint for joint in system.robot.joints if joint.kind == "hinge" and not rotor_fault(system, joint))


def rotor_fault(system: System, joint: Joint) -> str:
    """Why a joint of the robot carries no rotor, as text; empty if it does (see :func:`rotors`)."""
    model, body, index = system.mj, joint.body, int(system.mj.joint(joint.name).id)
    name = model.body(body).name
    parent, children = int(model.body_parentid[body]), np.flatnonzero(model.body_parentid == body).tolist()
    on_joint = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)
    conditions = (
        (joint.kind != "hinge", f"its joint is a {joint.kind}, not a hinge"),
        (parent != system.robot.root, f"the body {name!r} is not on the robot's base but on {model.body(parent).name!r}"),
        (model.body_jntnum[body] > 1, f"the body {name!r} has {model.body_jntnum[body]} joints, not one"),
        (children, f"the body {name!r} carries another one, {model.body(children[0] if children else 0).name!r}"),
        (model.jnt_limited[index], "its hinge has limits (range)"),
        (index not in model.actuator_trnid[on_joint, 0], "no actuator drives its hinge"),
    )
    return next((why for fails, why in conditions if fails), "") or _imbalance(model, body, index)


def _imbalance(model: Any, body: int, joint: int) -> str:
    """Why a body is not balanced about its hinge, as text; empty if it is."""
    axis, name = model.jnt_axis[joint], model.body(body).name
    offset = float(np.linalg.norm(np.cross(model.body_ipos[body] - model.jnt_pos[joint], axis)))
    if offset > _BALANCED:
        return f"the centre of mass of {name!r} is {offset:.3g} m off the axis, more than {_BALANCED:g} m"
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body])
    frame = turn.reshape(3, 3)
    inertia = (frame * model.body_inertia[body]) @ frame.T
    across = np.eye(3) - np.outer(axis, axis)
    # Symmetric about the axis: the axis is principal, and the part across it is a multiple of the identity there.
    rest = across @ inertia @ across - 0.5 * np.trace(across @ inertia @ across) * across
    products = across @ inertia @ axis
    uneven = max(np.abs(rest).max(), np.abs(products).max()) / float(np.trace(inertia))
    if uneven > _BALANCED:
        return f"the inertia of {name!r} about the axis is not symmetric, by {uneven:.3g} of its trace (up to {_BALANCED:g})"
    return ""


def stiffness_coefficients(model: Any) -> FloatArray:
    """Coefficients (a, b, c) of the spring of each joint, (njnt, 3)."""
    return np.column_stack((model.jnt_stiffness, model.jnt_stiffnesspoly.reshape(model.njnt, -1)))


def damping_coefficients(model: Any) -> FloatArray:
    """Coefficients (a, b, c) of the damper of each degree of freedom, (nv, 3)."""
    return np.column_stack((model.dof_damping, model.dof_dampingpoly.reshape(model.nv, -1)))


def has_springs_or_dampers(model: Any) -> bool:
    """Whether any joint or tendon has a spring or a damper; cheaper than their coefficients."""
    arrays = (
        *(model.jnt_stiffness, model.dof_damping, model.jnt_stiffnesspoly, model.dof_dampingpoly),
        *(model.tendon_stiffness, model.tendon_damping, model.tendon_stiffnesspoly, model.tendon_dampingpoly),
    )
    return any(array.any() for array in arrays)


def tendon_stiffness_coefficients(model: Any) -> FloatArray:
    """Coefficients (a, b, c) of the spring of each tendon, (ntendon, 3)."""
    return np.column_stack((model.tendon_stiffness, model.tendon_stiffnesspoly))


def tendon_damping_coefficients(model: Any) -> FloatArray:
    """Coefficients (a, b, c) of the damper of each tendon, (ntendon, 3)."""
    return np.column_stack((model.tendon_damping, model.tendon_dampingpoly))
