"""Energies, momenta and their residuals by subsystem: total, robot and objects.

Gravity, external fields, the springs and dampers of its own joints, and the actuators of an object act on each tree alone;
their sums since t = 0 are kept by tree. What a grasped object gains from the robot is the change of its energy and momentum
between two states, less what these sums give it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.balance.external import Gravity
from ffsm_mj.balance.signals import BalanceTerms, SampledStates
from ffsm_mj.balance.springs import SpringBalance
from ffsm_mj.dynamics.rigid_body import subtree_momenta
from ffsm_mj.model.system import System, Tree


def subsystem_energies(powers: FloatArray, robot: slice) -> FloatArray:
    """Kinetic energies of (total, robot, objects), J, (n, 3).

    Args:
        powers: Generalised momentum times rate by dof, (n, nv).
        robot: Degrees of freedom of the robot.
    """
    total, of_robot = 0.5 * powers.sum(axis=1), 0.5 * powers[:, robot].sum(axis=1)
    return np.stack((total, of_robot, total - of_robot), axis=1)


def subsystem_momenta(robot: FloatArray, objects: FloatArray) -> FloatArray:
    """Momenta of (total, robot, objects) from those of robot and objects, (n, 6) each; (n, 3, 6)."""
    return np.stack((robot + objects, robot, objects), axis=1)


def energy_balance_residual(subsystem: str, energy: FloatArray, work: FloatArray, gained: FloatArray) -> FloatArray:
    """Energy of a subsystem less the work of the actuators, which act on the robot, and other energy gained, J, (n,).

    Args:
        subsystem: ``total``, ``robot`` or ``objects``.
        energy: Kinetic energy of the subsystem, J, (n,).
        work: Work of the actuators, J, (n,).
        gained: Energy gained by the subsystem in impacts and contacts, from gravity and from fields, J, (n,).
    """
    return (energy if subsystem == "objects" else energy - work) - gained


def momentum_balance_residual(
    subsystem: str, momentum: FloatArray, external: FloatArray, contact: FloatArray, outside: FloatArray, free: FloatArray
) -> FloatArray:
    """Momentum (P, L about the origin) of a subsystem less impulses, N s and N m s, (n, 6); zero on constrained components.

    Args:
        subsystem: ``total``, ``robot`` or ``objects``.
        momentum: Momentum of the subsystem, (n, 6).
        external: External impulse of base actuators on the robot, (n, 6).
        contact: Impulse of the robot on the objects, the opposite of that on the robot, (n, 6).
        outside: Impulse of fixed bodies, of gravity and of fields on robot and objects, (n, 12).
        free: 1 for each component that the subsystem's base joints leave free, else 0, (6,).
    """
    on_robot, on_objects = outside[:, :6], outside[:, 6:]
    explained = {
        "total": external + on_robot + on_objects,
        "robot": external - contact + on_robot,
        "objects": contact + on_objects,
    }[subsystem]
    return np.asarray((momentum - explained) * free)


class TreeAccounts:
    """Sums since t = 0 of what acts on each tree alone: their layout, and the balance terms that follow from them.

    Attributes:
        numbers: The values, (number of values,).
        gravity: Those of gravity, a view, (number of trees or 0, Gravity.SIZE).
        springs: Those of springs and dampers, a view, (number of trees or 0, SpringBalance.SIZE).
        actuators: Work and impulse of those of the objects, a view, (number of trees or 0, Gravity.SIZE); the first is zero.
        fields: Those of external fields, a view, (number of trees or 0, Gravity.SIZE).
    """

    def __init__(self, numbers: FloatArray, trees: int, *, falls: bool, springy: bool, driven: bool, fields: bool) -> None:
        """Lay out the values.

        Args:
            numbers: Array for the values, of the size of :meth:`size`.
            trees: Number of trees.
            falls: Whether there is gravity.
            springy: Whether there are springs or dampers.
            driven: Whether an object has actuators.
            fields: Whether there are external fields.
        """
        self.numbers = numbers
        sizes, present = (Gravity.SIZE, SpringBalance.SIZE, Gravity.SIZE, Gravity.SIZE), (falls, springy, driven, fields)
        self._tables = [(trees * there, size) for size, there in zip(sizes, present, strict=True)]
        self.gravity, self.springs, self.actuators, self.fields = self._parts(numbers)

    @staticmethod
    def size(trees: int, *, falls: bool, springy: bool, driven: bool, fields: bool) -> int:
        """Number of values."""
        return trees * (Gravity.SIZE * (falls + driven + fields) + SpringBalance.SIZE * springy)

    def _parts(self, numbers: FloatArray) -> list[FloatArray]:
        ends = np.cumsum([lines * size for lines, size in self._tables[:-1]])
        parts = np.split(numbers, ends, axis=-1)
        return [part.reshape(*numbers.shape[:-1], *table) for part, table in zip(parts, self._tables, strict=True)]

    def enter(self, numbers: FloatArray, terms: BalanceTerms) -> None:
        """Write the balance terms that follow from values, (..., number of values)."""
        of_gravity, of_springs, of_actuators, of_fields = self._parts(numbers)
        if of_actuators.size:
            of_objects = of_actuators[..., 1:, :].sum(axis=-2)
            terms.objects_work[:], terms.objects_external[:] = of_objects[..., :1], of_objects[..., 1:]
        if of_gravity.size:
            terms.fallen[:], terms.gravity[:] = _external_by_subsystem(of_gravity)
        if of_fields.size:
            terms.field_work[:], terms.field[:] = _external_by_subsystem(of_fields)
        if of_springs.size:
            terms.elastic[:], terms.heat[:], terms.truncation[:] = np.moveaxis(_springs_by_subsystem(of_springs), -2, 0)

    def entered(self, numbers: FloatArray, tree: int) -> FloatArray | None:
        """Energy and momentum that a tree has by what acts on it alone, (..., 7); None if nothing does.

        Args:
            numbers: Values, (..., number of values).
            tree: Index of the tree.
        """
        of_gravity, of_springs, of_actuators, of_fields = self._parts(numbers)
        if not numbers.size:
            return None
        entered = of_gravity[..., tree, :].copy() if of_gravity.size else np.zeros((*numbers.shape[:-1], Gravity.SIZE))
        if of_springs.size:
            entered[..., 0] -= of_springs[..., tree, 0] + of_springs[..., tree, 1]
        if of_actuators.size:
            entered += of_actuators[..., tree, :]
        if of_fields.size:
            entered += of_fields[..., tree, :]
        return entered


def _external_by_subsystem(of_trees: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Work on (total, robot, objects), (..., 3), and impulses on robot and objects, (..., 12), from values by tree.

    Args:
        of_trees: Work and impulse by tree, the robot's first, (..., number of trees, Gravity.SIZE).
    """
    robot, objects = of_trees[..., 0, :], of_trees[..., 1:, :].sum(axis=-2)
    work = np.stack((robot[..., 0] + objects[..., 0], robot[..., 0], objects[..., 0]), axis=-1)
    return work, np.concatenate((robot[..., 1:], objects[..., 1:]), axis=-1)


def _springs_by_subsystem(of_trees: FloatArray) -> FloatArray:
    """Values of springs of (total, robot, objects), (..., SpringBalance.SIZE, 3), from those by tree.

    Args:
        of_trees: Values by tree, the robot's first, (..., number of trees, SpringBalance.SIZE).
    """
    robot, objects = of_trees[..., 0, :], of_trees[..., 1:, :].sum(axis=-2)
    return np.stack((robot + objects, robot, objects), axis=-1)


class GraspedObjectBalance:
    """The grasped object: its number among the objects, from 1, and its energy and momentum when the grasp began.

    Its energy includes that of its own joint springs and the heat of its dampers; the work of its actuators is its own too.
    """

    SIZE = 8
    """Number of values per sample."""

    def __init__(self, system: System, data: Any, momentum: FloatArray, numbers: FloatArray, accounts: TreeAccounts) -> None:
        """Start without a grasped object.

        Args:
            system: Robot and objects.
            data: Their state.
            momentum: M qdot, kept current by the caller, (nv,).
            numbers: Array for the sampled values: number; energy in J; P and L about the origin, (SIZE,).
            accounts: What gravity, fields, springs and dampers did to each tree, kept current by the caller.
        """
        self._system, self._data, self._momentum = system, data, momentum
        self._numbers, self._start, self._accounts = numbers, numbers[1:], accounts
        self._tree: Tree | None = None

    def forget(self) -> None:
        """Reset: no object is grasped."""
        self._tree = None
        self._numbers.fill(0.0)

    def set_object(self, tree: Tree | None) -> Exchange | None:
        """Begin at the state in ``data``, derived quantities current, to account for a grasped object, or for none.

        Returns:
            What the robot gave to the previous grasped object; None if there was none.
        """
        before = self._tree
        exchange = _entered(self._now(before) - self._start) if before is not None else None
        if tree is not before:
            self.forget()
            self._tree = tree
        if tree is not None:
            self._numbers[0], self._start[:] = 1.0 + self._system.objects.index(tree), self._now(tree)
        return exchange

    @property
    def tree(self) -> Tree | None:
        """The grasped object; None if there is none."""
        return self._tree

    def exchange(self, change: FloatArray) -> Exchange:
        """What the robot gave to the grasped object over a step that the accounts cover alone.

        Args:
            change: Change of the object's kinetic energy in J, P and L about the origin, (7,).
        """
        assert self._tree is not None
        numbers = self._accounts.entered(self._accounts.numbers, 1 + self._system.objects.index(self._tree))
        return _entered(change if numbers is None else change - numbers)

    def _now(self, tree: Tree) -> FloatArray:
        data, root, h, rates = self._data, tree.root, self._momentum, self._data.qvel
        mujoco.mj_subtreeVel(self._system.mj, data)
        mass = float(self._system.mj.body_subtreemass[root])
        momentum = subtree_momenta(mass, data.subtree_linvel[root], data.subtree_com[root], data.subtree_angmom[root])
        now = np.concatenate(((0.5 * float(h[tree.dofs] @ rates[tree.dofs]),), momentum))
        numbers = self._accounts.entered(self._accounts.numbers, 1 + self._system.objects.index(tree))
        return now if numbers is None else now - numbers

    def gained(self, states: SampledStates) -> Iterator[tuple[Any, Exchange]]:
        """What the grasped object has gained since the grasp began: which of the states, and the exchange in all of them."""
        rest = states.accounts[:, -(self.SIZE + self._accounts.numbers.size) :]
        numbers, others = rest[:, : self.SIZE], rest[:, self.SIZE :]
        for number in map(int, sorted(set(numbers[:, 0].tolist()) - {0.0})):
            dofs, rows = self._system.trees[number].dofs, numbers[:, 0] == number
            energy = 0.5 * (states.h[:, dofs] * states.rates[:, dofs]).sum(axis=1, keepdims=True)
            values = np.concatenate((energy, states.momenta(number)), axis=1)
            of_tree = self._accounts.entered(others, number)
            if of_tree is not None:
                values -= of_tree
            yield rows, _entered(values[rows] - numbers[rows, 1:])


def _entered(change: FloatArray) -> Exchange:
    """Exchange between robot and object from the object's change of energy and momentum, (..., 7)."""
    energy = change[..., :1]
    return Exchange(np.concatenate((np.zeros_like(energy), -energy, energy), axis=-1), change[..., 1:])
