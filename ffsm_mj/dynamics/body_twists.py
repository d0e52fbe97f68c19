"""Twists of bodies and of pairs of bodies, and their accelerations at zero joint accelerations.

Quantities are those of MuJoCo's spatial vectors: about the mass centre of the body's kinematic tree, in world axes. With the
arm r of a material point from there, its velocity is v + omega x r, and its acceleration at zero joint accelerations is
a + alpha x r + omega x (v + omega x r) (Featherstone, *Rigid Body Dynamics Algorithms*, sec. 2.11). Plain floats are faster
than small arrays.
"""

from __future__ import annotations

from typing import Any, NamedTuple

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


def chain(model: Any, body: int) -> FloatArray:
    """Which degrees of freedom move a body, 0 or 1, (nv,)."""
    moves = np.zeros(model.nv)
    while body > 0:
        start = int(model.body_dofadr[body])
        if start >= 0:
            moves[start : start + int(model.body_dofnum[body])] = 1.0
        body = int(model.body_parentid[body])
    return moves
