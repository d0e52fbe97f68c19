"""Cones of normals by a few plain numbers against non-negative least squares, and cells by their definition."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.optimize import nnls

from ffsm_mj.contact.cells import cells, in_cone, intersection, separating_normals

GRID = [np.array(v) / np.linalg.norm(v) for v in product((-1, 0, 1), repeat=3) if any(v)]
NEAR = 1e-9
X, Y, Z = np.eye(3)


def cone(rng, kind):
    """Up to four rays: of a grid, where many are coplanar or opposite, or around a direction."""
    count = int(rng.integers(1, 5))
    if kind == "grid":
        return np.array([GRID[k] for k in rng.choice(len(GRID), count, replace=False)])
    rays = rng.normal(size=3) + 0.8 * rng.normal(size=(count, 3))
    return rays / np.linalg.norm(rays, axis=1)[:, None]


@pytest.mark.parametrize("kind", ["grid", "round"])
def test_what_is_in_a_cone(rng, kind):
    inside = 0
    for _ in range(400):
        rays = cone(rng, kind)
        share = rng.choice([0.0, 1.0], len(rays)) * rng.uniform(size=len(rays))
        candidates = [cone(rng, kind)[0], rays[0], share @ rays] if share.any() else [rays[0]]
        for vector in candidates:
            if (length := np.linalg.norm(vector)) > 0.1:
                left = nnls(rays.T, vector / length)[1]
                # Between both tolerances rounding decides.
                if not 0.1 * NEAR < left < 10.0 * NEAR:
                    assert in_cone(rays, vector / length) == (left <= NEAR)
                    inside += left <= NEAR
    assert inside > 200


@pytest.mark.parametrize("kind", ["grid", "round"])
def test_the_intersection_of_two_cones(rng, kind):
    """Its rays are in both, and a vector that is in both is a combination of them."""
    shared = 0
    for _ in range(60):
        first, second = cone(rng, kind), cone(rng, kind)
        both = intersection(first, second)
        assert all(nnls(one.T, ray)[1] <= 10.0 * NEAR for ray in both for one in (first, second))
        for _ in range(20):
            vector = rng.uniform(size=len(first)) @ first
            if (length := np.linalg.norm(vector)) > 0.1 and nnls(second.T, vector / length)[1] <= 0.01 * NEAR:
                assert nnls(both.T, vector / length)[1] <= 10.0 * NEAR
                shared += 1
    assert shared > 20


def test_cells_are_the_motions_that_open_all_pieces(rng):
    """A motion is in a cell if and only if each two pieces open along one of the normals that part them."""
    free, stopped = 0, 0
    for _ in range(60):
        of_a = [np.array(rng.permutation([-Z, X, Y])[: rng.integers(1, 4)]) for _ in range(rng.integers(1, 3))]
        of_b = [
            np.array([(Z, sx * X, sy * Y)[k] for k in range(rng.integers(1, 4))]) for sx, sy in ((1, 1), (-1, 1), (1, -1))
        ]
        clauses = [clause for a, b in product(of_a, of_b) if len(clause := separating_normals(a, b))]
        every = cells(clauses)
        for _ in range(20):
            motion = rng.normal(size=3)
            opens = all((clause @ motion > 0.0).any() for clause in clauses)
            assert any((cell @ motion > 0.0).all() for cell in every) == opens
            free, stopped = free + opens, stopped + (not opens)
    assert min(free, stopped) > 100
