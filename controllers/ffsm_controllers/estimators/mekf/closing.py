"""What the closing of a grasp does to an estimate."""

from __future__ import annotations

import mujoco
import numpy as np

from ffsm_controllers.estimators.frames import Frame
from ffsm_controllers.estimators.mekf.config import FloorConfig
from ffsm_controllers.estimators.mekf.estimate import Estimate, GraspedPose, symmetric
from ffsm_controllers.estimators.mekf.frame_measurement import FrameMeasurement
from ffsm_controllers.estimators.mekf.grasped import GraspedScene
from ffsm_controllers.estimators.mekf.joints import EncoderErrors
from ffsm_controllers.estimators.mekf.layout import FloatingBody, Layout
from ffsm_controllers.estimators.mekf.update import update
from ffsm_mj.controller_protocol import FloatArray, Grasp, System, mass_matrix

_DIFFERENCE = 1e-5
"""Step of central differences by the errors: they err by its square, and by rounding of 1e-11."""


class GraspClosing:
    """Closing of a grasp: what was estimated of two bodies becomes an estimate of one.

    - The pose of the object in the hand is known from then on: it is a measurement of the one body relative to the other,
      whose only errors are those of encoders across the joints, and the floor.
    - The relative motion ends by a plastic impulse: with G the rates of the scene by those of the grasped system, the rates
      after it are ``G (G^T M G)^-1 G^T M qdot``. The covariance follows by central differences over all errors.
    """

    def __init__(
        self, free: System, grasp: Grasp, scene: GraspedScene, layout: Layout, encoders: EncoderErrors, floor: FloorConfig
    ) -> None:
        """Bind to the scene without the grasp and to that with it."""
        self._model, self._scene, self._encoders = free.mj, scene, encoders
        self._data = mujoco.MjData(free.mj)
        root, link = (Frame(free.index("body", name), np.zeros(3), np.eye(3)) for name in (grasp.root, grasp.link))
        robot = next((body for body in layout.bodies if body.tree is free.robot), None)
        self._measured = [
            (FrameMeasurement("", kind, root, link, scene.object, robot), deviation)
            for kind, deviation in (("framequat", floor.attitude_rad), ("framepos", floor.position_m))
        ]

    def apply(self, estimate: Estimate, pose: GraspedPose) -> None:
        """Close the grasp."""
        if self._scene.object is not None:
            self._place(estimate, pose)
        estimate.grasped = pose
        if self._scene.object is not None:
            self._join(estimate)
        self._scene.enter(estimate)
        self._scene.leave(estimate)

    def _place(self, estimate: Estimate, pose: GraspedPose) -> None:
        """Use what is known of the pose of the object in the hand."""
        size, encoders = estimate.layout.size, self._encoders
        for (measurement, deviation), value in zip(self._measured, (pose.quaternion, pose.position_m), strict=True):
            innovation, slope = measurement.innovation(self._model, estimate, value, encoders.dofs)
            across = slope[:, size:]
            noise = deviation**2 * np.eye(3) + (across * encoders.variances) @ across.T
            update(estimate, innovation, slope[:, :size], noise)

    def _join(self, estimate: Estimate) -> None:
        """End the relative motion."""
        rates, carrier, size = self._rates_after(estimate), self._scene.carrier, estimate.layout.size
        if carrier is not None:
            derivative, rated = np.eye(size), slice(carrier.velocity.start, carrier.rate.stop)
            for k, error in enumerate(_DIFFERENCE * np.eye(size)):
                apart = self._moved(estimate, error, carrier) - self._moved(estimate, -error, carrier)
                derivative[rated, k] = apart / (2.0 * _DIFFERENCE)
            estimate.covariance = symmetric(derivative @ estimate.covariance @ derivative.T)
        ours, theirs = self._scene.shared.dofs
        estimate.data.qvel[ours] = rates[theirs]

    def _moved(self, estimate: Estimate, error: FloatArray, carrier: FloatingBody) -> FloatArray:
        """Velocity and angular velocity of the base after the impulse, with an estimate moved by an error, (6,)."""
        qpos, qvel = estimate.data.qpos.copy(), estimate.data.qvel.copy()
        estimate.move(error)
        rates = self._rates_after(estimate)[carrier.dofs]
        estimate.data.qpos[:], estimate.data.qvel[:] = qpos, qvel
        return rates

    def _rates_after(self, estimate: Estimate) -> FloatArray:
        """Rates of the grasped system after the impulse, (nv,): those of the least change in kinetic energy."""
        scene, free = self._scene, self._data
        assert scene.object is not None
        model, data = scene.model, scene.enter(estimate)
        mujoco.mj_fwdPosition(model, data)
        jacobians = np.empty((2, 3, model.nv))
        mujoco.mj_jacBody(model, data, *jacobians, scene.root)
        ours, theirs = scene.shared.dofs
        rates = np.zeros((self._model.nv, model.nv))
        rates[ours, theirs] = 1.0
        rates[scene.object.dofs] = np.vstack((jacobians[0], data.xmat[scene.root].reshape(3, 3).T @ jacobians[1]))
        free.qpos[:] = estimate.data.qpos
        free.qpos[scene.object.qpos] = np.concatenate((data.xpos[scene.root], data.xquat[scene.root]))
        mujoco.mj_fwdPosition(self._model, free)
        shares = rates.T @ mass_matrix(self._model, free)
        common_rates: FloatArray = np.linalg.solve(shares @ rates, shares @ estimate.data.qvel)
        return common_rates
