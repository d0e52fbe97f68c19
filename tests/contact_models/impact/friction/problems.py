"""Random impacts of several contacts with friction, in three families."""

from __future__ import annotations

import numpy as np

from ffsm_mj.contact_models.impact.friction.coulomb import CoulombProblem, coulomb
from ffsm_mj.dynamics.rigid_body import tangents
from ffsm_mj.tolerances import SOLVED


def problem(rng, family):
    """A, w, mu and e of 2 to 6 contacts; family 0: full rank, 1: more rows than velocities, 2: one or two free bodies."""
    count = int(rng.integers(2, 7))
    if family == 2:
        A, n = bodies(rng, count)
    else:
        n = 3 * count + int(rng.integers(0, 4)) if family == 0 else int(rng.integers(2, 3 * count))
        A = rng.normal(size=(3 * count, n))
    mu = rng.uniform(0, 1.5, count) * (rng.uniform(size=count) > 0.15)
    if not mu.any():
        mu[0] = 0.5
    kind = rng.integers(9)
    e = rng.uniform(0, 1, count)
    if kind < 3:
        e = (np.ones(count), np.zeros(count), np.full(count, e[0]))[kind]
    return A, rng.normal(size=n), mu, e


def bodies(rng, count):
    """Rows of one free body against the world, or of two bodies, with random points and normals."""
    n = 6 * int(rng.integers(1, 3))
    rows = []
    for _ in range(count):
        normal, point = rng.normal(size=3), rng.normal(size=(2, 3))
        normal /= np.linalg.norm(normal)
        frame = np.vstack((normal, tangents(normal)))
        blocks = [np.hstack((frame, np.cross(point[0], frame)))]
        if n == 12:
            blocks.append(-np.hstack((frame, np.cross(point[1], frame))))
        rows.append(np.hstack(blocks))
    scale = np.concatenate(
        [np.concatenate((np.full(3, m), rng.uniform(0.2, 1.0, 3))) for m in rng.uniform(0.5, 2.0, n // 6)]
    )
    return np.concatenate(rows) / np.sqrt(scale), n


def newton_with_friction(A, w, mu, e):
    """Velocity after, (n,), with u_n+ + e u_n- in place of u_n+; None if no solution is found."""
    u = A @ w
    shifted = u.copy()
    shifted[::3] *= 1.0 + np.asarray(e)
    contacts = CoulombProblem(A @ A.T, shifted, np.atleast_1d(mu), np.zeros(len(A) // 3), float(np.abs(u).max()))
    impulses, residual = coulomb(contacts)
    return w + A.T @ impulses.ravel() if residual <= SOLVED else None


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


def energy(w):
    return 0.5 * float(w @ w)
