"""The estimate while an object is grasped: robot and object move as one system."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from ffsm_controllers.estimators.frames import Frame
from ffsm_controllers.estimators.mekf.estimate import Estimate, symmetric
from ffsm_controllers.estimators.mekf.frame_motion import frame_motion
from ffsm_controllers.estimators.mekf.joints import EncoderErrors
from ffsm_controllers.estimators.mekf.layout import FloatingBody, Layout
from ffsm_mj.controller_protocol import FieldForces, FloatArray, System, shared_joints, skew


class GraspedScene:
    """The system with a grasped object, in which an estimate is predicted while the grasp is closed.

    The object is a part of the grasping link: its pose and twist follow from the base and the joints, and so do their
    errors. With T the derivative of its error by the error state, its part of the covariance is ``T P T^T``, and the
    covariance of the errors of joints: of coordinates for position and attitude, of rates for its velocities.

    Attributes:
        model: MuJoCo model of this system; its own, as the pose of the object in it changes.
        data: Its data.
        bodies: Floating bodies of this system, with their places in the error state.
        carrier: The base of the robot, one of them; None: it does not float.
        object: The grasped object, in the scene without a grasp; None: it has no free joint.
        root: Id of its base in this system.
        field: External fields in this system; None: there are none.
    """

    def __init__(
        self, free: System, grasped: System, layout: Layout, encoders: EncoderErrors, field: FieldForces | None = None
    ) -> None:
        """Bind to the scene and to the system with the grasped object and its external fields."""
        assert grasped.grasp is not None
        self.model = grasped.copy().mj
        self.data, self.field = mujoco.MjData(self.model), field
        trees = {tree.name: tree for tree in grasped.trees}
        self.bodies = tuple(FloatingBody(trees[body.name], body.first) for body in layout.bodies if body.name in trees)
        self.carrier = next((body for body in self.bodies if body.tree is grasped.robot), None)
        self.object = next((body for body in layout.bodies if body.name == grasped.grasp.tree), None)
        self.root = int(self.model.body(grasped.grasp.root).id)
        self.shared = shared_joints(free, grasped)
        dof_in_shared = dict(zip(*(dofs.tolist() for dofs in self.shared.dofs), strict=True))
        known = [k for k, dof in enumerate(encoders.dofs) if dof in dof_in_shared]
        self._joints = [dof_in_shared[encoders.dofs[k]] for k in known]
        self._of_coordinates, self._of_rates = encoders.variances[known], encoders.rate_variances[known]

    def enter(self, estimate: Estimate) -> Any:
        """Data of this system at an estimate; derived quantities are not updated."""
        assert estimate.grasped is not None
        (ours, theirs), (our_rates, their_rates) = self.shared
        self.model.body_pos[self.root], self.model.body_quat[self.root] = (
            estimate.grasped.position_m,
            estimate.grasped.quaternion,
        )
        self.data.qpos[theirs], self.data.qvel[their_rates] = estimate.data.qpos[ours], estimate.data.qvel[our_rates]
        self.data.ctrl[:], self.data.time = estimate.data.ctrl, estimate.data.time
        return self.data

    def leave(self, estimate: Estimate) -> None:
        """Set an estimate to the state in the data of this system; the object and its errors follow."""
        (ours, theirs), (our_rates, their_rates) = self.shared
        estimate.data.qpos[ours], estimate.data.qvel[our_rates] = self.data.qpos[theirs], self.data.qvel[their_rates]
        estimate.data.time = self.data.time
        if self.object is None:
            return
        model, data, size = self.model, self.data, estimate.layout.size
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        frame = Frame(self.root, np.zeros(3), np.eye(3))
        motion = frame_motion(model, data, frame, self.carrier, size, self._joints)
        axes = motion.axes.T
        estimate.data.qpos[self.object.qpos] = np.concatenate((motion.origin, data.xquat[self.root]))
        estimate.data.qvel[self.object.dofs] = np.concatenate((motion.velocity, axes @ motion.turning))
        d_rate = axes @ (motion.d_turning + skew(motion.turning) @ motion.d_axes)
        slope = np.vstack((motion.d_origin, axes @ motion.d_axes, motion.d_velocity, d_rate))
        self._follow(estimate, self.object, slope)

    def _follow(self, estimate: Estimate, body: FloatingBody, slope: FloatArray) -> None:
        """Let the errors of the object follow, by their derivatives by the error state and by joints, (12, size + n).

        Its velocities move with the rates of joints as its pose with their coordinates.
        """
        size = estimate.layout.size
        errors, joints = slope[:, :size], slope[:6, size:]
        expansion = np.eye(size)
        expansion[body.error] = errors
        covariance = expansion @ estimate.covariance @ expansion.T
        pose, twist = ((joints * variances) @ joints.T for variances in (self._of_coordinates, self._of_rates))
        covariance[body.error, body.error] += np.block([[pose, np.zeros((6, 6))], [np.zeros((6, 6)), twist]])
        estimate.covariance = symmetric(covariance)
