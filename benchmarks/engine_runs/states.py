"""States that every adapter returns, and momenta and energy of them, computed alike for all engines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine_runs.scene import Scene


@dataclass(frozen=True)
class States:
    """States of all bodies at one time, rows in the order of the scene.

    Position (n, 3) of the centres of mass, orientation (n, 4) wxyz, velocity and angular velocity (n, 3), in the world.
    """

    position: np.ndarray
    orientation: np.ndarray
    velocity: np.ndarray
    rate: np.ndarray


def rotation(quaternion: np.ndarray) -> np.ndarray:
    """Matrices (n, 3, 3) of quaternions (n, 4) wxyz."""
    w, x, y, z = (quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


@dataclass(frozen=True)
class Totals:
    """P in N s, L about the origin in N m s and T in J of the whole scene."""

    P: np.ndarray
    L: np.ndarray
    T: float


def totals(scene: Scene, states: States) -> Totals:
    """Sums over the bodies."""
    mass = np.array([body.mass_kg for body in scene.bodies])[:, None]
    R = rotation(states.orientation)
    inertia = R * np.array([body.inertia_kg_m2 for body in scene.bodies])[:, None, :] @ np.swapaxes(R, 1, 2)
    spin = np.einsum("nij,nj->ni", inertia, states.rate)
    L = (np.cross(states.position, mass * states.velocity) + spin).sum(axis=0)
    T = 0.5 * float((mass * states.velocity**2).sum() + (spin * states.rate).sum())
    return Totals((mass * states.velocity).sum(axis=0), L, T)
