"""Motion while a grasp is closed: the object is part of a link of the robot, or joined to it by the joints of the latch.

The model is compiled when the scenario is prepared; the pose of the object on the link, and point and axis of the latch's
joints, are written into the run's own copy. The logged system follows: coordinates and rates of shared joints are copied,
and those of the object's base joints follow from its pose and twist in the moving model, (17).
"""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np

from ffsm_mj._core.loops import StateTransfer
from ffsm_mj._core.steppers import WHOLE_STATE
from ffsm_mj.arrays import FloatArray, numbers
from ffsm_mj.contact_models.grasp.base_joints import BaseJointSolver
from ffsm_mj.contact_models.grasp.latch_joints import LatchJoints
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.dynamics.motion import Motion, actuator_power
from ffsm_mj.dynamics.rigid_pairs import rigid_pairs
from ffsm_mj.model.grasp import WRITTEN, Grasp
from ffsm_mj.model.system import System, shared_joints
from ffsm_mj.state import entries, fitting

_POSE_TOLERANCE = 1e-12
_CONFIGURATIONS = 4


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
        (self._qpos, self._held_qpos), (self._dofs, self._held_dofs) = both = shared_joints(scene.system, system)
        data, trees = mujoco.MjData(system.mj), np.zeros(system.mj.nv, dtype=np.intp)
        trees[self._held_dofs] = scene.system.dof_trees[self._dofs]
        power = free.power
        work, outside = (None, None) if power is None else (power.work, power.outside)
        impulse = None if outside is None else outside.impulse
        super().__init__(system.mj, data, actuator_power(scene.system, system.mj, data, trees, work, impulse))
        if free.stiff is not None:
            self.make_implicit()
        self.system, self.grasp = system, grasp.name
        tree = self.grasped_object = next(tree for tree in scene.system.objects if tree.name == grasp.tree)
        self._free, self._model = free, scene.system.mj
        self.momenta = (self.momentum, free.momentum)
        self.root, self.link = system.index("body", grasp.root), system.index("body", grasp.link)
        self.bodies = [_same_body(scene.system, body, system) for body in range(self._model.nbody)]
        own = dict(zip(self._dofs.tolist(), self._held_dofs.tolist(), strict=True))
        self.dofs = [own.get(dof, -1) for dof in range(self._model.nv)]
        self.joints = LatchJoints(scene.system, system, grasp)
        self.placing = BaseJointSolver(self._model, scene.data, tree)
        logged, moving = (self._model, scene.data, free.momentum), (self.model, self.data, self.root)
        self.followed = StateTransfer(logged, moving, both, self.placing)
        self._ctrl, self._system_ctrl = numbers(self.data.ctrl), numbers(scene.data.ctrl)
        self._jacobian = np.empty((6, self.model.nv))
        self.interface = self.data.cfrc_int[self.root]
        self.centre = self.data.subtree_com[int(self.model.body_rootid[self.root])]
        self.disabled = rigid_pairs(self._model, self)
        self.path.on_event_located = self._follow_with_accelerations

    def hold(self) -> None:
        """Attach the object at its current pose in the system's data, and start from the state there.

        Relative motions that the latch stops are ignored: the object moves without them from now on.
        """
        self.joints.fasten(self._free.data, self.model, self.data.qpos)
        self.sync_from_system()

    def sync_from_system(self) -> None:
        """Start from the state in the system's data, with the object attached as before."""
        free, data = self._free.data, self.data
        data.qpos[self._held_qpos] = free.qpos[self._qpos]
        data.qvel[:] = self.own_rates(free.qvel)
        data.ctrl[:], data.act[:], data.time = free.ctrl, free.act, free.time
        self.joints.write_coordinates(free, data.qpos)
        self._refresh()

    def own_rates(self, rates: FloatArray) -> FloatArray:
        """Rates of this model for those of the logged system, (nv,)."""
        own = np.empty(self.model.nv)
        own[self._held_dofs] = rates[self._dofs]
        own[self.joints.dofs] = self.joints.rate_rows(self._free.data) @ rates
        return own

    def get_state(self) -> dict[str, FloatArray]:
        """State of its model, and what was written into the model as the grasp closed."""
        state = np.empty(mujoco.mj_stateSize(self.model, WHOLE_STATE))
        mujoco.mj_getState(self.model, self.data, state, WHOLE_STATE)
        return {"data": state} | {name: getattr(self.model, name).copy() for name in WRITTEN}

    def set_state(self, state: Any) -> None:
        """Go on from a state; the logged system follows."""
        told = entries(state, ("data", *WRITTEN), "GraspedMotion")
        for name in WRITTEN:
            written = getattr(self.model, name)
            written[:] = fitting(told[name], written.shape, f"GraspedMotion.{name}")
        size = mujoco.mj_stateSize(self.model, WHOLE_STATE)
        mujoco.mj_setState(self.model, self.data, fitting(told["data"], (size,), "GraspedMotion"), WHOLE_STATE)
        mujoco.mj_forward(self.model, self.data)
        self._follow_with_accelerations()

    def _refresh(self) -> None:
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
        free.qacc[self._dofs] = data.qacc[self._held_dofs]
        self.placing.accelerations(self._acceleration_of_object())

    def _acceleration_of_object(self) -> FloatArray:
        """Acceleration of the object's base: angular in rad/s^2, then of the origin in m/s^2, world axes, (6,)."""
        data, rows = self.data, self._jacobian
        mujoco.mj_jacBody(self.model, data, rows[3:], rows[:3], self.root)
        total = rows @ data.qacc
        mujoco.mj_jacDot(self.model, data, rows[3:], rows[:3], data.xpos[self.root], self.root)
        return np.asarray(total + rows @ data.qvel)


def check_grasped_system(free: System, held: System, grasp: Grasp) -> None:
    """Check that the object can be grasped without changing its frame, and that its base joints can follow the link.

    Args:
        free: The logged system.
        held: The system with the grasped object.
        grasp: Bodies and sites of the grasp.

    Raises:
        LookupError: The frame of the object's base differs in the two systems, its base joints cannot take the poses that
            the link brings it to, or an actuator is missing.
    """
    body, there = free.index("body", grasp.root), held.index("body", grasp.root)
    if not np.allclose(free.mj.body_ipos[body], held.mj.body_ipos[there], rtol=0.0, atol=_POSE_TOLERANCE):
        raise LookupError(
            f"the frame of {grasp.root!r} is moved to its mass centre while it is free (align): write align false"
        )
    if free.names("actuator") != held.names("actuator"):
        raise LookupError(f"an actuator drives the joint by which {grasp.root!r} is free")
    data = mujoco.MjData(free.mj)
    mujoco.mj_forward(free.mj, data)
    scene, model = Scene(free, data), held.copy()
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
