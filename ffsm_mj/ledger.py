"""Accounts of work and impulse through a run, and what they leave unexplained of energy and momentum.

Work of a held joint effort is force times displacement, exactly. Everything that depends on where a force acts while the
body moves is integrated by Simpson's rule over the (sub-)step with a cubic Hermite midpoint; a trapezoid would leak.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from ffsm_mj.dynamics import base_jacobian, base_wrench, body_momenta, free_components, generalized_momentum
from ffsm_mj.model import FloatArray, System

# Columns of ledger rows, see signals._ledger_signals: work, impact energy x3, external, contact, residuals.
_ROW_SIZE = 1 + 3 + 6 + 6 + 3 + 18


class Ledger:
    """Books of one run. ``open`` before each (sub-)step, ``close`` after it, ``impact`` at each impact.

    Attributes:
        energy: Kinetic energy of (total, robot, objects) at the last ``measure``, J.
        momentum: Momentum (P, L about the origin) of the same, (3, 6).
        free: Which components of (P, L about the origin) the base joints of the same leave free, 1 or 0, (3, 6).
        robot_by_mass_matrix: Momentum of the robot from the base rows of M qdot, (6,).
    """

    def __init__(self, system: System, data: Any) -> None:
        """Start the books at the state in ``data`` (kinematics current)."""
        self._system, self._model, self._data = system, system.mj, data
        self._scratch = mujoco.MjData(system.mj)
        robot_free = free_components(system, system.robot)
        object_free = [free_components(system, tree) for tree in system.objects]
        objects_free = np.all(object_free, axis=0) if object_free else np.ones(6, dtype=np.bool_)
        self.free = np.array([robot_free & objects_free, robot_free, objects_free], dtype=np.float64)
        self._external_actuators = _base_actuators(system)
        self._on_joint = np.asarray(system.mj.actuator_trntype) == int(mujoco.mjtTrn.mjTRN_JOINT)
        self.energy, self.momentum = np.zeros(3), np.zeros((3, 6))
        self.robot_by_mass_matrix = np.zeros(6)
        self._work = 0.0
        self._impact_energy = np.zeros(3)
        self._external, self._contact = np.zeros(6), np.zeros(6)
        self.measure()
        self._energy_0, self._momentum_0 = self.energy.copy(), self.momentum.copy()

    def measure(self) -> None:
        """Read energy and momenta off the current state."""
        model, data, robot = self._model, self._data, self._system.robot
        mujoco.mj_subtreeVel(model, data)
        h = generalized_momentum(model, data)
        self.energy[0] = 0.5 * (h @ data.qvel)
        self.energy[1] = 0.5 * (h[robot.dofs] @ data.qvel[robot.dofs])
        self.energy[2] = self.energy[0] - self.energy[1]
        self.momentum[1] = body_momenta(model, data, robot.root)
        self.momentum[2] = sum((body_momenta(model, data, tree.root) for tree in self._system.objects), np.zeros(6))
        self.momentum[0] = self.momentum[1] + self.momentum[2]
        self.robot_by_mass_matrix = base_wrench(base_jacobian(model, data, robot), h[robot.base_dofs])

    def open(self) -> None:
        """Remember the state at the start of a (sub-)step."""
        data = self._data
        self._qpos, self._qvel = data.qpos.copy(), data.qvel.copy()
        self._length, self._ctrl = data.actuator_length.copy(), data.ctrl.copy()

    def close(self, duration_s: float) -> None:
        """Book the work and impulse of the efforts held since ``open``; the state in ``data`` is the end of the step."""
        if not self._ctrl.any():
            return
        data = self._data
        force = data.actuator_force
        self._work += float(force[self._on_joint] @ (data.actuator_length - self._length)[self._on_joint])
        if not self._ctrl[self._external_actuators].any():
            return
        start, middle, end = self._rates_of_external(duration_s)
        mean = (start + 4.0 * middle + end) / 6.0
        self._external += duration_s * mean[:6]
        self._work += duration_s * float(mean[6])

    def _rates_of_external(self, duration_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(Wrench about the origin, power of site actuators) at the start, the Hermite midpoint and the end of a step."""
        model, data, scratch = self._model, self._data, self._scratch
        q_mid, v_mid = hermite_midpoint(model, self._qpos, self._qvel, data.qpos, data.qvel, duration_s)
        states = ((self._qpos, self._qvel), (q_mid, v_mid), (data.qpos, data.qvel))
        rates = []
        scratch.ctrl[:] = self._ctrl
        for qpos, qvel in states:
            scratch.qpos[:], scratch.qvel[:] = qpos, qvel
            mujoco.mj_fwdPosition(model, scratch)
            mujoco.mj_fwdVelocity(model, scratch)
            mujoco.mj_fwdActuation(model, scratch)
            robot = self._system.robot
            wrench = base_wrench(base_jacobian(model, scratch, robot), scratch.qfrc_actuator[robot.base_dofs])
            power = (scratch.actuator_force * scratch.actuator_velocity)[~self._on_joint].sum()
            rates.append(np.append(wrench, power))
        return rates[0], rates[1], rates[2]

    def impact(self, energy_change: FloatArray, contact_impulse: FloatArray) -> None:
        """Book an impact.

        Args:
            energy_change: Kinetic energy gained by (total, robot, objects), J.
            contact_impulse: Impulse on the objects (force part, moment about the origin), (6,).
        """
        self._impact_energy += energy_change
        self._contact += contact_impulse

    def residuals(self) -> tuple[FloatArray, FloatArray]:
        """What the books do not explain at the last ``measure``: energies (3,) and momenta (3, 6)."""
        work = np.array([self._work, self._work, 0.0])
        energy = self.energy - self._energy_0 - work - self._impact_energy
        booked = np.stack((self._external, self._external - self._contact, self._contact))
        return energy, (self.momentum - self._momentum_0 - booked) * self.free

    def fill(self, row: FloatArray) -> None:
        """Write the ledger columns of a row."""
        energy, momentum = self.residuals()
        row[0] = self._work
        row[1:4] = self._impact_energy
        row[4:10], row[10:16] = self._external, self._contact
        row[16:19] = energy
        row[19:_ROW_SIZE] = momentum.ravel()


def _base_actuators(system: System) -> npt.NDArray[np.bool_]:
    """Mask of the actuators that push on the robot from outside: on a base joint, or at a site."""
    model = system.mj
    base = range(system.robot.base_dofs.start, system.robot.base_dofs.stop)
    mask = np.ones(model.nu, dtype=np.bool_)
    for i in range(model.nu):
        if model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT:
            mask[i] = model.jnt_dofadr[model.actuator_trnid[i, 0]] in base
    return mask


def hermite_midpoint(
    model: Any, qpos_0: FloatArray, qvel_0: FloatArray, qpos_1: FloatArray, qvel_1: FloatArray, duration_s: float
) -> tuple[FloatArray, FloatArray]:
    """State half-way through a step, by cubic Hermite interpolation on the configuration manifold.

    Returns:
        (qpos, qvel) at the middle; the configuration is fourth-order accurate in the duration, the velocity third.
    """
    rotations = _rotations(model)
    chord = np.empty(model.nv)
    mujoco.mj_differentiatePos(model, chord, duration_s, qpos_0, qpos_1)
    end = qvel_1.copy()
    # The chord of a rotation is a rotation vector; its rate at the end is the inverse right Jacobian times omega.
    for part in rotations:
        theta, omega = chord[part] * duration_s, qvel_1[part]
        turn = np.cross(theta, omega)
        end[part] = omega + 0.5 * turn + np.cross(theta, turn) / 12.0
    half = 0.5 * chord + 0.125 * (qvel_0 - end)
    qpos = qpos_0.copy()
    mujoco.mj_integratePos(model, qpos, half, duration_s)
    qvel = 1.5 * chord - 0.25 * (qvel_0 + end)
    for part in rotations:
        theta, rate = half[part] * duration_s, qvel[part]
        turn = np.cross(theta, rate)
        qvel[part] = rate - 0.5 * turn + np.cross(theta, turn) / 6.0
    return qpos, qvel


def _rotations(model: Any) -> list[slice]:
    """The angular part of every free and ball joint in ``qvel``."""
    parts = []
    offsets = {int(mujoco.mjtJoint.mjJNT_FREE): 3, int(mujoco.mjtJoint.mjJNT_BALL): 0}
    for kind, first in zip(model.jnt_type.tolist(), model.jnt_dofadr.tolist(), strict=True):
        if kind in offsets:
            parts.append(slice(first + offsets[kind], first + offsets[kind] + 3))
    return parts
