"""Energies, momenta and their residuals by subsystem: total, robot and objects."""

from __future__ import annotations

import numpy as np

from ffsm_mj.arrays import FloatArray


def subsystem_energies(powers: FloatArray, robot: slice) -> FloatArray:
    """Kinetic energies of (total, robot, objects), J, (n, 3).

    Args:
        powers: Generalised momentum times rate by dof, (n, nv).
        robot: Degrees of freedom of the robot.
    """
    total, own = 0.5 * powers.sum(axis=1), 0.5 * powers[:, robot].sum(axis=1)
    return np.stack((total, own, total - own), axis=1)


def subsystem_momenta(robot: FloatArray, objects: FloatArray) -> FloatArray:
    """Momenta of (total, robot, objects) from those of robot and objects, (n, 6) each; (n, 3, 6)."""
    return np.stack((robot + objects, robot, objects), axis=1)


def energy_balance_residual(subsystem: str, energy: FloatArray, work: FloatArray, gained: FloatArray) -> FloatArray:
    """Energy of a subsystem less the work of the actuators, which act on the robot, and other energy gained, J, (n,).

    Args:
        subsystem: ``total``, ``robot`` or ``objects``.
        energy: Kinetic energy of the subsystem, J, (n,).
        work: Work of the actuators, J, (n,).
        gained: Energy gained by the subsystem in impacts and contacts and from gravity, J, (n,).
    """
    return (energy if subsystem == "objects" else energy - work) - gained


def momentum_balance_residual(
    subsystem: str, momentum: FloatArray, external: FloatArray, contact: FloatArray, outside: FloatArray, free: FloatArray
) -> FloatArray:
    """Momentum (P, L about the origin) of a subsystem less impulses, N s and N m s, (n, 6); zero on constrained components.

    Args:
        subsystem: ``total``, ``robot`` or ``objects``.
        momentum: Momentum of the subsystem, (n, 6).
        external: External impulse of base actuators on the robot, (n, 6).
        contact: Impulse of the robot on the objects, the opposite of that on the robot, (n, 6).
        outside: Impulse of fixed bodies and of gravity on robot and objects, (n, 12).
        free: 1 for each component that the subsystem's base joints leave free, else 0, (6,).
    """
    on_robot, on_objects = outside[:, :6], outside[:, 6:]
    explained = {
        "total": external + on_robot + on_objects,
        "robot": external - contact + on_robot,
        "objects": contact + on_objects,
    }[subsystem]
    return np.asarray((momentum - explained) * free)
