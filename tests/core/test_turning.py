"""Flat directions of features, and how the normal of two spheres turns, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from ffsm_mj._core.turning import flat, turning
from ffsm_mj.dynamics.rigid_body import tangents

_SQUARE = np.array([[1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [1.0, -1.0, 0.0]])  # not in order around it
_POINTS = {
    "inside": ([0.2, 0.3, 0.0], [1.0, 1.0]),
    "on a side": ([1.0, 0.3, 0.0], [0.0, 1.0]),
    "corner": ([1, 1, 0], [0, 0]),
}


@pytest.mark.parametrize("where", _POINTS)
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_flat_directions_of_a_square(where, sense):
    """All inside, that of the side on a side, none at a corner: exact but for rounding."""
    point, expected = _POINTS[where]
    axes = tangents(np.array([0.0, 0.0, sense]))
    projector = axes.T @ flat(_SQUARE, np.array(point, dtype=float), axes, 1e-7) @ axes
    np.testing.assert_allclose(projector, np.diag([*expected, 0.0]), atol=1e-14)


def test_the_normal_of_two_spheres_is_that_of_their_centres(rng):
    """It turns as the line between the centres does; numbers of 1 and a matrix with a condition below 1e3: 1e-12."""
    for _ in range(50):
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        axes, across = tangents(normal), np.eye(3) - np.outer(normal, normal)
        np.testing.assert_allclose(axes.T @ axes, across, atol=1e-15 * 8)
        (a, b), gap, none = rng.uniform(0.5, 2.0, 2), rng.uniform(0.0, 0.1), np.zeros((2, 2))
        v_a, omega_a, v_b, omega_b = rng.normal(size=(4, 3))
        found = turning(normal, axes, gap, (v_a, omega_a, none, a * across, 0.0), (v_b, omega_b, none, b * across, 0.0))
        centres = v_b + np.cross(omega_b, b * normal) - v_a - np.cross(omega_a, -a * normal)
        n_dot = across @ centres / (a + b + gap)
        s_a, s_b = a * (n_dot - np.cross(omega_a, normal)), -b * (n_dot - np.cross(omega_b, normal))
        np.testing.assert_allclose(found, [n_dot, s_a, s_b], atol=1e-12)
