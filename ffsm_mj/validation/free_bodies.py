"""Articulated systems as free bodies with constraints: plastic impulses in maximal coordinates, apart from MuJoCo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ffsm_mj.arrays import FloatArray


def cross(x: FloatArray) -> FloatArray:
    """Matrix of the vector product with ``x``, (3, 3)."""
    return np.array([[0.0, -x[2], x[1]], [x[2], 0.0, -x[0]], [-x[1], x[0], 0.0]])


def turn(axis: FloatArray, angle: float) -> FloatArray:
    """Rotation matrix about a unit vector (Rodrigues)."""
    K = cross(axis)
    return np.asarray(np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K)


@dataclass(frozen=True)
class FreeBody:
    """A rigid body.

    Attributes:
        mass: Mass, kg.
        inertia: About the mass centre, world axes, kg m^2, (3, 3).
        origin: Of its frame, m, (3,).
        R: Orientation of its frame, (3, 3).
        centre: Mass centre, world, m, (3,).
        velocity: Of the mass centre, and angular velocity, world axes, (6,).
    """

    mass: float
    inertia: FloatArray
    origin: FloatArray
    R: FloatArray
    centre: FloatArray
    velocity: FloatArray


class FreeBodies:
    """Bodies and the rows of their constraints."""

    def __init__(self) -> None:
        self.bodies: list[FreeBody] = []
        self._rows: list[tuple[int, int, FloatArray, FloatArray]] = []

    def add(
        self, mass: float, inertia: FloatArray, origin: FloatArray, centre: FloatArray, velocity: FloatArray | None = None
    ) -> int:
        """A body along the world's axes; ``velocity``: of its origin, and angular, (6,). Returns its number."""
        rates = np.zeros(6) if velocity is None else velocity
        moved = np.concatenate([rates[:3] + np.cross(rates[3:], centre), rates[3:]])
        self.bodies.append(FreeBody(mass, np.diag(inertia), origin, np.eye(3), origin + centre, moved))
        return len(self.bodies) - 1

    def hinge(
        self,
        parent: int,
        at: FloatArray,
        axis: FloatArray,
        angle: float,
        rate: float,
        mass: float,
        inertia: FloatArray,
        centre: FloatArray,
    ) -> int:
        """A link on a hinge, in the frame of its parent, turned by ``angle`` rad at ``rate`` rad/s; returns its number."""
        carrier = self.bodies[parent]
        point, about = carrier.origin + carrier.R @ at, carrier.R @ axis
        R = carrier.R @ turn(axis, angle)
        spin = carrier.velocity[3:] + rate * about
        speed = carrier.velocity[:3] + np.cross(carrier.velocity[3:], point - carrier.centre) + np.cross(spin, R @ centre)
        body = FreeBody(mass, R @ np.diag(inertia) @ R.T, point, R, point + R @ centre, np.concatenate([speed, spin]))
        self.bodies.append(body)
        across = np.linalg.svd(about[None])[2][1:]
        self._rows.append(
            (parent, len(self.bodies) - 1, point, np.vstack([np.eye(3, 6), np.hstack([np.zeros((2, 3)), across])]))
        )
        return len(self.bodies) - 1

    def weld(self, first: int, second: int, point: FloatArray, free: Sequence[int] = ()) -> None:
        """Join two bodies at a point from now on, but for components of the relative twist that stay free."""
        self._rows.append((first, second, point, np.delete(np.eye(6), list(free), axis=0)))

    @property
    def velocities(self) -> FloatArray:
        """Of all bodies before, (n, 6)."""
        return np.array([body.velocity for body in self.bodies])

    def _jacobian(self) -> FloatArray:
        rows = []
        for first, second, point, kept in self._rows:
            J = np.zeros((6, 6 * len(self.bodies)))
            for body, sign in ((first, -1.0), (second, 1.0)):
                J[:3, 6 * body : 6 * body + 3] = sign * np.eye(3)
                J[:3, 6 * body + 3 : 6 * body + 6] = -sign * cross(point - self.bodies[body].centre)
                J[3:, 6 * body + 3 : 6 * body + 6] = sign * np.eye(3)
            rows.append(kept @ J)
        return np.vstack(rows)

    def plastic(self) -> FloatArray:
        """Velocities after the plastic impulse on all constraints, which may depend on each other, (n, 6)."""
        J, before = self._jacobian(), self.velocities.ravel()
        root = np.zeros((before.size, before.size))  # of the inverse mass matrix
        for i, body in enumerate(self.bodies):
            root[6 * i : 6 * i + 3, 6 * i : 6 * i + 3] = np.eye(3) / np.sqrt(body.mass)
            root[6 * i + 3 : 6 * i + 6, 6 * i + 3 : 6 * i + 6] = np.linalg.cholesky(np.linalg.inv(body.inertia))
        A = J @ root
        after = before - root @ np.linalg.pinv(A, rcond=1e-10) @ J @ before
        return np.asarray(after.reshape(-1, 6))

    def loss_J(self) -> float:
        """Kinetic energy that the plastic impulse takes, J."""
        return float((self.energies(self.velocities) - self.energies(self.plastic())).sum())

    def energies(self, velocities: FloatArray) -> FloatArray:
        """Kinetic energy of each body, J, (n,)."""
        return np.array(
            [
                0.5 * body.mass * v[:3] @ v[:3] + 0.5 * v[3:] @ body.inertia @ v[3:]
                for body, v in zip(self.bodies, velocities, strict=True)
            ]
        )
