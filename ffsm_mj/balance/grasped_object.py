"""Energy and momentum that a grasped object gains from the robot: the change between two states, less that by gravity.

Its energy includes that of its own joint springs and the heat of its dampers.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.balance.sample_buffer import SampleBuffer
from ffsm_mj.balance.tree_accounts import TreeAccounts
from ffsm_mj.dynamics.rigid_body import subtree_momenta
from ffsm_mj.model.system import System, Tree


class GraspedObjectBalance:
    """The grasped object: its number among the objects, from 1, and its energy and momentum when the grasp began."""

    SIZE = 8
    """Number of values per sample."""

    def __init__(self, system: System, data: Any, momentum: FloatArray, numbers: FloatArray, accounts: TreeAccounts) -> None:
        """Start without a grasped object.

        Args:
            system: Robot and objects.
            data: Their state.
            momentum: M qdot, kept current by the caller, (nv,).
            numbers: Array for the sampled values: number; energy in J; P and L about the origin, (SIZE,).
            accounts: What gravity, springs and dampers did to each tree, kept current by the caller.
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
        exchange = _given(self._now(before) - self._start) if before is not None else None
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
        own = self._accounts.given(self._accounts.numbers, 1 + self._system.objects.index(self._tree))
        return _given(change if own is None else change - own)

    def _now(self, tree: Tree) -> FloatArray:
        data, root, h, rates = self._data, tree.root, self._momentum, self._data.qvel
        mujoco.mj_subtreeVel(self._system.mj, data)
        mass = float(self._system.mj.body_subtreemass[root])
        momentum = subtree_momenta(mass, data.subtree_linvel[root], data.subtree_com[root], data.subtree_angmom[root])
        now = np.concatenate(((0.5 * float(h[tree.dofs] @ rates[tree.dofs]),), momentum))
        own = self._accounts.given(self._accounts.numbers, 1 + self._system.objects.index(tree))
        return now if own is None else now - own

    def gained(self, buffer: SampleBuffer, used: slice) -> Iterator[tuple[Any, Exchange]]:
        """What the grasped object has gained since the grasp began: rows of the buffer, and the exchange for all of them."""
        rest = buffer.accounts[used, -(self.SIZE + self._accounts.numbers.size) :]
        numbers, others = rest[:, : self.SIZE], rest[:, self.SIZE :]
        for number in map(int, sorted(set(numbers[:, 0].tolist()) - {0.0})):
            tree, rows = self._system.objects[number - 1], numbers[:, 0] == number
            energy = 0.5 * (buffer.h[used, tree.dofs] * buffer.rates[used, tree.dofs]).sum(axis=1, keepdims=True)
            states = np.concatenate((energy, buffer.momenta(tree.root, used)), axis=1)
            own = self._accounts.given(others, number)
            if own is not None:
                states -= own
            yield rows, _given(states[rows] - numbers[rows, 1:])


def _given(change: FloatArray) -> Exchange:
    """Exchange between robot and object from the object's change of energy and momentum, (..., 7)."""
    energy = change[..., :1]
    return Exchange(np.concatenate((np.zeros_like(energy), -energy, energy), axis=-1), change[..., 1:])
