"""Accounts of work and impulse through a run, and what they leave unexplained of energy and momentum.

Work of a held joint effort is force times displacement, exactly. Everything that depends on where a force acts while the
body moves is integrated by Simpson's rule over the (sub-)step with a cubic Hermite midpoint; a trapezoid would leak.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from ffsm_mj.dynamics import BaseMomentum, BodyMomenta, base_jacobian, base_wrench, free_components
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
        self._external_actuators = np.flatnonzero(_base_actuators(system)).tolist()
        self._on_joint = (np.asarray(system.mj.actuator_trntype) == int(mujoco.mjtTrn.mjTRN_JOINT)).astype(np.float64)
        self.energy, self.momentum = np.zeros(3), np.zeros((3, 6))
        self.robot_by_mass_matrix = np.zeros(6)
        self._base = BaseMomentum(system, system.robot)
        self._of_robot = BodyMomenta(system.mj, data, system.robot.root)
        self._of_objects = [BodyMomenta(system.mj, data, tree.root) for tree in system.objects]
        # Views: looking MuJoCo's arrays up costs more than reading them.
        self._rates, self._held = data.qvel, data.ctrl
        self._h = np.empty(system.mj.nv)
        # Work, impact energy of the parties, external impulse on the robot, contact impulse on the objects.
        self._accounts = np.zeros(1 + 3 + 6 + 6)
        self._working = self._pushed = False
        self.measure()
        self._energy_0, self._momentum_0 = self.energy.tolist(), self.momentum.copy()
        self._expected = self._momentum_0.copy()

    def measure(self) -> None:
        """Read energy and momenta off the current state."""
        model, data, robot = self._model, self._data, self._system.robot
        mujoco.mj_subtreeVel(model, data)
        h, qvel = self._h, self._rates
        mujoco.mj_mulM(model, data, h, qvel)
        total, own = 0.5 * float(h @ qvel), 0.5 * float(h[robot.dofs] @ qvel[robot.dofs])
        self.energy[:] = total, own, total - own
        whole, of_robot, of_objects = self.momentum
        of_robot[:] = self._of_robot()
        parts = [momenta() for momenta in self._of_objects]
        of_objects[:] = parts[0] if len(parts) == 1 else np.sum(parts, axis=0) if parts else 0.0
        np.add(of_robot, of_objects, out=whole)
        self.robot_by_mass_matrix[:] = self._base.momentum(data, h)

    def open(self) -> None:
        """Remember the state at the start of a (sub-)step, as far as the efforts held in it need it."""
        data = self._data
        ctrl = self._held.tolist()
        self._working = any(ctrl)
        self._pushed = self._working and any(ctrl[i] for i in self._external_actuators)
        if self._working:
            self._length = data.actuator_length.copy()
        if self._pushed:
            self._qpos, self._qvel, self._ctrl = data.qpos.copy(), data.qvel.copy(), data.ctrl.copy()

    def close(self, duration_s: float) -> None:
        """Book the work and impulse of the efforts held since ``open``; the state in ``data`` is the end of the step."""
        if not self._working:
            return
        data = self._data
        self._accounts[0] += (data.actuator_force * self._on_joint) @ (data.actuator_length - self._length)
        if not self._pushed:
            return
        start, middle, end = self._rates_of_external(duration_s)
        mean = duration_s / 6.0 * (start + 4.0 * middle + end)
        self._accounts[4:10] += mean[:6]
        self._accounts[0] += mean[6]
        self._expect()

    def _expect(self) -> None:
        """Momenta that the books explain."""
        external, contact = self._accounts[4:10], self._accounts[10:16]
        self._expected = self._momentum_0 + np.stack((external, external - contact, contact))

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
            power = (scratch.actuator_force * scratch.actuator_velocity) @ (1.0 - self._on_joint)
            rates.append(np.append(wrench, power))
        return rates[0], rates[1], rates[2]

    def impact(self, energy_change: FloatArray, contact_impulse: FloatArray) -> None:
        """Book an impact.

        Args:
            energy_change: Kinetic energy gained by (total, robot, objects), J.
            contact_impulse: Impulse on the objects (force part, moment about the origin), (6,).
        """
        self._accounts[1:4] += energy_change
        self._accounts[10:16] += contact_impulse
        self._expect()

    def residuals(self) -> tuple[FloatArray, FloatArray]:
        """What the books do not explain at the last ``measure``: energies (3,) and momenta (3, 6)."""
        row = np.empty(_ROW_SIZE)
        self.fill(row)
        return row[16:19], row[19:].reshape(3, 6)

    def fill(self, row: FloatArray) -> None:
        """Write the ledger columns of a row."""
        accounts = self._accounts
        row[:16] = accounts
        work, total, robot, objects = accounts[:4].tolist()
        now, before = self.energy.tolist(), self._energy_0
        row[16:19] = (
            now[0] - before[0] - work - total,
            now[1] - before[1] - work - robot,
            now[2] - before[2] - objects,
        )
        row[19:_ROW_SIZE] = ((self.momentum - self._expected) * self.free).ravel()


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
