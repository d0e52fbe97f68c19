"""Twists of bodies, their accelerations at zero joint accelerations, and Jacobians of relative velocities of two bodies.

Quantities are those of MuJoCo's spatial vectors: about the mass centre of the body's kinematic tree, in world axes. With the
arm r of a material point from there, its velocity is v + omega x r, and its acceleration at zero joint accelerations is
a + alpha x r + omega x (v + omega x r) (Featherstone, *Rigid Body Dynamics Algorithms*, sec. 2.11). Plain floats are faster
than small arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray

Vector = tuple[float, float, float]
_UNIT_MOMENTS = np.cross(np.eye(3), np.eye(3)[:, None]).reshape(3, 9)
"""Moments of an axis at unit arms: axis times this is e_x x axis, e_y x axis, e_z x axis."""


class BodyTwist(NamedTuple):
    """One body at one state.

    Attributes:
        centre: Mass centre of its tree, m.
        omega: Angular velocity, rad/s.
        velocity: Velocity of the material point at the centre, m/s.
        alpha: Angular part of the spatial acceleration at zero joint accelerations, rad/s^2.
        acceleration: Its linear part, m/s^2.
    """

    centre: Vector
    omega: Vector
    velocity: Vector
    alpha: Vector
    acceleration: Vector


class BodyTwists:
    """Evaluates the twists of some bodies of a model."""

    def __init__(self, model: Any, data: Any, bodies: Sequence[int]) -> None:
        """Take views of the arrays of ``data``, which MuJoCo does not move."""
        self._chains = np.array([chain(model, body) for body in bodies]).reshape(len(bodies), model.nv)
        self._screw_rates, self._qvel = data.cdof_dot, data.qvel
        self._moving = [(data.cvel[body], data.subtree_com[int(model.body_rootid[body])]) for body in bodies]

    def at_state(self) -> list[BodyTwist]:
        """Twists at the current state; positions and velocities must be current."""
        rates = (self._chains * self._qvel).dot(self._screw_rates).tolist()
        found = []
        for (cvel, centre), (p, q, r, x, y, z) in zip(self._moving, rates, strict=True):
            a, b, c, u, v, w = cvel.tolist()
            i, j, k = centre.tolist()
            found.append(BodyTwist((i, j, k), (a, b, c), (u, v, w), (p, q, r), (x, y, z)))
        return found


class RelativeScrews:
    """Velocities of one body relative to another per unit rate of each degree of freedom."""

    def __init__(self, model: Any, data: Any, body: int, other: int) -> None:
        """Take views of the arrays of ``data``: velocities of ``body`` relative to ``other``."""
        self._pair = model, data, body, other
        self._others = chain(model, other)
        self._either = chain(model, body) - self._others
        self._angular, self._linear = data.cdof[:, :3].T, data.cdof[:, 3:]

    def reversed(self) -> RelativeScrews:
        """The screws of the other body relative to this one."""
        model, data, body, other = self._pair
        return RelativeScrews(model, data, other, body)

    def rows(self, axis: Vector, arms: FloatArray, offset: Vector) -> FloatArray:
        """Rows of relative velocities along an axis at several points, (m, nv).

        Args:
            axis: Unit vector.
            arms: Positions of the points from the centre of the body's tree, m, (m, 3).
            offset: Position of that centre from the one of the other body, m.
        """
        x, y, z = axis
        i, j, k = offset
        # Moments of the axis: arms x axis about the own centre, and offset x axis more about the other one.
        moments = np.array((0.0, -z, y, z, 0.0, -x, -y, x, 0.0, j * z - k * y, k * x - i * z, i * y - j * x)).reshape(4, 3)
        turned = moments.dot(self._angular)
        rows: FloatArray = arms.dot(turned[:3])
        rows += self._linear.dot(axis)
        rows *= self._either
        rows -= self._others * turned[3]
        return rows

    def rows_along(self, axes: FloatArray, arms: FloatArray, offset: Vector) -> FloatArray:
        """The same along several axes, (n, 3), at once: (m, n, nv)."""
        n, nv = len(axes), self._angular.shape[1]
        # Velocities per unit arm: row 3 i + j is that along axis j by component i of the arm, and the last of the offset.
        moments = axes.dot(_UNIT_MOMENTS).reshape(n, 3, 3).transpose(1, 0, 2).reshape(3 * n, 3)
        turned = moments.dot(self._angular).reshape(3, n * nv)
        rows: FloatArray = arms.dot(turned).reshape(-1, n, nv)
        rows += axes.dot(self._linear.T)
        rows *= self._either
        rows -= self._others * np.dot(offset, turned).reshape(n, nv)
        return rows


class RelativeJacobian:
    """Jacobian of the velocity of one body relative to another at a point."""

    def __init__(self, model: Any, data: Any, body: int, other: int) -> None:
        """Bind to a model: velocities of ``body`` relative to ``other``."""
        self._model, self._data, self._body, self._other, self._qvel = model, data, body, other, data.qvel
        self._own: FloatArray = np.empty((3, model.nv))
        self._others: FloatArray = np.empty((3, model.nv))

    def at(self, point: FloatArray) -> FloatArray:
        """Relative velocity of the two material points at a point per unit rate, (3, nv); valid until the next call."""
        mujoco.mj_jac(self._model, self._data, self._own, None, point, self._body)
        mujoco.mj_jac(self._model, self._data, self._others, None, point, self._other)
        self._own -= self._others
        return self._own

    def acceleration(self, axis: FloatArray, point: FloatArray, other_point: FloatArray) -> float:
        """Relative acceleration along an axis at zero joint accelerations, of a material point of each body, m/s^2."""
        mujoco.mj_jacDot(self._model, self._data, self._own, None, point, self._body)
        mujoco.mj_jacDot(self._model, self._data, self._others, None, other_point, self._other)
        self._own -= self._others
        return float(axis.dot(self._own).dot(self._qvel))


def chain(model: Any, body: int) -> FloatArray:
    """Which degrees of freedom move a body, 0 or 1, (nv,)."""
    moves = np.zeros(model.nv)
    while body > 0:
        start = int(model.body_dofadr[body])
        if start >= 0:
            moves[start : start + int(model.body_dofnum[body])] = 1.0
        body = int(model.body_parentid[body])
    return moves
