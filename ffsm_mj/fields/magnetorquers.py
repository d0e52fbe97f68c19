"""Magnetorquers as an external field: the torque m x B of each dipole on its body."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj._core.fields import Bodies
from ffsm_mj.arrays import FloatArray
from ffsm_mj.fields.magnetic import MagneticField
from ffsm_mj.model.magnetorquers import Magnetorquer


class Magnetorquers:
    """Torques of the magnetorquers of a scene, by the commands of its actuators.

    The dipole is held between two commands; attitude and magnetic field are those of each stage. The field is that at the
    mass centre of the body. The force on a dipole in a field that varies, some 1e-10 N in orbit, is left out.
    """

    def __init__(self, model: Any, bodies: Bodies, magnetorquers: Sequence[Magnetorquer], magnetic: MagneticField) -> None:
        """Bind to the bodies of a model.

        Args:
            model: MuJoCo model, with the magnetorquers as actuators.
            bodies: Its moving bodies.
            magnetorquers: The magnetorquers.
            magnetic: The magnetic field.
        """
        self._magnetic = magnetic
        self._actuators = np.array([model.actuator(one.name).id for one in magnetorquers], dtype=np.intp)
        self._bodies: list[int] = []
        axes = []
        for one, actuator in zip(magnetorquers, self._actuators.tolist(), strict=True):
            site = int(model.actuator_trnid[actuator, 0])
            body = int(model.site_bodyid[site])
            self._bodies.append(bodies.names.index(model.body(body).name))
            frame, principal = np.empty(9), np.empty(9)
            mujoco.mju_quat2Mat(frame, model.site_quat[site])
            mujoco.mju_quat2Mat(principal, model.body_iquat[body])
            axes.append(principal.reshape(3, 3).T @ frame.reshape(3, 3)[:, "xyz".index(one.axis)])
        self._axes = np.array(axes)  # in principal axes of their bodies, which the bodies have in world axes

    def add_wrenches(self, time_s: float, bodies: Bodies) -> None:
        """Add the torques to those of the bodies."""
        for k, torque in zip(self._bodies, self.torques(time_s, bodies, bodies.controls), strict=True):
            bodies.torque_N_m[k] += torque

    def torques(self, time_s: float, bodies: Bodies, controls: FloatArray) -> FloatArray:
        """Torque of each magnetorquer in world axes, N m, (n, 3).

        Args:
            time_s: Time.
            bodies: The moving bodies at that time.
            controls: Controls of the actuators, (nu,).
        """
        torques, dipoles = np.zeros_like(self._axes), controls[self._actuators]
        for i in np.flatnonzero(dipoles).tolist():
            k = self._bodies[i]
            x, y, z = (dipoles[i] * (bodies.axes[k] @ self._axes[i])).tolist()
            u, v, w = self._magnetic.at(time_s, bodies.position_m[k]).tolist()
            torques[i] = y * w - z * v, z * u - x * w, x * v - y * u
        return torques
