"""The estimated state with the covariance of its error."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_controllers.estimators.mekf.layout import Layout
from ffsm_mj.controller_protocol import FloatArray, skew

_SMALL_RAD = 1e-4
"""Below this the Jacobian of a rotation is its expansion, with an error of theta^2/24 in the first term."""


class GraspedPose(NamedTuple):
    """A closed grasp.

    Attributes:
        grasp: Its name.
        position_m: Origin of the object's base in the frame of the grasping link, m, (3,).
        quaternion: Orientation of the object's base in that frame, (4,).
    """

    grasp: str
    position_m: FloatArray
    quaternion: FloatArray


class Estimate:
    """The estimated state with the covariance of its error.

    Attributes:
        layout: Order of the error state.
        data: MuJoCo data with coordinates and rates.
        biases: Biases of the gyros, rad/s.
        covariance: Covariance of the error state, (size, size).
        grasped: The closed grasp; None: there is none.
    """

    def __init__(self, layout: Layout, data: Any, covariance: FloatArray) -> None:
        """Without biases and grasp."""
        self.layout, self.data, self.covariance = layout, data, covariance
        self.biases = np.zeros(3 * len(layout.biases))
        self.grasped: GraspedPose | None = None

    def correct(self, error: FloatArray) -> None:
        """Move the estimate by an estimated error, which then has zero mean again, (size,).

        The error of the attitude that remains is ``Log(Exp(-theta) Exp(theta + e))``, so that its covariance turns with the
        right Jacobian of the rotation: Sola (2017), 6.3 and (183); Markley (2003) keeps its first term.
        """
        self.move(error)
        reset = np.eye(self.layout.size)
        for body in self.layout.bodies:
            reset[body.attitude, body.attitude] = right_jacobian(error[body.attitude])
        for bias in self.layout.biases:
            self.biases[bias.value] += error[bias.error]
        self.covariance = symmetric(reset @ self.covariance @ reset.T)

    def move(self, error: FloatArray) -> None:
        """Move poses and twists of all bodies by an error, (size,); the covariance stays."""
        data = self.data
        for body in self.layout.bodies:
            pose = data.qpos[body.qpos]
            pose[:3] += error[body.position]
            mujoco.mju_quatIntegrate(pose[3:], error[body.attitude], 1.0)
            mujoco.mju_normalize4(pose[3:])
            data.qvel[body.dofs] += np.concatenate((error[body.velocity], error[body.rate]))


def right_jacobian(theta: FloatArray) -> FloatArray:
    """Derivative of ``Log(Exp(-theta) Exp(theta + e))`` by e, (3, 3)."""
    angle, cross = math.hypot(*theta.tolist()), skew(theta)
    if angle < _SMALL_RAD:
        return np.eye(3) - 0.5 * cross + cross @ cross / 6.0
    first, second = (1.0 - math.cos(angle)) / angle**2, (angle - math.sin(angle)) / angle**3
    return np.eye(3) - first * cross + second * (cross @ cross)


def symmetric(matrix: FloatArray) -> FloatArray:
    """Symmetric part of a matrix."""
    return 0.5 * (matrix + matrix.T)
