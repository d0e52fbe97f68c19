"""Velocity and acceleration of material points along an axis: affine functions of the arm.

With the arm r of a material point from the mass centre of its body's tree, its velocity is v + omega x r; along an axis n

    n . (v + omega x r) = n . v + r . (n x omega)
    n . (a + alpha x r + omega x (v + omega x r)) = n . a + (n x omega) . v + r . (n x alpha + (n x omega) x omega)

are affine in r. The arm from the centre of the other body's tree differs by the offset of the centres.
"""

from __future__ import annotations

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.body_motion import Vector, cross, dot
from ffsm_mj.dynamics.body_twists import BodyTwist

Affine = tuple[float, Vector]
"""Constant and gradient of an affine function of the arm of a point."""

_STILL = (0.0, 0.0, 0.0)


def velocity_along(axis: Vector, body: BodyTwist) -> Affine:
    """Velocity of material points along an axis."""
    return dot(axis, body.velocity), cross(axis, body.omega)


def acceleration_along(axis: Vector, body: BodyTwist, turning: Vector = _STILL) -> Affine:
    """Acceleration of material points along an axis at qacc = 0, with their velocity along another vector added."""
    (x, y, z), (p, q, r), (i, j, k) = axis, body.omega, body.alpha
    a, b, c = turning
    u, v, w = a + y * r - z * q, b + z * p - x * r, c + x * q - y * p
    gradient = y * k - z * j + v * r - w * q, z * i - x * k + w * p - u * r, x * j - y * i + u * q - v * p
    (d, e, f), (g, h, m) = body.acceleration, body.velocity
    return x * d + y * e + z * f + u * g + v * h + w * m, gradient


def spatial_acceleration_along(axis: Vector, body: BodyTwist) -> Affine:
    """Rate of the velocity along an axis, at qacc = 0, of those material points that pass a place fixed in space."""
    return dot(axis, body.acceleration), cross(axis, body.alpha)


def turning_matrix(omega: Vector) -> FloatArray:
    """Matrix K with r K = omega x r for row vectors r, (3, 3)."""
    x, y, z = omega
    return np.array(((0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0)))
