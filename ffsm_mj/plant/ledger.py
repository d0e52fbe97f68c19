"""Accounts of work and impulse through a run, and what they leave unexplained of energy and momentum.

Work of a held joint effort is force times displacement, exactly. Everything that depends on where a force acts while the
body moves is integrated by Simpson's rule over the (sub-)step with a cubic Hermite midpoint; a trapezoid would leak.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.books.joint_work import JointWork
from ffsm_mj.books.midpoint import hermite_midpoint
from ffsm_mj.compiled import fastest
from ffsm_mj.model.dynamics import (
    BaseMomentum,
    base_jacobian,
    base_wrench,
    external_actuators,
    free_components,
    subtree_momenta,
)
from ffsm_mj.model.system import System
from ffsm_mj.plant.sampler import Sampler

# Columns of the table, in the order of the log (see signals): what is measured, the accounts, what they leave unexplained.
ENERGY, MOMENTUM, BY_MASS_MATRIX, ACCOUNTS = slice(0, 3), slice(3, 21), slice(21, 27), slice(27, 43)
ENERGY_RESIDUAL, MOMENTUM_RESIDUAL = slice(43, 46), slice(46, 64)
COLUMNS = 64


class Ledger:
    """Books of one run. ``open`` before each (sub-)step, ``close`` after it, ``book`` at each event, ``note`` at a tick.

    A note copies what MuJoCo knows of the state; energies, momenta and residuals of many notes are worked out at once.

    Attributes:
        free: Which of (P, L about the origin) the base joints of (total, robot, objects) leave free, 1 or 0, (3, 6).
        momentum: Where M qdot is kept current, (nv,).
    """

    def __init__(self, system: System, data: Any, momentum: FloatArray, *, notes: int = 1) -> None:
        """Start the books at the state in ``data`` (all derived quantities current).

        Args:
            system: What moves.
            data: Its state.
            momentum: Where M qdot is kept current, (nv,).
            notes: Room for so many.
        """
        self._system, self._model, self._data = system, system.mj, data
        self._scratch = mujoco.MjData(system.mj)
        robot_free = free_components(system, system.robot)
        object_free = [free_components(system, tree) for tree in system.objects]
        objects_free = np.all(object_free, axis=0) if object_free else np.ones(6, dtype=np.bool_)
        self.free = np.array([robot_free & objects_free, robot_free, objects_free], dtype=np.float64)
        external = external_actuators(system).astype(np.float64)
        self._on_joint = (np.asarray(system.mj.actuator_trntype) == int(mujoco.mjtTrn.mjTRN_JOINT)).astype(np.float64)
        self._base = BaseMomentum(system, system.robot)
        # Work, impact energy of the parties, external impulse on the robot, contact impulse on the objects.
        self._accounts = np.zeros(1 + 3 + 6 + 6)
        self._work = fastest(JointWork)(data, self._on_joint, external, self._accounts)
        self._pushed = False
        self.momentum = momentum
        self._notes = _Notes(system, data, notes, momentum, self._accounts)
        mujoco.mj_mulM(system.mj, data, momentum, data.qvel)
        self.resume(np.zeros(COLUMNS))

    def resume(self, line: FloatArray) -> None:
        """Go on at the state in ``data`` from what a line of the table said there: accounts, and what they left unexplained.

        Args:
            line: The line, zeros to begin, (COLUMNS,).
        """
        self._accounts[:] = line[ACCOUNTS]
        self._energy_0, self._momentum_0 = np.zeros(3), np.zeros((3, 6))
        self.note()
        start = self.table()[0]
        self._energy_0 = start[ENERGY_RESIDUAL] - line[ENERGY_RESIDUAL]
        self._momentum_0 = (start[MOMENTUM_RESIDUAL] - line[MOMENTUM_RESIDUAL]).reshape(3, 6)

    def note(self) -> None:
        """Keep the state in ``data`` and the accounts; ``momentum`` must be current."""
        notes = self._notes
        notes.take(notes.used)
        notes.used += 1

    def table(self) -> FloatArray:
        """Energies, momenta, accounts and residuals of all notes since the last table, (n, COLUMNS); uses the notes up."""
        notes, robot = self._notes, self._system.robot
        used, notes.used = slice(0, notes.used), 0
        table = np.empty((used.stop, COLUMNS))
        h, rates, accounts = notes.h[used], notes.rates[used], notes.accounts[used]
        powers = h * rates
        total, own = 0.5 * powers.sum(axis=1), 0.5 * powers[:, robot.dofs].sum(axis=1)
        energy = np.stack((total, own, total - own), axis=1)
        of_robot = notes.momenta(robot.root, used)
        of_objects = sum((notes.momenta(tree.root, used) for tree in self._system.objects), np.zeros((used.stop, 6)))
        momentum = np.stack((of_robot + of_objects, of_robot, of_objects), axis=1)
        external, contact = accounts[:, 4:10], accounts[:, 10:16]
        explained = np.stack((external, external - contact, contact), axis=1)
        work, gained = accounts[:, :1] * (1.0, 1.0, 0.0), accounts[:, 1:4]
        table[:, ENERGY], table[:, MOMENTUM] = energy, momentum.reshape(-1, 18)
        table[:, BY_MASS_MATRIX] = self._base.momenta(notes.jacp[used], notes.jacr[used], notes.position[used], h)
        table[:, ACCOUNTS] = accounts
        table[:, ENERGY_RESIDUAL] = energy - self._energy_0 - work - gained
        table[:, MOMENTUM_RESIDUAL] = ((momentum - self._momentum_0 - explained) * self.free).reshape(-1, 18)
        return table

    def open(self) -> None:
        """Remember the state at the start of a (sub-)step, as far as the efforts held in it need it."""
        self._pushed = self._work.open()
        if self._pushed:
            data = self._data
            self._qpos, self._qvel, self._ctrl = data.qpos.copy(), data.qvel.copy(), data.ctrl.copy()

    def close(self, duration_s: float) -> None:
        """Book the work and impulse of the efforts held since ``open``; the state in ``data`` is the end of the step."""
        self._work.close()
        if not self._pushed:
            return
        start, middle, end = self._rates_of_external(duration_s)
        mean = duration_s / 6.0 * (start + 4.0 * middle + end)
        self._accounts[4:10] += mean[:6]
        self._accounts[0] += mean[6]

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

    def book(self, energy_change: FloatArray, contact_impulse: FloatArray) -> None:
        """Book what contacts did, at an event or over a (sub-)step.

        Args:
            energy_change: Kinetic energy that they gave to (total, robot, objects), J.
            contact_impulse: Their impulse on the objects (force part, moment about the origin), (6,).
        """
        self._accounts[1:4] += energy_change
        self._accounts[10:16] += contact_impulse


class _Notes:
    """Copies of MuJoCo's arrays at so many states."""

    def __init__(self, system: System, data: Any, count: int, momentum: FloatArray, accounts: FloatArray) -> None:
        model, root = system.mj, system.robot.root
        self.used, self._mass = 0, model.body_subtreemass
        sampler = fastest(Sampler)(model, data, base=root)
        live = (
            *(data.subtree_linvel, data.subtree_com, data.subtree_angmom, sampler.jacp, sampler.jacr),
            *(data.xpos[root], momentum, data.qvel, accounts),
        )
        tables = [np.empty((count, *array.shape)) for array in live]
        self.velocity, self.centre, self.spin, self.jacp, self.jacr, *rest = tables
        self.position, self.h, self.rates, self.accounts = rest
        sampler.copy(list(zip(live, tables, strict=True)))
        self.take = sampler.take

    def momenta(self, root: int, used: slice) -> FloatArray:
        """Momenta of the subtree of a body at the states noted, (n, 6)."""
        at = (used, root)
        return subtree_momenta(float(self._mass[root]), self.velocity[at], self.centre[at], self.spin[at])
