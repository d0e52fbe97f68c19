"""Random impacts of several contacts with friction, in three families."""

from __future__ import annotations

import numpy as np

from ffsm_mj.contact_models.impact.friction import tangents


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
