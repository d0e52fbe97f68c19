"""Impacts of known (mu, e): an ellipse in the plane and a block in space, thrown onto a floor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ffsm_mj.identification.fit import predicted
from ffsm_mj.identification.impacts import MeasuredImpacts

MASS_KG, GYRATION_M, AXES_M = 0.0364, 0.0192, (0.035, 0.025)
MU, E = 0.18, 0.59


def ellipses(k: int, seed: int = 0, mu: float = MU, e: float = E, noise: float = 0.0) -> MeasuredImpacts:
    """Impacts of an ellipse, coordinates (x, y, angle), on a floor y = 0.

    Args:
        k: How many.
        seed: Of orientations, velocities and noise.
        mu: Coefficient of friction.
        e: Coefficient of restitution.
        noise: Standard deviation of the measured velocities after, per speed before in the energy norm.
    """
    random = np.random.default_rng(seed)
    angles = random.uniform(0.0, np.pi, k)
    axes = np.stack([np.cos(angles), np.sin(angles)], axis=-1), np.stack([-np.sin(angles), np.cos(angles)], axis=-1)
    # Lowest point of an ellipse with semi-axes s_i a_i: -sum s_i^2 (a_i . y) a_i / h, and h its distance below the centre.
    h = np.sqrt(sum((s * a[:, 1]) ** 2 for s, a in zip(AXES_M, axes, strict=True)))
    c = -sum(s**2 * a[:, 0] * a[:, 1] for s, a in zip(AXES_M, axes, strict=True)) / h
    ones, zeros = np.ones(k), np.zeros(k)
    normal = np.stack([zeros, ones, c], axis=-1)
    before = np.stack([random.uniform(-1, 1, k), random.uniform(-2, -1, k), random.uniform(-20, 20, k)], axis=-1)
    M = np.diag([MASS_KG, MASS_KG, MASS_KG * GYRATION_M**2])
    rows = np.stack([ones, zeros, h], axis=-1)[:, None]
    return _after(MeasuredImpacts(M, normal, rows, before, before, (2,)), random, mu, e, noise)


def blocks(k: int, seed: int = 0, mu: float = MU, e: float = E) -> MeasuredImpacts:
    """Impacts of a block in space, coordinates (x, y, z, rates about world axes), on a floor z = 0, at points below it."""
    random = np.random.default_rng(seed)
    arm = random.uniform(-0.02, 0.02, (k, 3)) - (0.0, 0.0, 0.04)
    rows = np.concatenate([np.broadcast_to(np.eye(3), (k, 3, 3)), np.cross(arm[:, None], np.eye(3))], axis=2)
    before = random.uniform(-1, 1, (k, 6)) * (1, 1, 0, 5, 5, 5) - (0, 0, 1.5, 0, 0, 0)
    M = np.diag([0.3, 0.3, 0.3, 2e-4, 3e-4, 4e-4])
    return _after(MeasuredImpacts(M, rows[:, 2], rows[:, :2], before, before, (3, 4, 5)), random, mu, e, 0.0)


def _after(impacts: MeasuredImpacts, random: np.random.Generator, mu: float, e: float, noise: float) -> MeasuredImpacts:
    """The impacts that approach, with the velocities after them by Stronge's law, and noise on these."""
    impacts = impacts.select(np.einsum("ki,ki->k", impacts.normal, impacts.before) < 0.0)
    after = predicted(impacts, "stronge", mu, e)
    scatter = noise * impacts.speeds[:, None] * random.standard_normal(after.shape)
    weighted = np.linalg.solve(impacts.L.transpose(0, 2, 1), scatter[..., None])[..., 0]
    return replace(impacts, after=after + weighted)
