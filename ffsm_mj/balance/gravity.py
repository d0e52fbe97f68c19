"""Impulse and work of uniform gravity, an external force on each subsystem, to the order of the integrator.

The weight of a body is m g, reduced by the share that MuJoCo's ``gravcomp`` compensates; both act at its centre of mass.
Over a (sub-)step the impulse is weight times duration and the work weight times displacement, exactly. The moment about the
origin needs the time integral of the position of the centre of mass: the cubic Hermite polynomial through both ends gives
it with a fifth-order error per step, like RK4.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.model.system import System

NUMBERS = 7
"""Values per tree: work in J, impulse (P, L about the world origin) in N s and N m s."""


class Gravity:
    """Integrates the work and impulse of gravity on each tree over each (sub-)step."""

    def __init__(self, system: System, data: Any, accounts: FloatArray) -> None:
        """Bind to the bodies of the trees.

        Args:
            system: Robot and objects.
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
        self._accounts[:, 4:] += _cross(area, self._g)

    def _look(self) -> tuple[FloatArray, FloatArray]:
        """Sums of mass times position and velocity of bodies' centres of mass by tree, kg m and kg m/s, (trees, 3) each."""
        data, twists = self._data, self._data.cvel
        # MuJoCo's twists are about the centre of mass of the whole tree, angular part first.
        lever = data.xipos - data.subtree_com[self._roots]
        return self._masses @ data.xipos, self._masses @ (twists[:, 3:] + _cross(twists[:, :3], lever))


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products of rows, (n, 3), as ``numpy.cross`` computes them at six times the cost of so few."""
    (x, y, z), (u, v, w) = a.T, b.T
    return np.stack((y * w - z * v, z * u - x * w, x * v - y * u), axis=1)


def by_subsystem(of_trees: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Work on (total, robot, objects), (..., 3), and impulses on robot and objects, (..., 12), from values by tree.

    Args:
        of_trees: Work and impulse by tree, the robot's first, (..., number of trees, NUMBERS).
    """
    robot, objects = of_trees[..., 0, :], of_trees[..., 1:, :].sum(axis=-2)
    work = np.stack((robot[..., 0] + objects[..., 0], robot[..., 0], objects[..., 0]), axis=-1)
    return work, np.concatenate((robot[..., 1:], objects[..., 1:]), axis=-1)
