"""Velocities along an axis, and their rates: affine functions of the arm.

With the arm r from the centre of a twist (omega, v), of a body or of one relative to another, velocities along an axis n

    n . (v + omega x r) = n . v + r . (n x omega)

and their rates at points that move with another twist (omega_p, v_p), for the spatial acceleration (alpha, a),

    n . (a + alpha x r + omega x (v_p + omega_p x r)) = n . a + (n x omega) . v_p + r . (n x alpha + (n x omega) x omega_p)

are affine in r. Products are written out: calls cost more than they.
"""

from __future__ import annotations

from ffsm_mj.contact.features.body_motion import Vector
from ffsm_mj.dynamics.body_twists import BodyTwist, PairTwist

Affine = tuple[float, Vector]
"""Constant and gradient of an affine function of the arm of a point."""


def velocity_along(axis: Vector, twist: BodyTwist | PairTwist) -> Affine:
    """Velocity along an axis."""
    (x, y, z), (p, q, r), (u, v, w) = axis, twist.omega, twist.velocity
    return x * u + y * v + z * w, (y * r - z * q, z * p - x * r, x * q - y * p)


def acceleration_along(axis: Vector, twist: BodyTwist | PairTwist, omega: Vector, velocity: Vector) -> Affine:
    """Rate of the velocity along an axis at qacc = 0, at points with another twist about the same centre."""
    (x, y, z), (i, j, k), (a, b, c) = axis, twist.alpha, twist.acceleration
    (p, q, r), (d, e, f), (u, v, w) = twist.omega, omega, velocity
    g, m, n = y * r - z * q, z * p - x * r, x * q - y * p
    gradient = y * k - z * j + m * f - n * e, z * i - x * k + n * d - g * f, x * j - y * i + g * e - m * d
    return x * a + y * b + z * c + g * u + m * v + n * w, gradient
