"""Motion of the estimate and of its covariance between measurements."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_controllers.estimators.mekf.config import MekfConfig
from ffsm_controllers.estimators.mekf.estimate import Estimate, symmetric
from ffsm_controllers.estimators.mekf.grasped import GraspedScene
from ffsm_controllers.estimators.mekf.layout import SIZE, FloatingBody, Layout
from ffsm_mj.controller_protocol import FieldForces, FloatArray, Sensor, predict, skew

_TURN_RAD = 0.1
"""Largest turn of a body within one step of the covariance, whose relative error is then below 0.1^3 / 12 = 1e-4."""
_DIFFERENCE_RAD_S = 1e-3
"""Step of the differences by angular velocity: accelerations are quadratic in it, so central differences are exact."""


class Moving(NamedTuple):
    """What is predicted.

    Attributes:
        model: MuJoCo model, of the scene or of that with a grasped object.
        data: Its data, with the estimate.
        bodies: Its floating bodies, with their places in the error state.
        field: External fields; None: there are none.
    """

    model: Any
    data: Any
    bodies: Sequence[FloatingBody]
    field: FieldForces | None


class Propagation:
    """Prediction of the estimate by the model's own motion under held efforts, and of the covariance of its error.

    The error of a body moves by ``dp' = dv``, ``dtheta' = -w x dtheta + dw``, ``dv' = R (-f x dtheta + (df/dw) dw)`` and
    ``dw' = (da/dw) dw``: the acceleration of its origin less gravity, f, and its angular acceleration, a, in body axes, do
    not depend on place, attitude and velocity, and come from the model with all its joints (Euler's equations for one rigid
    body); their derivatives by w are central differences. The transition over a step is the exponential of this matrix at
    the middle, to third order. White noise of the two accelerations enters as over a step without rotation.

    While an object is grasped all this is done in the system in which it is a part of the robot; see
    :class:`~.grasped.GraspedScene`.
    """

    def __init__(
        self,
        model: Any,
        layout: Layout,
        config: MekfConfig,
        sensors: Mapping[str, Sensor],
        grasped: Mapping[str, GraspedScene],
        field: FieldForces | None = None,
    ) -> None:
        """Bind to the model of the scene with its external fields, and to those with a grasped object by its grasp."""
        self._model, self._layout, self._grasped, self._field = model, layout, grasped, field
        self._cubic, self._square, self._linear = _noise_of_a_step(layout, config, sensors)

    def advance(self, estimate: Estimate, duration_s: float, ctrl: FloatArray) -> None:
        """Move an estimate on under given efforts, (nu,); nothing is done unless the duration is positive."""
        if not duration_s > 0.0:
            return
        estimate.data.ctrl[:] = ctrl
        if estimate.grasped is None:
            self._advance(estimate, Moving(self._model, estimate.data, self._layout.bodies, self._field), duration_s)
            return
        scene = self._grasped[estimate.grasped.grasp]
        self._advance(estimate, Moving(scene.model, scene.enter(estimate), scene.bodies, scene.field), duration_s)
        scene.leave(estimate)

    def follow(self, estimate: Estimate) -> None:
        """Let a grasped object follow the hand in an estimate that was changed."""
        if estimate.grasped is not None:
            scene = self._grasped[estimate.grasped.grasp]
            scene.enter(estimate)
            scene.leave(estimate)

    def _advance(self, estimate: Estimate, moving: Moving, duration_s: float) -> None:
        rates = [math.hypot(*moving.data.qvel[body.turning].tolist()) for body in moving.bodies]
        steps = max(1, math.ceil(duration_s * max(rates, default=0.0) / _TURN_RAD))
        for _ in range(steps):
            self._step(estimate, moving, duration_s / steps)

    def _step(self, estimate: Estimate, moving: Moving, h: float) -> None:
        predict(moving.model, moving.data, 0.5 * h, moving.field)
        dynamics = _dynamics(moving)
        predict(moving.model, moving.data, 0.5 * h, moving.field)
        transition = np.eye(self._layout.size)
        for body, matrix in zip(moving.bodies, dynamics, strict=True):
            scaled = h * matrix
            square = scaled @ scaled
            transition[body.error, body.error] += scaled + square / 2.0 + square @ scaled / 6.0
        moved = symmetric(transition @ estimate.covariance @ transition.T)
        estimate.covariance = moved + (h**3 / 3.0 * self._cubic + h**2 / 2.0 * self._square + h * self._linear)


def _dynamics(moving: Moving) -> list[FloatArray]:
    """Matrix of the error dynamics of each body at a state, (12, 12)."""
    model, data, bodies, _ = moving
    # Without fields: like gravity they do not turn with the body, and their gradients, of 1e-6 1/s^2, are left to the noise.
    mujoco.mj_forward(model, data)
    still = data.qacc.copy()
    slopes = _slopes(moving)
    return [_matrix(body, data, model.opt.gravity, still, slopes) for body in bodies]


def _slopes(moving: Moving) -> FloatArray:
    """Derivatives of all accelerations by each component of the angular velocities, (nv, 3).

    Trees do not act on each other, so that one component of all bodies is moved at a time.
    """
    model, data, bodies, _ = moving
    slopes = np.empty((model.nv, 3))
    for axis in range(3):
        turning = [body.turning.start + axis for body in bodies]
        usual = data.qvel[turning].copy()
        data.qvel[turning] = usual + _DIFFERENCE_RAD_S
        mujoco.mj_forwardSkip(model, data, mujoco.mjtStage.mjSTAGE_POS, 1)
        slopes[:, axis] = data.qacc
        data.qvel[turning] = usual - _DIFFERENCE_RAD_S
        mujoco.mj_forwardSkip(model, data, mujoco.mjtStage.mjSTAGE_POS, 1)
        slopes[:, axis] -= data.qacc
        data.qvel[turning] = usual
    return slopes / (2.0 * _DIFFERENCE_RAD_S)


def _matrix(body: FloatingBody, data: Any, gravity: FloatArray, qacc: FloatArray, slopes: FloatArray) -> FloatArray:
    axes = data.xmat[body.tree.root].reshape(3, 3)
    linear, turning = slice(body.dofs.start, body.dofs.start + 3), body.turning
    matrix = np.zeros((SIZE, SIZE))
    matrix[0:3, 6:9] = np.eye(3)
    matrix[3:6, 3:6] = -skew(data.qvel[turning])
    matrix[3:6, 9:12] = np.eye(3)
    matrix[6:9, 3:6] = -skew(qacc[linear] - gravity) @ axes
    matrix[6:9, 9:12] = slopes[linear]
    matrix[9:12, 9:12] = slopes[turning]
    return matrix


def _noise_of_a_step(
    layout: Layout, config: MekfConfig, sensors: Mapping[str, Sensor]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Factors of h^3 / 3, h^2 / 2 and h in the noise of a step h: a random walk of rates, and its integral; (size, size)."""
    cubic, square, linear = np.zeros((3, layout.size, layout.size))
    diagonal = np.arange(3)
    for body in layout.bodies:
        pairs = ((body.position, body.velocity), (body.attitude, body.rate))
        for (coordinate, rate), density in zip(pairs, _densities(config, body), strict=True):
            q, v = coordinate.start + diagonal, rate.start + diagonal
            cubic[q, q] = square[q, v] = square[v, q] = linear[v, v] = density**2
    for bias in layout.biases:
        linear[bias.first + diagonal, bias.first + diagonal] = _walk(sensors[bias.sensor]) ** 2
    return cubic, square, linear


def _densities(config: MekfConfig, body: FloatingBody) -> tuple[float, float]:
    special = config.bodies.get(body.name)
    process = config.process if special is None or special.process is None else special.process
    return process.acceleration_density, process.angular_acceleration_density


def _walk(sensor: Sensor) -> float:
    """Density of the random walk of a gyro's bias, rad/s/sqrt(s)."""
    return sensor.walk / math.sqrt(sensor.interval_s)
