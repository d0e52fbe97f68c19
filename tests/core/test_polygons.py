"""Polygons across a normal against Qhull: hulls of points, and what two features have in common."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull, HalfspaceIntersection
from scipy.spatial.transform import Rotation

from ffsm_mj._core.polygons import corners_across, hull_indices, opposite, touching_set
from ffsm_mj.tolerances import MERGED_M, STRAIGHT

ROUNDING = 1e-13
"""Coordinates of about 1 m after some ten operations; crossings of sides that meet at 1e-2 rad lose two digits."""


def polygon(rng, count: int) -> np.ndarray:
    """Corners of a convex polygon in a circle of a random radius and centre, (n, 2)."""
    angles = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False) + rng.uniform(0.0, 0.5)
    return rng.uniform(0.4, 1.0) * np.column_stack((np.cos(angles), np.sin(angles))) + rng.uniform(-0.3, 0.3, 2)


def half_planes(corners: np.ndarray) -> np.ndarray:
    return ConvexHull(corners).equations


@pytest.mark.parametrize("count", [3, 5, 40])
def test_corners_of_a_hull_are_those_of_qhull_in_order(rng, count):
    for _ in range(20):
        flat = np.asfortranarray(rng.normal(size=(count, 2)))
        corners = hull_indices(np.concatenate((flat, flat)))  # of equal points the first
        wanted = ConvexHull(flat).vertices.tolist()
        start = wanted.index(corners[0])
        assert corners == wanted[start:] + wanted[:start]
        turn = Rotation.random(rng=rng).as_matrix()
        points = np.column_stack((flat, rng.normal(size=count))) @ turn.T  # heights do not count
        assert set(corners_across(points, turn[:, 2])) == set(wanted)


def test_a_point_within_a_side_and_one_beside_a_corner_are_no_corners():
    square = np.array([[0.0, 0.0], [0.5, 0.0], [1.0, 0.0], [1.0, 1.0], [1.0, 1.0 + 0.4 * MERGED_M], [0.0, 1.0]])
    assert hull_indices(square, merge=MERGED_M, straight=STRAIGHT) == [0, 2, 3, 5]
    assert hull_indices(square[:3], straight=STRAIGHT) == [0, 2]
    assert hull_indices(square[3:5], merge=MERGED_M) == [0]


@pytest.mark.parametrize("sides", [(3, 4), (4, 4), (6, 5)])
def test_what_two_faces_have_in_common_is_the_intersection_of_their_half_planes(rng, sides):
    for _ in range(20):
        one, other = (polygon(rng, count) for count in sides)
        turn = Rotation.random(rng=rng).as_matrix()
        first, second = (np.column_stack((flat, np.full(len(flat), z))) @ turn.T for flat, z in ((one, 0.2), (other, 0.3)))
        found = touching_set(first, second, turn[:, 2]) @ turn
        np.testing.assert_allclose(found[:, 2], 0.25, atol=ROUNDING)
        inside = 0.5 * (found[:, :2].min(axis=0) + found[:, :2].max(axis=0))
        wanted = HalfspaceIntersection(np.vstack((half_planes(one), half_planes(other))), inside).intersections
        apart = np.linalg.norm(found[:, None, :2] - wanted[ConvexHull(wanted).vertices], axis=2)
        assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 100.0 * ROUNDING
        assert opposite(first, second, turn[:, 2])
        assert not opposite(first, second + turn @ [3.0, 0.0, 0.0], turn[:, 2])


@pytest.mark.parametrize("width", [1e-2, 1e-5])
def test_a_strip_has_the_heights_of_its_plane_however_narrow_it_is(width):
    """Its corners are within 1e-9 m of level: rises of 1e-10 m along it and across it are known to rounding."""
    strip = np.array([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]]) * (1.0, width, 1.0)
    floor, strip[:, 2] = strip * 2.0, 1e-10 * (strip[:, 0] + strip[:, 1] / width)
    found = touching_set(strip, floor, np.array([0.0, 0.0, 1.0]))
    apart = np.abs(found[:, None] - strip * (1.0, 1.0, 0.5)).max(axis=2)
    assert apart.shape == (4, 4)
    assert apart.min(axis=0).max() < 1e-15
