"""Contacts with known solutions, as rows of A = J L^-T and a mass-weighted velocity."""

from __future__ import annotations

import numpy as np

SPHERE = np.diag([1.0, 3.5, 3.5])
"""G of a sphere, m = R = 1, I = 2/5."""
GENERAL = np.array([[2.0, 0.9, -0.6], [0.9, 1.5, 0.3], [-0.6, 0.3, 1.2]])
PENDULUM = np.array([[1.0095602905, 1.5213086580, 0.0], [1.5213086580, 2.4403380457, 0.0], [0.0, 0.0, 0.0]])
"""G of a double pendulum of two rods that falls on the floor; the third direction does not move."""


def rod(degrees):
    """G of a rod, m = L = 1, at an angle to the floor; along the third direction it is a mass of 1."""
    return rod_of(np.cos(np.radians(degrees)), np.sin(np.radians(degrees)))


def rod_of(cos, sin):
    return np.array([[1 + 3 * cos**2, -3 * sin * cos, 0.0], [-3 * sin * cos, 1 + 3 * sin**2, 0.0], [0.0, 0.0, 1.0]])


def rows(G, u):
    """Some A and w with A A^T = G and A w = u, w of least norm: T is the kinetic energy of the contact."""
    values, vectors = np.linalg.eigh(np.asarray(G))
    A = vectors * np.sqrt(np.maximum(values, 0.0))
    return A, np.linalg.pinv(A) @ np.asarray(u, dtype=float)


def point_on_body(mass, inertia, points, normals, tangents):
    """Rows (n, t1, t2) per point of one free body, (3k, 6), and the square root of its mass matrix, (6,)."""
    blocks = []
    for r, frame in zip(points, np.concatenate((normals[:, None], tangents), axis=1), strict=True):
        blocks.append(np.hstack((frame, np.cross(r, frame))))
    root = np.sqrt(np.concatenate((np.full(3, mass), inertia)))
    return np.concatenate(blocks) / root, root


FLOOR = np.array([[[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])
"""Normal and tangents of a floor, (1, 3, 3)."""


def on_floor(mass, inertia, points):
    """Contact points of one free body on the floor."""
    points = np.atleast_2d(points)
    frames = np.repeat(FLOOR, len(points), axis=0)
    return point_on_body(mass, inertia, points, frames[:, 0], frames[:, 1:])


def box_inertia(mass, half):
    x, y, z = np.square(half)
    return mass / 3 * np.array([y + z, x + z, x + y])


def energy(w):
    return 0.5 * float(w @ w)
