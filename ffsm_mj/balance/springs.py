"""Elastic energy, damper heat and truncation of springs of joints and tendons, by tree, over (sub-)steps.

Springs and dampers act between links of one tree, so they exchange no momentum with anything else. The elastic energy
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
from ffsm_mj.balance.quadrature import hermite_midpoint
from ffsm_mj.dynamics.loops.equalities import ConstrainedModel
from ffsm_mj.dynamics.springs import JointSprings
from ffsm_mj.model.system import System
from ffsm_mj.tolerances import MODE_STEP

_HINGE, _SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)


class SpringBalance:
    """Enters the springs and dampers of each tree over each (sub-)step.

    Attributes:
        grasped: Index of the tree of a grasped object, whose truncation is the robot's as its energy is; 0 for none.
    """

    SIZE = 3
    """Values per tree: elastic energy, heat of dampers, and energy that the truncation of RK4 takes from the modes, J."""

    def __init__(self, system: System, data: Any, springs: JointSprings, accounts: FloatArray) -> None:
        """Bind to the joints of the trees.

        Args:
            system: Robot and objects.
            data: Their state.
            springs: Springs and dampers of their joints.
            accounts: Values by tree, (number of trees, SIZE).
        """
        self._model, self._data, self._springs, self._accounts = system.mj, data, springs, accounts
        self.grasped = 0
        self._trees = np.zeros((len(system.trees), system.mj.nv))
        for row, tree in zip(self._trees, system.trees, strict=True):
            row[tree.dofs] = 1.0
        self._forces, self._answers = np.zeros((3, system.mj.nv)), np.zeros((3, system.mj.nv))
        self._constrained = ConstrainedModel(system.mj)
        # Coordinates of hinges and slides; rates of other joints are no differences of coordinates.
        scalar = np.isin(system.mj.jnt_type, (_HINGE, _SLIDE))
        self._places, self._dofs = system.mj.jnt_qposadr[scalar], system.mj.jnt_dofadr[scalar]
        self._tendons = springs.tendons
        self._of_tendons = self._trees[:, self._tendons.dofs]
        self.open()

    def set_elastic(self) -> None:
        """Set the elastic energy to that of the state in ``data``."""
        self._accounts[:, 0] = self._elastic_now()

    def _elastic_now(self) -> FloatArray:
        """Elastic energy at the state in ``data``, J, by tree."""
        energy = self._trees.dot(self._springs.energy(self._data.qpos))
        if self._tendons.elastic:
            energy += self._of_tendons.dot(self._tendons.energy(self._data))
        return np.asarray(energy)

    def open(self) -> None:
        """Begin a (sub-)step at the state in ``data``."""
        self._qpos, self._qvel = self._data.qpos.copy(), self._data.qvel.copy()
        self._elastic = self._springs.energy(self._qpos)
        if len(self._tendons.ids):
            tendons, data = self._tendons, self._data
            self._before = tendons.lengths(data), tendons.rates(data), tendons.energy(data)

    def close(self, duration_s: float) -> None:
        """End the step at the state in ``data``, derived quantities current."""
        springs, accounts = self._springs, self._accounts
        if springs.elastic:
            truncation = self._truncation(duration_s)
            if self.grasped:
                truncation[0], truncation[self.grasped] = truncation[0] + truncation[self.grasped], 0.0
            accounts[:, 0] += self._trees.dot(springs.energy(self._data.qpos) - self._elastic)
            accounts[:, 2] += truncation
        if springs.damped:
            accounts[:, 1] += self._trees.dot(self._heat(duration_s))
        if len(self._tendons.ids):
            accounts[:, 0] += self._of_tendons.dot(self._tendons.energy(self._data) - self._before[2])
            accounts[:, 1] += self._of_tendons.dot(self._heat_of_tendons(duration_s))

    def _heat(self, duration_s: float) -> FloatArray:
        """Heat of dampers by degree of freedom, J, (nv,)."""
        qpos, qvel, power = self._data.qpos, self._data.qvel, self._springs.dissipation
        if self._springs.damped_balls:
            _, middle = hermite_midpoint(self._model, self._qpos, self._qvel, qpos, qvel, duration_s)
        else:
            middle = -0.25 * (self._qvel + qvel)
            middle[self._dofs] += 1.5 / duration_s * (qpos[self._places] - self._qpos[self._places])
        return duration_s / 6.0 * (power(self._qvel) + 4.0 * power(middle) + power(qvel))

    def _heat_of_tendons(self, duration_s: float) -> FloatArray:
        """Heat of dampers by tendon, J, (n,): a length is a coordinate as that of a slide is."""
        (length, rate, _), power = self._before, self._tendons.dissipation
        end, end_rate = self._tendons.lengths(self._data), self._tendons.rates(self._data)
        middle = 1.5 / duration_s * (end - length) - 0.25 * (rate + end_rate)
        return np.asarray(duration_s / 6.0 * (power(rate) + 4.0 * power(middle) + power(end_rate)))

    def _truncation(self, duration_s: float) -> FloatArray:
        """Energy that RK4 takes from the modes in the step, J, by tree; zero where they are too fast for its step."""
        K, v, h = self._springs.stiffness(self._data.qpos), self._data.qvel, duration_s
        forces, answers = self._forces, self._answers
        np.multiply(K, self._qvel, forces[0])
        np.multiply(K, v, forces[1])
        if self._tendons.elastic:
            rows, along = self._tendons.rows(self._data), self._tendons.stiffness(self._data)
            forces[0] += (along * (rows @ self._qvel)) @ rows
            forces[1] += (along * (rows @ v)) @ rows
        np.subtract(forces[1], forces[0], forces[2])
        forces[2] /= h
        self._constrained.respond(self._data, forces, answers)
        first, second, third = forces * answers
        moving = 0.5 * K * (answers[0] * answers[0] + answers[1] * answers[1])
        stretched = np.zeros(len(self._tendons.ids))
        if self._tendons.elastic:
            stretched = 0.5 * along * ((rows @ answers[0]) ** 2 + (rows @ answers[1]) ** 2)
        # The mean of w^2 over the modes that move; the formula is that of modes that RK4 resolves.
        if h * h * (moving.sum() + stretched.sum()) > MODE_STEP**2 * 0.5 * (first.sum() + second.sum()):
            return np.zeros(len(self._trees))
        truncation: FloatArray = self._trees.dot(h**6 / 144.0 * (moving + third))
        truncation += self._of_tendons.dot(h**6 / 144.0 * stretched)
        return truncation
