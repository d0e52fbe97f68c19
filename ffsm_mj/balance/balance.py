"""Energy and momentum balance of a run: accumulated work and impulses, and the residuals.

The work of a joint effort held over a step is force times displacement, exactly. That of a servo is the integral of its
power over the stages of the step. Terms that depend on where a force acts while the body moves are integrated over the
(sub-)step.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj._core.tick import StageWork, StepWork
from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.balance.external import Gravity, JointMotors, external_parts
from ffsm_mj.balance.signals import ACCOUNTS, BalanceSignals, BalanceTerms, BalanceValues, SampledStates
from ffsm_mj.balance.springs import SpringBalance
from ffsm_mj.balance.subsystems import (
    GraspedObjectBalance,
    TreeAccounts,
    energy_balance_residual,
    momentum_balance_residual,
    subsystem_energies,
    subsystem_momenta,
)
from ffsm_mj.dynamics.rigid_body import BaseMomentum, external_actuators, free_components
from ffsm_mj.dynamics.springs import JointSprings
from ffsm_mj.model.actuators import thruster_ids
from ffsm_mj.model.system import System, Tree
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.signals import SUBSYSTEMS
from ffsm_mj.state import entries, fitting

_OF_TREES = ACCOUNTS + GraspedObjectBalance.SIZE


class Balance:
    """Balance of one run: ``open`` before each (sub-)step, ``close`` after it, ``enter`` at events.

    Samples are copies of MuJoCo's arrays; energies, momenta and residuals of many samples are then computed at once. So are
    the energy and momentum that the robot transfers to a grasped object, which therefore cost nothing during a step.

    Attributes:
        free: Which of (P, L about the origin) the base joints of (total, robot, objects) leave free, 1 or 0, (3, 6).
        momentum: Array in which M qdot is kept current, (nv,).
        work: Work and impulse of the efforts held in a (sub-)step, of gravity, fields and springs.
        columns: Energies, momenta, balance terms and residuals.
    """

    @dataclass
    class State:
        """Sums since t = 0, and place of the grasped object among the objects, from 0; None: there is none."""

        numbers: FloatArray
        grasped: int | None

    def __init__(
        self,
        system: System,
        data: Any,
        momentum: FloatArray,
        *,
        actuator_work: FloatArray | None = None,
        actuator_impulse: FloatArray | None = None,
        field_done: FloatArray | None = None,
    ) -> None:
        """Start the balance at the state in ``data`` (all derived quantities current).

        Args:
            system: Robot and objects.
            data: Their state.
            momentum: Array in which M qdot is kept current, (nv,).
            actuator_work: Array in which the work of the actuators in the last (sub-)step is kept, J, (number of trees,);
                None: there are no servos.
            actuator_impulse: The same of the impulse of servos that act from outside, (P, L about the world origin),
                (number of trees, 6); None: there are none.
            field_done: The same of work and impulse of external fields, (number of trees, 7); None: there are none.
        """
        self._system = system
        robot_free = free_components(system, system.robot)
        object_free = [free_components(system, tree) for tree in system.objects]
        objects_free = np.all(object_free, axis=0) if object_free else np.ones(6, dtype=np.bool_)
        self.free = np.array([robot_free & objects_free, robot_free, objects_free], dtype=np.float64)
        self._base = BaseMomentum(system, system.robot)
        falls, joints = bool(np.any(system.mj.opt.gravity)), JointSprings(system.mj)
        springy, trees = joints.elastic or joints.damped, len(system.trees)
        driven, fields = any(tree > 0 for tree in system.actuator_trees), field_done is not None
        present = {"fixed": bool(system.fixed), "gravity": falls, "fields": fields, "driven": driven}
        self._statement = BalanceSignals(**present, springs=joints.elastic, dampers=joints.damped)
        kept = {"falls": falls, "springy": springy, "driven": driven, "fields": fields}
        self._numbers = np.zeros(_OF_TREES + TreeAccounts.size(trees, **kept))
        self._accounts = BalanceTerms.of(self._numbers[:ACCOUNTS])
        self._of_trees = TreeAccounts(self._numbers[_OF_TREES:], trees, **kept)
        gravity = Gravity(system, data, self._of_trees.gravity) if falls else None
        self._springs = SpringBalance(system, data, joints, self._of_trees.springs) if springy else None
        totals = self._numbers[ACCOUNTS:_OF_TREES]
        self._grasped_object = GraspedObjectBalance(system, data, momentum, totals, self._of_trees)
        always: list[Any] = [part for part in (gravity, self._springs) if part is not None]
        if field_done is not None:
            always = [*always, StageWork(field_done, self._of_trees.fields)]
        self.work = self._step_work(data, always, actuator_work, actuator_impulse)
        self.momentum = momentum
        self._sample, self._update_sample = SampledStates.live(system, data, momentum, self._numbers)
        mujoco.mj_mulM(system.mj, data, momentum, data.qvel)
        signals = self._statement.signals
        self.columns = (Columns(signals, self._sample, self._table, self._update_sample, self.resume),)
        self.resume(np.zeros(len(self._statement.signals)))

    def _step_work(
        self, data: Any, always: list[Any], actuator_work: FloatArray | None, actuator_impulse: FloatArray | None
    ) -> StepWork:
        """Accounts of the actuators over a (sub-)step: the robot's, and those of each object that has any."""
        system, accounts = self._system, self._accounts
        on_joint = elsewhere = np.asarray(system.mj.actuator_trntype) == int(mujoco.mjtTrn.mjTRN_JOINT)
        if actuator_work is not None:
            # The stages of the steps integrate the work of all actuators but thrusters.
            on_joint, elsewhere = np.zeros_like(on_joint), np.ones_like(on_joint)
            elsewhere[thruster_ids(system.mj)] = False
            always = [*always, StageWork(actuator_work[:1], accounts.work)]
            if actuator_impulse is not None:
                always = [*always, StageWork(actuator_impulse[0], accounts.external)]
        of_tree = np.array(system.actuator_trees, dtype=np.intp)
        outside = external_parts(system, data, 0, (accounts.work, accounts.external), elsewhere)
        for tree, account in enumerate(self._of_trees.actuators):
            motors = np.flatnonzero(on_joint & (of_tree == tree))
            if tree and motors.size:
                always = [*always, JointMotors(data, motors, account[:1])]
            if tree and actuator_work is not None:
                always = [*always, StageWork(actuator_work[tree : tree + 1], account[:1])]
                if actuator_impulse is not None:
                    always = [*always, StageWork(actuator_impulse[tree], account[1:])]
            if tree:
                outside += external_parts(system, data, tree, (account[:1], account[1:]), elsewhere)
        flags = (on_joint & (of_tree == 0)).astype(np.float64), external_actuators(system).astype(np.float64)
        return StepWork(data, *flags, self._numbers, accounts.gained, accounts.contact, accounts.fixed, always, outside)

    def resume(self, logged: FloatArray) -> None:
        """Continue at the state in ``data`` with the balance terms and residuals of a logged row.

        Args:
            logged: The balance's columns of the row, or zeros at the start, (number of signals,).
        """
        before = self._statement.balance(logged[None])
        self._grasped_object.forget()
        self._accounts.take(before.accounts)
        # A row logs the sums over all objects only, which the first takes: changes are all that counts.
        terms = before.accounts
        self._of_trees.numbers.fill(0.0)
        outside = (
            (self._of_trees.gravity, terms.fallen, terms.gravity),
            (self._of_trees.fields, terms.field_work, terms.field),
        )
        for trees, work, impulse in outside:
            for tree, done, pushed in zip(trees, work[0, 1:], impulse[0].reshape(2, 6), strict=False):
                tree[0], tree[1:] = done, pushed
        for sums in self._of_trees.actuators[1:2]:
            sums[0], sums[1:] = terms.objects_work[0, 0], terms.objects_external[0]
        for tree, *sums in zip(self._of_trees.springs, terms.heat[0, 1:], terms.truncation[0, 1:], strict=False):
            tree[1:] = sums
        if self._springs is not None:
            self._springs.set_elastic()
        self._energy_0, self._momentum_0 = np.zeros(3), np.zeros((3, 6))
        self._update_sample(math.nan)
        start = self._balance(self._sample[None])
        self._energy_0 = (start.energy_residual - before.energy_residual)[0]
        self._momentum_0 = (start.momentum_residual - before.momentum_residual)[0]

    def _table(self, samples: FloatArray) -> FloatArray:
        """Values of the columns at samples, (n, number of signals)."""
        return self._statement.values(self._balance(samples))

    def _balance(self, samples: FloatArray) -> BalanceValues:
        """Balance at samples, (n, numbers of a sample), which has begun where :meth:`resume` says."""
        states, objects = SampledStates(self._system, samples), range(1, len(self._system.trees))
        accounts = BalanceTerms.of(states.accounts[:, :ACCOUNTS].copy())
        for rows, gained in self._grasped_object.gained(states):
            accounts.gained[rows] += gained.energy_J
            accounts.contact[rows] += gained.impulse
        energy = subsystem_energies(states.h * states.rates, self._system.robot.dofs)
        momentum = subsystem_momenta(states.momenta(0), sum(map(states.momenta, objects), np.zeros((len(samples), 6))))
        self._of_trees.enter(states.accounts[:, _OF_TREES:], accounts)
        residuals = self._unexplained(energy - self._energy_0, momentum - self._momentum_0, accounts)
        by_matrix = self._base.momenta(states.jacp, states.jacr, states.position, states.h)
        return BalanceValues(energy, momentum, by_matrix, accounts, *residuals)

    def _unexplained(
        self, energy: FloatArray, momentum: FloatArray, accounts: BalanceTerms
    ) -> tuple[FloatArray, FloatArray]:
        """Residuals of energy, (n, 3), and of momentum, (n, 3, 6)."""
        grown = accounts.gained + accounts.fallen + accounts.field_work - accounts.elastic - accounts.heat
        grown[:, 0::2] += accounts.objects_work  # of the whole and of the objects
        outside = accounts.fixed + accounts.gravity + accounts.field
        outside[:, 6:] += accounts.objects_external
        impulses = accounts.external, accounts.contact, outside
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
        """Matrix from balance terms to the changes of (T, P, L) of (total, robot, objects) they account for, (21, terms)."""
        units = BalanceTerms.of(np.eye(ACCOUNTS))
        energy, momentum = self._unexplained(np.zeros((ACCOUNTS, 3)), np.zeros((ACCOUNTS, 3, 6)), units)
        return -np.concatenate((energy[:, :, None], momentum), axis=2).reshape(ACCOUNTS, -1).T

    @property
    def grasped_object(self) -> Tree | None:
        """The grasped object; None if there is none."""
        return self._grasped_object.tree

    def increments(
        self, duration_s: float, exchanges: Iterable[Exchange], grasped_change: FloatArray | None = None
    ) -> FloatArray:
        """Balance terms of the (sub-)step since ``open``, (terms,); the accumulated terms are unchanged.

        Args:
            duration_s: Duration of the step; the state in ``data`` is its end.
            exchanges: What contacts exchanged during the step.
            grasped_change: Change of kinetic energy, P and L of the grasped object during the step, (7,); None without one.
        """
        numbers, kept = self._numbers, self._numbers.copy()
        numbers.fill(0.0)  # differences of sums since t = 0 would lose the digits that matter here
        self.close(duration_s)
        for exchange in exchanges:
            self.enter(exchange)
        if grasped_change is not None:
            self.enter(self._grasped_object.exchange(grasped_change))
        self._of_trees.enter(self._of_trees.numbers, self._accounts)
        added = numbers[:ACCOUNTS].copy()
        numbers[:] = kept
        return added

    def set_grasped_object(self, tree: Tree | None) -> None:
        """Start or end the transfer of energy and momentum to a grasped object at the state in ``data``.

        What the previous grasped object gained is entered in the balance as given by the robot. Call this before and
        after each jump of the state; whoever makes the jump enters it.

        Args:
            tree: The grasped object; None: no object is grasped.
        """
        exchange = self._grasped_object.set_object(tree)
        if self._springs is not None:
            self._springs.grasped = 1 + self._system.objects.index(tree) if tree is not None else 0
        if exchange is not None:
            self.enter(exchange)

    def get_state(self) -> State:
        """What has been accumulated."""
        tree = self._grasped_object.tree
        return self.State(self._numbers.copy(), None if tree is None else self._system.objects.index(tree))

    def set_state(self, state: Any) -> None:
        """Go on from a state; ``data`` is at it."""
        saved = entries(state, ("numbers", "grasped"), "Balance")
        self.set_grasped_object(None if saved["grasped"] is None else self._system.objects[saved["grasped"]])
        self._numbers[:] = fitting(saved["numbers"], self._numbers.shape, "Balance")

    def open(self) -> None:
        """Begin a (sub-)step: store what the efforts held during it need of the state."""
        self.work.open()

    def close(self, duration_s: float) -> None:
        """Enter the work and impulse of the efforts held since ``open``; the state in ``data`` is the end of the step."""
        self.work.close(duration_s)

    def enter(self, exchange: Exchange) -> None:
        """Enter the exchange of contacts at an event or over a (sub-)step."""
        self.work.enter(exchange.energy_J, exchange.impulse, exchange.outside)
