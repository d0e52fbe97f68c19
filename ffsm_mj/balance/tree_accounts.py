"""What acts on each tree alone: gravity, and the springs and dampers of its own joints; sums since t = 0."""

from __future__ import annotations

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance import gravity, springs
from ffsm_mj.balance.signals import BalanceTerms


class TreeAccounts:
    """Layout of the accounts of all trees, and the balance terms that follow from them.

    Attributes:
        numbers: The values, (number of values,).
        gravity: Those of gravity, a view, (number of trees or 0, gravity.NUMBERS).
        springs: Those of springs and dampers, a view, (number of trees or 0, springs.NUMBERS).
    """

    def __init__(self, numbers: FloatArray, trees: int, *, falls: bool) -> None:
        """Lay out the values.

        Args:
            numbers: Array for the values, of the size of :meth:`size`.
            trees: Number of trees.
            falls: Whether there is gravity; springs and dampers take what is left.
        """
        self.numbers, self._trees, self._fallen = numbers, trees, trees * gravity.NUMBERS * falls
        self.gravity, self.springs = self._parts(numbers)

    @staticmethod
    def size(trees: int, *, falls: bool, springy: bool) -> int:
        """Number of values."""
        return trees * (gravity.NUMBERS * falls + springs.NUMBERS * springy)

    def _parts(self, numbers: FloatArray) -> tuple[FloatArray, FloatArray]:
        fallen, stored = numbers[..., : self._fallen], numbers[..., self._fallen :]
        lead = numbers.shape[:-1]
        return (
            fallen.reshape(*lead, self._trees if fallen.size else 0, gravity.NUMBERS),
            stored.reshape(*lead, self._trees if stored.size else 0, springs.NUMBERS),
        )

    def enter(self, numbers: FloatArray, terms: BalanceTerms) -> None:
        """Write the balance terms that follow from values, (..., number of values)."""
        of_gravity, of_springs = self._parts(numbers)
        if of_gravity.size:
            terms.fallen[:], terms.gravity[:] = gravity.by_subsystem(of_gravity)
        if of_springs.size:
            terms.elastic[:], terms.heat[:], terms.truncation[:] = np.moveaxis(springs.by_subsystem(of_springs), -2, 0)

    def given(self, numbers: FloatArray, tree: int) -> FloatArray | None:
        """Energy and momentum that a tree has by what acts on it alone, (..., 7); None if nothing does.

        Args:
            numbers: Values, (..., number of values).
            tree: Index of the tree.
        """
        of_gravity, of_springs = self._parts(numbers)
        if not (of_gravity.size or of_springs.size):
            return None
        given = of_gravity[..., tree, :].copy() if of_gravity.size else np.zeros((*numbers.shape[:-1], gravity.NUMBERS))
        if of_springs.size:
            given[..., 0] -= of_springs[..., tree, 0] + of_springs[..., tree, 1]
        return given
