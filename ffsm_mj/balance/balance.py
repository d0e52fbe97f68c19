"""Accounts of work and impulse through a run, and what they leave unexplained of energy and momentum.

Work of a held joint effort is force times displacement, exactly. Everything that depends on where a force acts while the
body moves is integrated over the (sub-)step; the arithmetic is in :mod:`ffsm_mj.balance`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.base_motors import BaseMotors
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.balance.grasped_object import GraspedObjectBalance
from ffsm_mj.balance.gravity import NUMBERS, Gravity, by_party
from ffsm_mj.balance.joint_work import JointWork
from ffsm_mj.balance.sample_buffer import SampleBuffer
from ffsm_mj.balance.signals import ACCOUNTS, BalanceSignals, BalanceTerms, BalanceValues
from ffsm_mj.balance.subsystems import (
    energy_balance_residual,
    momentum_balance_residual,
    subsystem_energies,
    subsystem_momenta,
)
from ffsm_mj.balance.thrusters import Thrusters, thrusters
from ffsm_mj.compiled import fastest
from ffsm_mj.dynamics.rigid_body import BaseMomentum, external_actuators, free_components
from ffsm_mj.model.system import System, Tree
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.signals import SUBSYSTEMS

_FALLEN = ACCOUNTS + GraspedObjectBalance.SIZE


class Balance:
    """Books of one run. ``open`` before each (sub-)step, ``close`` after it, ``book`` at each event, ``note`` at a tick.

    A note copies what MuJoCo knows of the state; energies, momenta and residuals of many notes are worked out at once. So is
    what the robot gives to an object that it carries: nothing is done for it in a step.

    Attributes:
        free: Which of (P, L about the origin) the base joints of (total, robot, objects) leave free, 1 or 0, (3, 6).
        momentum: Where M qdot is kept current, (nv,).
        columns: Energies, momenta, accounts and residuals.
    """

    def __init__(self, system: System, data: Any, momentum: FloatArray, *, notes: int = 1) -> None:
        """Start the balance at the state in ``data`` (all derived quantities current).

        Args:
            system: What moves.
            data: Its state.
            momentum: Where M qdot is kept current, (nv,).
            notes: Room for so many.
        """
        self._system = system
        robot_free = free_components(system, system.robot)
        object_free = [free_components(system, tree) for tree in system.objects]
        objects_free = np.all(object_free, axis=0) if object_free else np.ones(6, dtype=np.bool_)
        self.free = np.array([robot_free & objects_free, robot_free, objects_free], dtype=np.float64)
        self._base = BaseMomentum(system, system.robot)
        falls = bool(np.any(system.mj.opt.gravity))
        self._statement = BalanceSignals(fixed=bool(system.fixed), gravity=falls)
        self._numbers = np.zeros(_FALLEN + falls * NUMBERS * len(system.trees))
        self._accounts = BalanceTerms.of(self._numbers[:ACCOUNTS])
        self._fallen = self._numbers[_FALLEN:].reshape(-1, NUMBERS)
        self._gravity = Gravity(system, data, self._fallen) if falls else None
        self._carried = GraspedObjectBalance(system, data, momentum, self._numbers[ACCOUNTS:])
        external = external_actuators(system)
        on_joint = np.asarray(system.mj.actuator_trntype) == int(mujoco.mjtTrn.mjTRN_JOINT)
        flags = on_joint.astype(np.float64), external.astype(np.float64)
        self._joint_work = fastest(JointWork)(data, *flags, self._numbers)
        accounts = self._accounts.work, self._accounts.external
        by_pose = thrusters(system, data, *accounts)
        for books in by_pose:
            external[books.actuators] = False
        motors = [BaseMotors(system, data, external, on_joint, *accounts)] if external.any() else []
        self._outside: list[Thrusters | BaseMotors] = [*by_pose, *motors]
        self._pushed = False
        self.momentum = momentum
        self._notes = SampleBuffer(system, data, notes, momentum, self._numbers)
        mujoco.mj_mulM(system.mj, data, momentum, data.qvel)
        self.columns = (Columns(self._statement.signals, table=self.table, note=lambda _: self.note(), resume=self.resume),)
        self.resume(np.zeros(len(self._statement.signals)))

    def resume(self, told: FloatArray) -> None:
        """Go on at the state in ``data`` from what a row said there: accounts, and what they left unexplained.

        Args:
            told: The balance's columns of the row, zeros to begin, (number of signals,).
        """
        before = self._statement.balance(told[None])
        self._carried.forget()
        self._accounts.take(before.accounts)
        if self._gravity is not None:  # of the objects only their sum is known, and only changes count
            self._fallen.fill(0.0)
            work, impulse = before.accounts.fallen[0], before.accounts.gravity[0].reshape(2, 6)
            for tree, own, pushed in zip(self._fallen, work[1:], impulse, strict=False):
                tree[0], tree[1:] = own, pushed
        self._energy_0, self._momentum_0 = np.zeros(3), np.zeros((3, 6))
        self.note()
        start = self._balance()
        self._energy_0 = (start.energy_residual - before.energy_residual)[0]
        self._momentum_0 = (start.momentum_residual - before.momentum_residual)[0]

    def note(self) -> None:
        """Keep the state in ``data`` and the accounts; ``momentum`` must be current."""
        self._notes.take()

    def table(self) -> FloatArray:
        """Values of the columns at all notes since the last table, (n, number of signals); uses the notes up."""
        return self._statement.values(self._balance())

    def _balance(self) -> BalanceValues:
        """Work out all notes, and use them up."""
        notes, robot = self._notes, self._system.robot
        used, notes.used = slice(0, notes.used), 0
        h, accounts = notes.h[used], BalanceTerms.of(notes.accounts[used, :ACCOUNTS])
        for rows, gained in self._carried.gained(notes, used):
            accounts.gained[rows] += gained.energy_J
            accounts.contact[rows] += gained.impulse
        energy = subsystem_energies(h * notes.rates[used], robot.dofs)
        of_objects = sum((notes.momenta(tree.root, used) for tree in self._system.objects), np.zeros((used.stop, 6)))
        momentum = subsystem_momenta(notes.momenta(robot.root, used), of_objects)
        if self._gravity is not None:
            fallen = notes.accounts[used, _FALLEN:].reshape(used.stop, -1, NUMBERS)
            accounts.fallen[:], accounts.gravity[:] = by_party(fallen)
        residuals = self._unexplained(energy - self._energy_0, momentum - self._momentum_0, accounts)
        by_matrix = self._base.momenta(notes.jacp[used], notes.jacr[used], notes.position[used], h)
        return BalanceValues(energy, momentum, by_matrix, accounts, *residuals)

    def _unexplained(
        self, energy: FloatArray, momentum: FloatArray, accounts: BalanceTerms
    ) -> tuple[FloatArray, FloatArray]:
        """What accounts leave unexplained of changes of energy, (n, 3), and of momentum, (n, 3, 6); shapes as given."""
        grown = accounts.gained + accounts.fallen
        impulses = accounts.external, accounts.contact, accounts.fixed + accounts.gravity
        left = [
            (
                energy_balance_residual(subsystem, energy[:, i], accounts.work[:, 0], grown[:, i]),
                momentum_balance_residual(subsystem, momentum[:, i], *impulses, self.free[i]),
            )
            for i, subsystem in enumerate(SUBSYSTEMS)
        ]
        of_energy, of_momentum = (np.stack(parts, axis=1) for parts in zip(*left, strict=True))
        return of_energy, of_momentum

    def entered(self) -> FloatArray:
        """What one unit of each number of the accounts explains of (T, P, L) of (total, robot, objects), (21, numbers)."""
        units = BalanceTerms.of(np.eye(ACCOUNTS))
        energy, momentum = self._unexplained(np.zeros((ACCOUNTS, 3)), np.zeros((ACCOUNTS, 3, 6)), units)
        return -np.concatenate((energy[:, :, None], momentum), axis=2).reshape(ACCOUNTS, -1).T

    def increments(self, duration_s: float, bookings: Iterable[Exchange]) -> FloatArray:
        """What a (sub-)step since ``open`` would add to the accounts, (numbers,); they stay as they are.

        Args:
            duration_s: Of the step; the state in ``data`` is its end.
            bookings: What contacts exchanged in it.
        """
        numbers, kept = self._numbers, self._numbers.copy()
        numbers.fill(0.0)  # a sum since t = 0 would swallow the digits that matter here
        self.close(duration_s)
        for booking in bookings:
            self.book(*booking)
        if self._gravity is not None:
            self._accounts.fallen[:], self._accounts.gravity[:] = by_party(self._fallen)
        added = numbers[:ACCOUNTS].copy()
        numbers[:] = kept
        return added

    def carry(self, tree: Tree | None) -> None:
        """From the state in ``data`` on the robot gives what this object gains; what it gave to the last one is booked.

        To be told before and after each jump of the state, which is booked by who makes it.

        Args:
            tree: The object that it carries; None: nothing.
        """
        booked = self._carried.carry(tree)
        if booked is not None:
            self.book(*booked)

    def open(self) -> None:
        """Remember the state at the start of a (sub-)step, as far as the efforts held in it need it."""
        if self._gravity is not None:
            self._gravity.open()
        self._pushed = self._joint_work.open()
        if self._pushed:
            for pushing in self._outside:
                pushing.open()

    def close(self, duration_s: float) -> None:
        """Book the work and impulse of the efforts held since ``open``; the state in ``data`` is the end of the step."""
        self._joint_work.close()
        if self._gravity is not None:
            self._gravity.close(duration_s)
        if self._pushed:
            for pushing in self._outside:
                pushing.close(duration_s)

    def book(self, energy_change: FloatArray, contact: FloatArray, outside: FloatArray) -> None:
        """Book what contacts did, at an event or over a (sub-)step; impulses are (force part, moment about the origin).

        Args:
            energy_change: Kinetic energy that they gave to (total, robot, objects), J.
            contact: Impulse of the robot on the objects, (6,).
            outside: Impulse of fixed bodies on the robot and on the objects, (2, 6).
        """
        self._accounts.gained[:] += energy_change
        self._accounts.contact[:] += contact
        self._accounts.fixed[:] += outside.ravel()
