"""How far forces of contact points are inside their own friction cones."""

from __future__ import annotations

import math

from ffsm_mj.arrays import FloatArray

ON_CONE = 1e-13
"""Rounding of the margin to a friction cone, as a share of the largest force."""


def depth(forces: FloatArray, mu: FloatArray) -> float:
    """Least of mu lam_n - |lam_t| of some points, N."""
    each = zip(mu.tolist(), forces.tolist(), strict=True)  # plain floats: of few numbers, these are faster than arrays
    return float(min([limit * normal - math.hypot(*across) for limit, (normal, *across) in each]))


def own_margin(forces: FloatArray, mu: FloatArray, inverse_mass: FloatArray, rounding: FloatArray, largest: float) -> float:
    """Least margin of sticking points to their own friction cones as an acceleration, m/s^2; negative outside.

    Args:
        forces: Forces (n, t1, t2) of the m points, N, (m, 3).
        mu: Coefficients of friction, (m,).
        inverse_mass: Inverse masses along the normals, 1/kg, (m,).
        rounding: Rounding of the accelerations, m/s^2, (m,).
        largest: Largest component of the forces of all points, N.
    """
    inertia, allowed = in_accelerations(inverse_mass, rounding, largest)
    return depth(forces, mu) * inertia + allowed


def in_accelerations(inverse_mass: FloatArray, rounding: FloatArray, largest: float) -> tuple[float, float]:
    """Factor from margins of forces to margins of accelerations, 1/kg, and rounding of the latter, m/s^2."""
    masses: list[float] = inverse_mass.tolist()
    inertia = sum(masses) / len(masses)
    return inertia, ON_CONE * (largest * inertia + max(rounding.tolist()))
