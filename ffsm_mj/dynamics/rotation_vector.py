"""Rates of rotation vectors, in which Runge-Kutta methods integrate rotations (Runge-Kutta-Munthe-Kaas)."""

from __future__ import annotations


def rotation_vector_rate(turned: list[float], spin: list[float]) -> tuple[float, float, float]:
    """Rate of the rotation vector t for a body-frame angular velocity w: w + t x w / 2 + t x (t x w) / 12.

    The inverse of the exponential map's differential, truncated after second order: enough for a method of order four.
    """
    a, b, c = turned
    x, y, z = spin
    u, v, w = b * z - c * y, c * x - a * z, a * y - b * x
    twelfth = 1.0 / 12.0
    return (
        x + 0.5 * u + twelfth * (b * w - c * v),
        y + 0.5 * v + twelfth * (c * u - a * w),
        z + 0.5 * w + twelfth * (a * v - b * u),
    )
