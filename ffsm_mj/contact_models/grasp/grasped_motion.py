"""Motion while a grasp is closed: the object is part of a link of the robot, or joined to it by the joints of the latch.

The model is compiled when the scenario is prepared; the pose of the object on the link, and point and axis of the latch's
joints, are written into the run's own copy. The logged system follows: coordinates and rates of shared joints are copied,
and those of the object's base joints follow from its pose and twist in the moving model, (17).

Inverse kinematics of an object's base joints: coordinates and rates for a given pose and twist of the base, (17).

A free joint takes any pose. Slides followed by a hinge through the base's origin take those of a plane or line, and have a
closed form. Other joints are solved by Newton's method from their last coordinates, so that hinge angles stay continuous.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj._core.state_transfer import StateTransfer
from ffsm_mj._core.steppers import WHOLE_STATE
from ffsm_mj.arrays import FloatArray, numbers
from ffsm_mj.contact_models.grasp.latch_joints import LatchJoints
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.dynamics.motion import Motion, actuator_power, rigid_pairs
from ffsm_mj.dynamics.rigid_body import rotation_matrix
from ffsm_mj.model.grasp import WRITTEN, Grasp
from ffsm_mj.model.system import Joint, System, Tree, shared_joints
from ffsm_mj.state import entries, fitting

_ROUNDING = 1e-15
_MAX_ITERATIONS = 8
"""Largest number of Newton's steps: they start from the last coordinates, and converge quadratically."""
_TWO_PI = 2.0 * math.pi


@dataclass(frozen=True)
class PoseReader:
    """Closed form of the coordinates of slides, and of a hinge after them, as functions of a pose.

    Attributes:
        slides: For each slide, its coordinate at the world origin in m, and its axis in world axes, (number of slides, 4).
        axis: Axis of the hinge, world axes, (3,); None if there is no hinge.
        zero: Angle of the hinge where sine is 0 and cosine is 1, rad.
        sine: Coefficients of the sine of half the hinge angle as a linear function of the quaternion, (4,).
        cosine: Coefficients of its cosine, (4,).
    """

    slides: FloatArray
    axis: FloatArray | None
    zero: float
    sine: FloatArray
    cosine: FloatArray

    @classmethod
    def of(cls, model: Any, root: int, joints: list[Joint]) -> PoseReader | None:
        """Closed form for the joints of a base; None unless their axes are orthonormal and the hinge is at its origin."""
        kinds, first = [joint.kind for joint in joints], int(model.body_jntadr[root])
        slides = len(kinds) - kinds.count("hinge")
        # A hinge before a slide turns its axis, and of two hinges each angle depends on the other: no linear closed form.
        if kinds != ["slide"] * slides + ["hinge"] * (len(kinds) - slides) or len(kinds) > slides + 1:
            return None
        quat = model.body_quat[root]
        axes = model.jnt_axis[first : first + len(kinds)] @ rotation_matrix(quat).T
        along, hinge = axes[:slides], axes[slides:]
        zeros = np.array([model.qpos0[joint.qpos.start] for joint in joints])
        unlike = [np.abs(one @ one.T - np.eye(len(one))).max(initial=0.0) for one in (along, hinge)]
        # Oblique axes need the inverse of their products, and a hinge off the origin moves it along an arc.
        if max(unlike) > _ROUNDING or model.jnt_pos[first + slides : first + len(kinds)].any():
            return None
        rows = np.column_stack((zeros[:slides] - along @ model.body_pos[root], along))
        if not len(hinge):
            return cls(rows, None, 0.0, np.zeros(4), np.zeros(4))
        relative = np.empty((4, 4))  # of each unit quaternion the one that is left of it, in world axes
        for unit, left in zip(np.eye(4), relative, strict=True):
            mujoco.mju_mulQuat(left, unit, quat * (1.0, -1.0, -1.0, -1.0))
        return cls(rows, hinge[0], float(zeros[-1]), relative[:, 1:] @ hinge[0], relative[:, 0].copy())


class BaseJointSolver:
    """Writes coordinates, rates and accelerations of the base joints of one object.

    Attributes:
        free: Whether its only joint is a free joint.
        reading: Closed form for its joints; None if there is none.
        base: Its coordinates, its rates, and the axes of its frame row by row: live arrays.
    """

    def __init__(self, model: Any, data: Any, tree: Tree) -> None:
        """Bind to a system's model and data.

        Args:
            model: MuJoCo model of the system.
            data: Its data.
            tree: The object.
        """
        joints = [joint for joint in tree.joints if joint.body == tree.root]
        self._model, self._data, self._root, self._dofs = model, data, tree.root, tree.base_dofs
        self.free = len(joints) == 1 and joints[0].kind == "free"
        self.reading = None if self.free else PoseReader.of(model, tree.root, joints)
        qpos = data.qpos[joints[0].qpos.start : joints[-1].qpos.stop]
        self.base: tuple[FloatArray, FloatArray, FloatArray] = qpos, data.qvel[self._dofs], data.xmat[tree.root]
        self._qpos, self._qvel, self._axes = map(numbers, self.base)
        self._qacc = numbers(data.qacc[self._dofs])
        self._jacobian, self._rate = np.empty((6, model.nv)), np.empty((6, model.nv))
        self._step, self._turn, self._axis = np.zeros(model.nv), np.empty(3), np.empty(3)
        if (read := self.reading) is not None:
            self._slides: list[list[float]] = read.slides.tolist()
            axis = read.axis
            reading = None if axis is None else (axis.tolist(), read.zero, read.sine.tolist(), read.cosine.tolist())
            self._hinge: tuple[list[float], float, list[float], list[float]] | None = reading

    def pose(self, position: FloatArray, quaternion: FloatArray) -> None:
        """Write the coordinates for a pose of the base; other coordinates must be current, derived quantities may be stale.

        Args:
            position: Position of its frame, world axes, m, (3,).
            quaternion: Orientation of its frame, (4,).
        """
        if self.free:
            self._qpos[:3], self._qpos[3:] = position.data, quaternion.data
        elif self.reading is not None:
            self._write_coordinates(position, quaternion)
        else:
            self._solve(position, quaternion)

    def _write_coordinates(self, position: FloatArray, quaternion: FloatArray) -> None:
        """Write the coordinates of slides and a hinge, in closed form."""
        x, y, z = position.tolist()
        for i, (o, a, b, c) in enumerate(self._slides):
            self._qpos[i] = o + a * x + b * y + c * z
        if self._hinge is not None:
            _, zero, (a, b, c, d), (p, q, r, s) = self._hinge
            w, x, y, z = quaternion.tolist()
            angle = zero + 2.0 * math.atan2(a * w + b * x + c * y + d * z, p * w + q * x + r * y + s * z)
            # Keep the turn of the last angle: a hinge coordinate counts full turns, a quaternion does not.
            self._qpos[-1] = angle + _TWO_PI * round((self._qpos[-1] - angle) / _TWO_PI)

    def _solve(self, position: FloatArray, quaternion: FloatArray) -> None:
        """Solve for the coordinates by Newton's method."""
        model, data = self._model, self._data
        scale, left = 1.0 + float(np.abs(position).max()), math.inf
        for _ in range(_MAX_ITERATIONS):
            mujoco.mj_kinematics(model, data)
            mujoco.mju_subQuat(self._turn, quaternion, data.xquat[self._root])
            mujoco.mju_rotVecQuat(self._axis, self._turn, data.xquat[self._root])
            error = np.concatenate((self._axis, position - data.xpos[self._root]))
            before, left = left, float(np.abs(error).max())
            # Quadratic convergence has ended, at rounding or because the joints cannot take the pose.
            if left <= _ROUNDING * scale or left > 0.5 * before:
                break
            mujoco.mj_comPos(model, data)
            # Least squares: joints that cannot take a pose come as near as they can, which :func:`check_grasped_system`
            # refuses.
            self._step[self._dofs] = self._nearest_rates(error)
            mujoco.mj_integratePos(model, data.qpos, self._step, 1.0)

    def rates(self, twist: FloatArray) -> None:
        """Write the rates for a twist of the base; positions must be current.

        Args:
            twist: Angular velocity in rad/s, then velocity of its frame's origin in m/s, world axes, (6,).
        """
        self._write(twist, self._qvel)

    def accelerations(self, twist: FloatArray) -> None:
        """Write the accelerations, as :meth:`rates`, in rad/s^2 and m/s^2; positions and velocities must be current."""
        if not self.free and self.reading is None:
            model, data = self._model, self._data
            mujoco.mj_jacDot(model, data, self._rate[3:], self._rate[:3], data.xpos[self._root], self._root)
            # Acceleration is J qddot + dJ/dt qdot; without the second term joints that turn would miss the centripetal part.
            twist = twist - self._rate @ data.qvel
        self._write(twist, self._qacc)

    def _write(self, twist: FloatArray, rates: memoryview[float]) -> None:
        """Write rates of the base joints for a twist of its frame."""
        if not self.free and self.reading is None:
            rates[:] = self._nearest_rates(twist).data
            return
        p, q, r, x, y, z = twist.tolist()
        if self.free:
            a, b, c, d, e, f, g, h, i = self._axes
            # MuJoCo's free joint: linear rates in world axes, angular ones in those of the body.
            rates[0], rates[1], rates[2] = x, y, z
            rates[3], rates[4], rates[5] = a * p + d * q + g * r, b * p + e * q + h * r, c * p + f * q + i * r
            return
        for k, (_, a, b, c) in enumerate(self._slides):
            rates[k] = a * x + b * y + c * z
        if self._hinge is not None:
            a, b, c = self._hinge[0]
            rates[-1] = a * p + b * q + c * r

    def _nearest_rates(self, twist: FloatArray) -> FloatArray:
        """Least-squares rates of the base joints for a twist of its frame, angular part first, (6,)."""
        mujoco.mj_jacBody(self._model, self._data, self._jacobian[3:], self._jacobian[:3], self._root)
        return np.asarray(np.linalg.lstsq(self._jacobian[:, self._dofs], twist, rcond=None)[0])


_POSE_TOLERANCE = 1e-12
"""Poses in m and rad that differ by more, relative to 1 + their size, are others: some thousand roundings."""
_CONFIGURATIONS = 4
"""Configurations in which it is tried whether base joints can follow the link."""


class GraspedMotion(Motion):
    """Integrates the system with a grasped object; see :class:`~ffsm_mj.dynamics.motion.Motion`.

    Attributes:
        system: The system with the grasped object.
        root: Id of the object's base in it.
        link: Id of the grasping link in it.
        joints: The joints of the latch.
        placing: Solver for the object's base joints.
        followed: Transfers the state to the logged system.
        interface: Torque and force of the link on the object (MuJoCo's ``cfrc_int``), about ``centre``, (6,).
        centre: Mass centre of robot and object, (3,).
    """

    def __init__(self, free: Motion, scene: Scene, system: System, grasp: Grasp) -> None:
        """Prepare the motion; nothing is grasped yet.

        Args:
            free: Motion of the logged system.
            scene: The logged system and its data.
            system: The system with the grasped object, with a model owned by the run.
            grasp: Bodies and sites of the grasp.
        """
        (self._qpos, self._model_qpos), (self._dofs, self._model_dofs) = both = shared_joints(scene.system, system)
        data, trees = mujoco.MjData(system.mj), np.zeros(system.mj.nv, dtype=np.intp)
        trees[self._model_dofs] = scene.system.dof_trees[self._dofs]
        power = free.power
        work, outside = (None, None) if power is None else (power.work, power.outside)
        impulse = None if outside is None else outside.impulse
        super().__init__(system.mj, data, actuator_power(scene.system, system.mj, data, trees, work, impulse))
        # A motion with stiff servos is stiff with an object in the hand too: explicit steps would be unstable.
        if free.stiff is not None:
            self.make_implicit()
        self.system, self.grasp = system, grasp.name
        tree = self.grasped_object = next(tree for tree in scene.system.objects if tree.name == grasp.tree)
        self._free, self._model = free, scene.system.mj
        self.momenta = (self.momentum, free.momentum)
        self.root, self.link = system.index("body", grasp.root), system.index("body", grasp.link)
        self.bodies = [_same_body(scene.system, body, system) for body in range(self._model.nbody)]
        dof_of = dict(zip(self._dofs.tolist(), self._model_dofs.tolist(), strict=True))
        # The base joints of the object do not exist in this model: -1 marks what has no counterpart.
        self.dofs = [dof_of.get(dof, -1) for dof in range(self._model.nv)]
        self.joints = LatchJoints(scene.system, system, grasp)
        self.placing = BaseJointSolver(self._model, scene.data, tree)
        logged, moving = (self._model, scene.data, free.momentum), (self.model, self.data, self.root)
        self.followed = StateTransfer(logged, moving, both, self.placing)
        self._ctrl, self._system_ctrl = numbers(self.data.ctrl), numbers(scene.data.ctrl)
        self._jacobian = np.empty((6, self.model.nv))
        self.interface = self.data.cfrc_int[self.root]
        self.centre = self.data.subtree_com[int(self.model.body_rootid[self.root])]
        self.disabled = rigid_pairs(self._model, self)
        # Contacts, bounds and the log look at the logged system: it follows wherever the path moves to.
        self.path.on_event_located = self._follow_with_accelerations

    def hold(self) -> None:
        """Attach the object at its current pose in the system's data, and start from the state there.

        Relative motions that the latch stops are ignored: the object moves without them from now on.
        """
        # The pose is taken as it is: to align it would be a jump of coordinates, which changes momenta and energy.
        self.joints.fasten(self._free.data, self.model, self.data.qpos)
        self.sync_from_system()

    def sync_from_system(self) -> None:
        """Start from the state in the system's data, with the object attached as before."""
        free, data = self._free.data, self.data
        data.qpos[self._model_qpos] = free.qpos[self._qpos]
        # Coordinates of the robot are the same in both models; the object's have no place in this one.
        data.qvel[:] = self.model_rates(free.qvel)
        # Controls and activations have the same places in both models, as :func:`check_grasped_system` makes sure.
        data.ctrl[:], data.act[:], data.time = free.ctrl, free.act, free.time
        # The logged system has no coordinates for the joints of the latch: they follow from the poses of the two bodies.
        self.joints.write_coordinates(free, data.qpos)
        self._refresh()

    def model_rates(self, rates: FloatArray) -> FloatArray:
        """Rates of this model for those of the logged system, (nv,)."""
        model_rates = np.empty(self.model.nv)
        model_rates[self._model_dofs] = rates[self._dofs]
        model_rates[self.joints.dofs] = self.joints.rate_rows(self._free.data) @ rates
        return model_rates

    def get_state(self) -> dict[str, FloatArray]:
        """State of its model, and what was written into the model as the grasp closed."""
        state = np.empty(mujoco.mj_stateSize(self.model, WHOLE_STATE))
        mujoco.mj_getState(self.model, self.data, state, WHOLE_STATE)
        return {"data": state} | {name: getattr(self.model, name).copy() for name in WRITTEN}

    def set_state(self, state: Any) -> None:
        """Go on from a state; the logged system follows."""
        values = entries(state, ("data", *WRITTEN), "GraspedMotion")
        for name in WRITTEN:
            written = getattr(self.model, name)
            written[:] = fitting(values[name], written.shape, f"GraspedMotion.{name}")
        size = mujoco.mj_stateSize(self.model, WHOLE_STATE)
        mujoco.mj_setState(self.model, self.data, fitting(values["data"], (size,), "GraspedMotion"), WHOLE_STATE)
        mujoco.mj_forward(self.model, self.data)
        self._follow_with_accelerations()

    def _refresh(self) -> None:
        # Forces of the last stage belong to another state. Those that act are added again in the next one.
        self.data.qfrc_applied.fill(0.0)
        mujoco.mj_forward(self.model, self.data)
        self._follow_with_accelerations()

    def copy_efforts(self) -> None:
        """Copy the efforts from the system's data."""
        self._ctrl[:] = self._system_ctrl

    def step(self, duration_s: float) -> bool:
        """Integrate for a time under the efforts in the system's data; the logged system follows."""
        self.copy_efforts()
        clear = super().step(duration_s)
        self.followed.step()
        self._free.data.act[:] = self.data.act
        return clear

    def follow(self) -> None:
        """Transfer positions and velocities to the system's data, and update what depends on them."""
        self.followed.state()

    def _follow_with_accelerations(self) -> None:
        """The same, with the accelerations under the forces of this motion."""
        self.followed.step()
        data, free = self.data, self._free.data
        free.act[:] = data.act
        free.qacc[self._dofs] = data.qacc[self._model_dofs]
        self.placing.accelerations(self._acceleration_of_object())

    def _acceleration_of_object(self) -> FloatArray:
        """Acceleration of the object's base: angular in rad/s^2, then of the origin in m/s^2, world axes, (6,)."""
        data, rows = self.data, self._jacobian
        mujoco.mj_jacBody(self.model, data, rows[3:], rows[:3], self.root)
        total = rows @ data.qacc
        mujoco.mj_jacDot(self.model, data, rows[3:], rows[:3], data.xpos[self.root], self.root)
        return np.asarray(total + rows @ data.qvel)


def check_grasped_system(free: System, system: System, grasp: Grasp) -> None:
    """Check that the object can be grasped without changing its frame, and that its base joints can follow the link.

    Args:
        free: The logged system.
        system: The system with the grasped object.
        grasp: Bodies and sites of the grasp.

    Raises:
        LookupError: The frame of the object's base differs in the two systems, its base joints cannot take the poses that
            the link brings it to, or an actuator is missing.
    """
    body, there = free.index("body", grasp.root), system.index("body", grasp.root)
    # MuJoCo's compiler moves the frame of a free body to its mass centre (align). In the grasped model the body is not free,
    # and the poses of both would differ by that.
    if not np.allclose(free.mj.body_ipos[body], system.mj.body_ipos[there], rtol=0.0, atol=_POSE_TOLERANCE):
        raise LookupError(
            f"the frame of {grasp.root!r} is moved to its mass centre while it is free (align): write align false"
        )
    # Efforts are copied by their place: with one missing, every later one would drive another joint.
    if free.names("actuator") != system.names("actuator"):
        raise LookupError(f"an actuator drives the joint by which {grasp.root!r} is free")
    data = mujoco.MjData(free.mj)
    mujoco.mj_forward(free.mj, data)
    scene, model = Scene(free, data), system.copy()
    motion = GraspedMotion(Motion(free.mj, data), scene, model, grasp)
    motion.hold()
    for k in range(1, _CONFIGURATIONS + 1):
        # Pseudo-random configurations, the same in every process: no symmetry makes the check pass by accident.
        mujoco.mj_integratePos(model.mj, motion.data.qpos, np.sin(k * math.e * np.arange(1.0, model.mj.nv + 1.0)), 1.0)
        mujoco.mj_forward(model.mj, motion.data)
        motion.follow()
        wanted = motion.data.xpos[motion.root], motion.data.xmat[motion.root]
        left = max(float(np.abs(b - a).max()) for a, b in zip(wanted, (data.xpos[body], data.xmat[body]), strict=True))
        if left > _POSE_TOLERANCE * (1.0 + float(np.abs(wanted[0]).max())):
            raise LookupError(
                f"the joints of {grasp.root!r} cannot take the poses that {grasp.link!r} would bring it to: "
                f"{left:.2g} m or rad are left; give it a freejoint"
            )


def _same_body(system: System, body: int, other: System) -> int:
    """Id of a body in another system, by name."""
    return int(other.mj.body(system.mj.body(body).name).id)
