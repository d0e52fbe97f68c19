"""What contacts, latches and projections of the state exchange between the subsystems."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from ffsm_mj._core.tick import Maxima
from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.projection import ClosedRows, project
from ffsm_mj.dynamics.rigid_body import free_components, momentum_matrix
from ffsm_mj.dynamics.springs import JointSprings
from ffsm_mj.model.system import System, Tree
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.signals import PROJECTED, Signal
from ffsm_mj.state import Stateful


def sum_exchanges(one: Exchange | None, other: Exchange) -> Exchange:
    """Sum of two exchanges."""
    if one is None:
        return other
    energy_J, impulse, outside = one.energy_J + other.energy_J, one.impulse + other.impulse, one.outside + other.outside
    return Exchange(energy_J, impulse, outside, one.friction_J + other.friction_J)


class BalanceSigns(NamedTuple):
    """Signs with which a wrench on body b, and its reaction on body a, enter the balance; zeros within a subsystem.

    Attributes:
        robot_on_objects: As a wrench of the robot on the objects.
        outside_on_robot: As an external wrench on the robot.
        outside_on_objects: As an external wrench on the objects.
    """

    robot_on_objects: float
    outside_on_robot: float
    outside_on_objects: float


def exchange_signs(system: System, a: int, b: int, grasped: frozenset[int] = frozenset()) -> BalanceSigns:
    """Signs of a wrench between two bodies in the balance.

    Args:
        system: The logged system.
        a: Id of a body of it.
        b: Id of another one.
        grasped: Bodies of a grasped object, which is integrated as a part of the robot; see ``balance/exchange.py``.
    """
    robot, moves = grasped.union(system.robot.bodies), [system.tree_of_body(body) is not None for body in (a, b)]
    if all(moves):
        return BalanceSigns(float(a in robot) - float(b in robot), 0.0, 0.0)
    free, sign = (b, 1.0) if moves[1] else (a, -1.0)
    if free in grasped:
        # The force acts on an object although it is integrated with the robot: it is entered for the object, and the
        # reaction that the robot's balance would otherwise see is subtracted.
        return BalanceSigns(-sign, 0.0, sign)
    return BalanceSigns(0.0, sign, 0.0) if free in robot else BalanceSigns(0.0, 0.0, sign)


class StateProjection(Stateful):
    """Projects the state of a scene onto closed contacts and loops, and accounts for what this changes.

    Attributes:
        largest_J: Largest change of the energy of a subsystem by one projection since the last sample, J, (1,).
        columns: Its column.
    """

    @dataclass
    class State:
        """The largest change since the last sample, J, (1,)."""

        largest_J: FloatArray

    def __init__(self, scene: Scene, what: str) -> None:
        """Determine the momentum components that the joints leave free.

        Args:
            scene: The logged system and its data.
            what: ``contacts`` or ``loops``: what closes at the beginning of steps.
        """
        self.largest_J, logged = np.zeros((2, 1))
        meaning = f"largest change of the energy of a subsystem by one projection onto closed {what} since the sample before"
        signals = (Signal("balance", PROJECTED.format(what), "J", meaning),)
        self.columns = (Columns(signals, live=logged, on_sample=Maxima(self.largest_J, logged)),)
        self._scene, model = scene, scene.system.mj
        self._springs = JointSprings(model)
        self._weights = (model.body_mass * (1.0 - model.body_gravcomp))[:, None] * model.opt.gravity
        self._free = np.all([free_components(scene.system, tree) for tree in scene.system.trees], axis=0)

    def apply(
        self, motion: Motion, rows_now: Callable[[], ClosedRows], projected: FloatArray, outside: BoolArray
    ) -> Exchange:
        """Project the state in ``data`` of a motion; returns the energy and momentum this changed.

        Args:
            motion: The motion; the logged system follows.
            rows_now: Returns the rows of the closed contacts at the current state.
            projected: Unit wrenches of contacts and latches with fixed bodies; see
                :func:`~ffsm_mj.dynamics.projection.project`.
            outside: Whether fixed bodies touch the robot, and whether they touch objects, (2,).
        """
        system, data = self._scene.system, self._scene.data
        before, qpos = self._energy_and_momenta(motion), data.qpos.copy()
        project(motion, rows_now, self._free, projected)
        motion.path.on_event_located()
        motion.stepper.account(0.0)  # its energy and momentum are those of other velocities
        now = self._energy_and_momenta(motion)
        energy, impulse, total = (after - then for after, then in zip(now, before, strict=True))
        # Only the sum of what fixed bodies absorb is known: it is entered for the robot if they touch it, else for the
        # objects. A grasped object counts as part of the robot here; the balance separates the two.
        from_outside = np.zeros((2, 6))
        if outside[0]:
            from_outside[0] = total
        elif outside[1]:
            from_outside[1] = total
            impulse = impulse - total
        # The balance computes actuator work from joint displacements, unless there are servos; the displacement of a
        # projection is not work. It takes the rates of dampers from them, too: Simpson's rule gives the power at the middle,
        # whose rate is off by 1.5 times the displacement over the step, a weight of two thirds of the step.
        displacement = np.empty(system.mj.nv)
        mujoco.mj_differentiatePos(system.mj, displacement, 1.0, qpos, data.qpos)
        if motion.power is None:
            energy[:2] -= float(data.qfrc_actuator @ displacement)
            others = [tree.dofs for tree in system.objects if tree not in self._robot_trees(motion)]
            of_others = sum(float(data.qfrc_actuator[dofs] @ displacement[dofs]) for dofs in others)
            energy[1:] += of_others, -of_others
        if self._springs.damped:
            heat, tendons = self._springs.dissipation_slope(data.qvel) * displacement, self._springs.tendons
            if tendons.damped:  # the dofs of a tendon are those of one tree
                heat += (tendons.dissipation_slope(tendons.rates(data)) @ tendons.rows(data)) * displacement
            of_robot = sum(float(heat[tree.dofs].sum()) for tree in self._robot_trees(motion))
            energy += np.array((heat.sum(), of_robot, heat.sum() - of_robot))
        self.largest_J[0] = max(self.largest_J[0], np.abs(energy).max())
        return Exchange(energy, impulse, from_outside)

    def _robot_trees(self, motion: Motion) -> tuple[Tree, ...]:
        """The robot, and a grasped object."""
        grasped = motion.grasped_object
        return (self._scene.system.robot, grasped) if grasped is not None else (self._scene.system.robot,)

    def _energy_and_momenta(self, motion: Motion) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Energy of (total, robot with grasped object, other objects), momentum of other objects, total momentum.

        The energy is kinetic and potential: the balance takes the energy of springs and the work of gravity from the
        positions at both ends of a step, so that they contain the displacement of a projection at its start.
        """
        system, data, grasped = self._scene.system, self._scene.data, motion.grasped_object
        momentum = np.empty(system.mj.nv)
        mujoco.mj_mulM(system.mj, data, momentum, data.qvel)
        total = 0.5 * float(momentum @ data.qvel)
        ours = self._robot_trees(motion)
        of_robot = sum(0.5 * float(momentum[tree.dofs] @ data.qvel[tree.dofs]) for tree in ours)
        elastic, tendons = self._springs.energy(data.qpos), self._springs.tendons
        np.add.at(elastic, tendons.dofs, tendons.energy(data))
        weight = np.einsum("ij,ij->i", self._weights, data.xipos)
        total += float(elastic.sum() - weight.sum())
        of_robot += sum(float(elastic[tree.dofs].sum() - weight[list(tree.bodies)].sum()) for tree in ours)
        of_objects = (
            momentum_matrix(system.mj, data, tree.root) @ data.qvel for tree in system.objects if tree is not grasped
        )
        energy, of_all = np.array((total, of_robot, total - of_robot)), momentum_matrix(system.mj, data, 0) @ data.qvel
        return energy, sum(of_objects, np.zeros(6)), of_all
