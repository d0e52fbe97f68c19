"""Acceleration of material points along an axis: an affine function of the arm.

With the arm r of a material point from the mass centre of its body's tree, its velocity is v + omega x r; along an axis n

    n . (a + alpha x r + omega x (v + omega x r)) = n . a + (n x omega) . v + r . (n x alpha + (n x omega) x omega)

is affine in r.
"""

from __future__ import annotations

from ffsm_mj.contact.features.body_motion import Vector, cross, dot, shifted
from ffsm_mj.dynamics.body_twists import BodyTwist

Affine = tuple[float, Vector]
"""Constant and gradient of an affine function of the arm of a point."""


def acceleration_along(axis: Vector, body: BodyTwist) -> Affine:
    """Acceleration of material points along an axis at qacc = 0."""
    across = cross(axis, body.omega)
    gradient = shifted(cross(axis, body.alpha), 1.0, cross(across, body.omega))
    return dot(axis, body.acceleration) + dot(across, body.velocity), gradient
