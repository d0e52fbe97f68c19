"""Elastic energy, damper heat and truncation of joint springs, by tree, over (sub-)steps.

Springs and dampers act between two links of one tree, so they exchange no momentum with anything else. The elastic energy
is a function of the configuration. The heat is integrated by Simpson's rule with a cubic Hermite midpoint, as external
forces are: its error is of fifth order per step, and it is a sum of terms that are not negative.

RK4 multiplies the energy of a mode of frequency w by 1 - (h w)^6 / 72 + (h w)^8 / 576 in a step h (Hairer, Norsett & Wanner,
*Solving Ordinary Differential Equations I*, sec. II.1: the stability function at i h w). With the accelerations a and rates
v of a step, the first term is, over all modes,

    h^6 / 144 (v^T K M^-1 K M^-1 K v + a^T K M^-1 K a)
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.midpoint import hermite_midpoint
from ffsm_mj.dynamics.joint_springs import JointSprings
from ffsm_mj.model.system import System
from ffsm_mj.tolerances import MODE_STEP

NUMBERS = 3
"""Values per tree: elastic energy, heat of dampers, and energy that the truncation of RK4 takes from the modes, J."""


class SpringBalance:
    """Enters the springs and dampers of each tree over each (sub-)step.

    Attributes:
        grasped: Index of the tree of a grasped object, whose truncation is the robot's as its energy is; 0 for none.
    """

    def __init__(self, system: System, data: Any, springs: JointSprings, accounts: FloatArray) -> None:
        """Bind to the joints of the trees.

        Args:
            system: Robot and objects.
            data: Their state.
            springs: Springs and dampers of their joints.
            accounts: Values by tree, (number of trees, NUMBERS).
        """
        self._model, self._data, self._springs, self._accounts = system.mj, data, springs, accounts
        self.grasped = 0
        self._trees = np.zeros((len(system.trees), system.mj.nv))
        for row, tree in zip(self._trees, system.trees, strict=True):
            row[tree.dofs] = 1.0
        self._forces, self._answers = np.zeros((3, system.mj.nv)), np.zeros((3, system.mj.nv))
        self.open()

    def set_elastic(self) -> None:
        """Set the elastic energy to that of the state in ``data``."""
        self._accounts[:, 0] = self._trees @ self._springs.energy(self._data.qpos)

    def open(self) -> None:
        """Begin a (sub-)step at the state in ``data``."""
        self._qpos, self._qvel = self._data.qpos.copy(), self._data.qvel.copy()

    def close(self, duration_s: float) -> None:
        """End the step at the state in ``data``, derived quantities current."""
        springs, data, accounts = self._springs, self._data, self._accounts
        if springs.elastic:
            accounts[:, 0] += self._trees @ (springs.energy(data.qpos) - springs.energy(self._qpos))
            taken = self._truncation(duration_s)
            if self.grasped:
                taken[0], taken[self.grasped] = taken[0] + taken[self.grasped], 0.0
            accounts[:, 2] += taken
        if springs.damped:
            accounts[:, 1] += self._trees @ self._heat(duration_s)

    def _heat(self, duration_s: float) -> FloatArray:
        """Heat of dampers by degree of freedom, J, (nv,)."""
        data, power = self._data, self._springs.dissipation
        _, middle = hermite_midpoint(self._model, self._qpos, self._qvel, data.qpos, data.qvel, duration_s)
        return duration_s / 6.0 * (power(self._qvel) + 4.0 * power(middle) + power(data.qvel))

    def _truncation(self, duration_s: float) -> FloatArray:
        """Energy that RK4 takes from the modes in the step, J, by tree; zero where they are too fast for its step."""
        K, v, h = self._springs.stiffness(self._data.qpos), self._data.qvel, duration_s
        forces, answers = self._forces, self._answers
        forces[0], forces[1], forces[2] = K * self._qvel, K * v, K * (v - self._qvel) / h
        mujoco.mj_solveM(self._model, self._data, answers, forces)
        moving = 0.5 * np.sum(answers[:2] * K * answers[:2], axis=0)
        # The mean of w^2 over the modes that move; the formula is that of modes that RK4 resolves.
        if h * h * moving.sum() > MODE_STEP**2 * 0.5 * np.sum(forces[:2] * answers[:2]):
            return np.zeros(len(self._trees))
        taken: FloatArray = self._trees @ (h**6 / 144.0 * (moving + forces[2] * answers[2]))
        return taken


def by_subsystem(of_trees: FloatArray) -> FloatArray:
    """Values of (total, robot, objects), (..., NUMBERS, 3), from those by tree, (..., number of trees, NUMBERS)."""
    robot, objects = of_trees[..., 0, :], of_trees[..., 1:, :].sum(axis=-2)
    return np.stack((robot + objects, robot, objects), axis=-1)
