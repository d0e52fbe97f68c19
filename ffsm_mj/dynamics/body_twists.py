"""Twists of bodies and of pairs of bodies, their accelerations at zero joint accelerations, and Jacobians of those of pairs.

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


class PairTwist(NamedTuple):
    """Motion of body b relative to body a at one state: that of the material points that pass the centre of b.

    Attributes:
        b: Twist of body b.
        a: Twist of body a.
        offset: Position of the centre of b from the one of a, m.
        omega: Relative angular velocity, rad/s.
        velocity: Relative velocity, m/s.
        alpha: Angular part of the relative spatial acceleration at zero joint accelerations, rad/s^2.
        acceleration: Its linear part, m/s^2.
    """

    b: BodyTwist
    a: BodyTwist
    offset: Vector
    omega: Vector
    velocity: Vector
    alpha: Vector
    acceleration: Vector

    @classmethod
    def of(cls, b: BodyTwist, a: BodyTwist) -> PairTwist:
        """Relate two bodies."""
        (i, j, k), (p, q, r), (u, v, w), (e, f, g), (x, y, z) = b
        (ai, aj, ak), (ap, aq, ar), (au, av, aw), (ae, af, ag), (ax, ay, az) = a
        i, j, k = i - ai, j - aj, k - ak
        return cls(
            b,
            a,
            (i, j, k),
            (p - ap, q - aq, r - ar),
            (u - au - aq * k + ar * j, v - av - ar * i + ap * k, w - aw - ap * j + aq * i),
            (e - ae, f - af, g - ag),
            (x - ax - af * k + ag * j, y - ay - ag * i + ae * k, z - az - ae * j + af * i),
        )

    def at_centre_of_b(self, of_a: bool) -> tuple[Vector, Vector]:
        """Angular velocity of body a or of body b, and its velocity at the centre of b."""
        if not of_a:
            return self.b.omega, self.b.velocity
        (p, q, r), (u, v, w), (i, j, k) = self.a.omega, self.a.velocity, self.offset
        return self.a.omega, (u + q * k - r * j, v + r * i - p * k, w + p * j - q * i)


class PairTwistRows:
    """Jacobians of the twists of some pairs of bodies, b relative to a.

    A pair has six rows: the relative angular velocity, and the relative velocity at the centre of b. Rows of velocities at
    points of the pair are combinations of these.
    """

    def __init__(self, model: Any, data: Any, pairs: Sequence[tuple[int, int]], out: FloatArray) -> None:
        """Bind to ``data`` and to the array for the rows, (6 p, nv); pairs are bodies (b, a)."""
        self._model, self._data = model, data
        self._of_a: FloatArray = np.empty((6, model.nv))
        self._angular, self._linear = self._of_a[:3], self._of_a[3:]
        self._pairs = [
            (rows, rows[:3], rows[3:], data.subtree_com[int(model.body_rootid[b])], b, a)
            for rows, (b, a) in zip(out.reshape(len(pairs), 6, model.nv), pairs, strict=True)
        ]

    def write(self) -> None:
        """Write the rows at the current state."""
        model, data = self._model, self._data
        for rows, angular, linear, centre, b, a in self._pairs:
            mujoco.mj_jac(model, data, linear, angular, centre, b)
            mujoco.mj_jac(model, data, self._linear, self._angular, centre, a)
            np.subtract(rows, self._of_a, out=rows)


def chain(model: Any, body: int) -> FloatArray:
    """Which degrees of freedom move a body, 0 or 1, (nv,)."""
    moves = np.zeros(model.nv)
    while body > 0:
        start = int(model.body_dofadr[body])
        if start >= 0:
            moves[start : start + int(model.body_dofnum[body])] = 1.0
        body = int(model.body_parentid[body])
    return moves
