"""How far a convex hull stands off its mesh: distances from triangles against closed forms."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_mj import hull
from ffsm_mj.hull import greatest_distance, hull_offset

ROUNDING = 1e-13
"""Distances of 1 m after some ten operations; where a distance is zero, its square is the square of rounding."""
SINGLE = 2e-7
"""MuJoCo keeps vertices of meshes, here within 1 m of their centre, in single precision: 6e-8 each."""
HALF = np.array([0.5, 0.3, 0.2])


def box_triangles(cuts: int) -> np.ndarray:
    """The surface of a box of half sizes ``HALF`` as triangles, each face of ``cuts`` by ``cuts`` cells."""
    grid = np.linspace(-1.0, 1.0, cuts + 1)
    triangles = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (-1.0, 1.0):
            for i in range(cuts):
                for j in range(cuts):
                    corners = np.full((4, 3), side)
                    corners[:, u], corners[:, v] = grid[[i, i + 1, i + 1, i]], grid[[j, j, j + 1, j + 1]]
                    triangles += [corners[[0, 1, 2]], corners[[0, 2, 3]]]
    return np.array(triangles) * HALF


def from_box(points: np.ndarray) -> np.ndarray:
    """Distances of points from the surface of the box, in closed form."""
    excess = np.abs(points) - HALF
    return np.where((excess > 0.0).any(axis=1), np.linalg.norm(np.maximum(excess, 0.0), axis=1), -excess.max(axis=1))


@pytest.mark.parametrize("cuts", [1, 7])
def test_the_greatest_distance_of_points_from_a_box_is_that_of_the_closed_form(cuts):
    rng = np.random.default_rng(3)
    triangles = rng.permutation(box_triangles(cuts))
    for count in (1, 2, 30):
        for scale in (0.3, 1.0, 4.0):
            points = scale * rng.normal(size=(count, 3))
            assert greatest_distance(points, triangles) == pytest.approx(from_box(points).max(), abs=scale * ROUNDING)
    assert greatest_distance(np.zeros((0, 3)), triangles) == 0.0


def test_few_points_are_compared_with_triangles_where_one_is_far(monkeypatch):
    """A mesh of many triangles costs what its most distant points cost: the bounds of all others are below."""
    compared = []
    measured = hull._squared_distance
    monkeypatch.setattr(hull, "_squared_distance", lambda *args: compared.append(len(args[1])) or measured(*args))
    points = 0.01 * np.random.default_rng(5).normal(size=(400, 3)) * HALF + [0.5, 0.0, 0.0]
    points[77] = 2.0, 0.0, 0.0
    assert greatest_distance(points, box_triangles(20)) == pytest.approx(1.5, abs=ROUNDING)
    assert len(compared) == 1


def test_the_hull_of_an_l_stands_off_its_notch():
    """The hull of an L of arms of 1 m, 0.5 m wide, has a facet from tip to tip: its middle is 0.25 m off both walls.

    The samples of a facet of two triangles, at quarters of their edges, have points on that middle line.
    """
    outline = [(0, 0), (1, 0), (1, 0.5), (0.5, 0.5), (0.5, 1), (0, 1)]
    vertices = np.array([(x, y, z) for z in (-0.1, 0.1) for x, y in outline], dtype=float)
    faces = [f for k in range(6) for f in ((k, (k + 1) % 6, k + 6), ((k + 1) % 6, (k + 1) % 6 + 6, k + 6))]
    top = [(0, 1, 3), (1, 2, 3), (0, 3, 5), (3, 4, 5)]
    faces += [(a + 6, b + 6, c + 6) for a, b, c in top] + [(c, b, a) for a, b, c in top]
    spec = mujoco.MjSpec()
    spec.add_mesh(name="l", uservert=vertices.ravel().tolist(), userface=np.array(faces).ravel().tolist())
    spec.worldbody.add_body(name="b").add_geom(name="g", type=mujoco.mjtGeom.mjGEOM_MESH, meshname="l")
    model = spec.compile()
    assert hull_offset(model, model.geom("g").id) == pytest.approx(0.25, abs=SINGLE)
