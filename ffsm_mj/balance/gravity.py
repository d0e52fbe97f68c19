"""Impulse and work of uniform gravity: an outside force on each subsystem, as exact as the motion itself.

The weight of a body is m g, less the share that MuJoCo's ``gravcomp`` holds up: both act at its mass centre. Over a
(sub-)step the impulse is weight times time and the work weight times way, exactly. The moment about the origin needs the
time integral of the weighted mass centre: that of the cubic Hermite polynomial through both ends, whose error per step is of
fifth order, as that of RK4.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.model.system import System

NUMBERS = 7
"""Accounts of one tree: work in J, impulse (P, L about the world origin) in N s and N m s."""


class Gravity:
    """Adds what gravity does to each tree in each (sub-)step to accounts."""

    def __init__(self, system: System, data: Any, accounts: FloatArray) -> None:
        """Bind to the bodies of the trees.

        Args:
            system: What moves.
            data: Its state.
            accounts: Work and impulse by tree, (number of trees, NUMBERS).
        """
        model = system.mj
        self._data, self._accounts = data, accounts
        self._g, self._roots = np.array(model.opt.gravity), np.array(model.body_rootid)
        weighted = model.body_mass * (1.0 - model.body_gravcomp)
        self._masses = np.zeros((len(system.trees), model.nbody))
        for row, tree in zip(self._masses, system.trees, strict=True):
            row[list(tree.bodies)] = weighted[list(tree.bodies)]
        self._force = self._masses.sum(axis=1)[:, None] * self._g
        self._start = self._look()

    def open(self) -> None:
        """Begin a (sub-)step at the state in ``data``, derived quantities current."""
        self._start = self._look()

    def close(self, duration_s: float) -> None:
        """End the step at the state in ``data``, derived quantities current."""
        (first, first_rate), (last, last_rate) = self._start, self._look()
        area = 0.5 * duration_s * (first + last) + duration_s**2 / 12.0 * (first_rate - last_rate)
        self._accounts[:, 0] += (last - first) @ self._g
        self._accounts[:, 1:4] += duration_s * self._force
        self._accounts[:, 4:] += np.cross(area, self._g)

    def _look(self) -> tuple[FloatArray, FloatArray]:
        """Sums of mass times place and velocity of the mass centres of bodies by tree, kg m and kg m/s, (trees, 3) each."""
        data, twists = self._data, self._data.cvel
        # MuJoCo's twists are about the mass centre of the whole tree, the angular part first.
        lever = data.xipos - data.subtree_com[self._roots]
        return self._masses @ data.xipos, self._masses @ (twists[:, 3:] + np.cross(twists[:, :3], lever))


def by_party(of_trees: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Work on (total, robot, objects), (..., 3), and impulses on robot and objects, (..., 12), of accounts by tree.

    Args:
        of_trees: Work and impulse by tree, the robot's first, (..., number of trees, NUMBERS).
    """
    robot, objects = of_trees[..., 0, :], of_trees[..., 1:, :].sum(axis=-2)
    work = np.stack((robot[..., 0] + objects[..., 0], robot[..., 0], objects[..., 0]), axis=-1)
    return work, np.concatenate((robot[..., 1:], objects[..., 1:]), axis=-1)
