"""Prisms of terrain: exact heights, the volume under the surface, and planes that neighbours share bit for bit."""

from __future__ import annotations

import numpy as np
import pytest

from ffsm_mj.decomposition.terrain import height_prisms, mesh_prisms

SIZE = np.array([1.3, 0.9, 0.2])


def heights_at(prisms, place):
    """Highest point of each prism above a place, for those that reach there, m."""
    found = []
    for prism in prisms:
        upright = np.abs(prism.normals[:, 2]) < 1e-12
        reach = prism.normals[:, :2] @ place - prism.offsets
        if reach[upright].max() <= 1e-12:
            normal, offset = prism.normals[0], prism.offsets[0]
            found.append((offset - normal[:2] @ place) / normal[2])
    return found


def planes(prisms):
    """All planes, in either sense, as exact numbers."""
    return [(tuple(n), d) for p in prisms for n, d in zip(p.normals.tolist(), p.offsets.tolist(), strict=True)]


def random_heights(seed, rows=5, columns=7):
    return np.random.default_rng(seed).uniform(0.0, 0.5, (rows, columns))


@pytest.mark.parametrize("seed", range(3))
def test_prisms_have_the_heights_of_the_grid_and_of_the_triangles_between(seed):
    """Bilinear along edges, linear in the triangles by the diagonal from (row, column) to (row + 1, column + 1)."""
    heights = random_heights(seed)
    rows, columns = heights.shape
    prisms = height_prisms(heights, SIZE)
    rng = np.random.default_rng(seed)
    for _ in range(60):
        row, column = rng.integers(rows - 1), rng.integers(columns - 1)
        u, v = rng.uniform(0.0, 1.0, 2) if rng.uniform() < 0.7 else rng.integers(0, 2, 2)
        corner = heights[row : row + 2, column : column + 2]
        low = corner[0, 0] + u * (corner[0, 1] - corner[0, 0]) + v * (corner[1, 1] - corner[0, 1])
        high = corner[0, 0] + u * (corner[1, 1] - corner[1, 0]) + v * (corner[1, 0] - corner[0, 0])
        place = SIZE[:2] * (2.0 * np.array([column + u, row + v]) / (columns - 1, rows - 1) - 1.0)
        # Rounding of some operations on numbers of 1.
        found = heights_at(prisms, place)
        assert found
        assert found == pytest.approx([low if u >= v else high] * len(found), abs=1e-14)


@pytest.mark.parametrize("seed", range(3))
def test_prisms_fill_the_field_and_every_plane_has_its_corners(seed):
    """The volume of a triangle is its area times the mean height over the bottom."""
    heights = random_heights(seed)
    heights[1:4, 2:5] = 0.25  # a plateau of four cells is one prism
    prisms = height_prisms(heights, SIZE)
    assert len(prisms) == 2 * (24 - 4) + 1
    cell = 4.0 * SIZE[0] * SIZE[1] / 24
    a, b, c, d = heights[:-1, :-1], heights[:-1, 1:], heights[1:, :-1], heights[1:, 1:]
    volume = cell * ((2 * a + b + c + 2 * d) / 6 + SIZE[2]).sum()
    assert sum(prism.volume for prism in prisms) == pytest.approx(volume, rel=1e-14)
    for prism in prisms:
        levels = prism.normals @ prism.vertices.T - prism.offsets[:, None]
        assert levels.max() <= 1e-15 * 4
        for k, face in enumerate(prism.faces):
            assert np.abs(levels[k, list(face)]).max() <= 1e-15 * 4


def test_every_inner_side_is_the_side_of_a_neighbour_in_the_other_sense():
    prisms = height_prisms(random_heights(3), SIZE)
    present = set(planes(prisms))
    opposite = {(tuple(-x for x in n), -d) for n, d in present}
    outer = {(-1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 1.0, 0.0)}
    for prism in prisms:
        for n, d in zip(prism.normals[2:].tolist(), prism.offsets[2:].tolist(), strict=True):
            plane = (tuple(n), d)
            assert plane in opposite or (plane[0] in outer and d in SIZE[:2])


def test_a_flat_field_is_one_prism_and_a_slope_one_plane():
    flat = height_prisms(np.full((40, 30), 0.3), SIZE)
    assert len(flat) == 1
    assert planes(flat)[0] == ((0.0, 0.0, 1.0), 0.3)
    x = np.linspace(-1.3, 1.3, 30)
    slope = 0.1 * (x + 1.3) + np.linspace(0.0, 0.2, 40)[:, None]
    slope[20, 20] += 1e-6  # a bump parts the surface in several prisms
    tops = [plane for plane in planes(height_prisms(slope, SIZE)) if plane[0][2] > 0.0]
    assert len(tops) > 6
    assert len(set(tops)) == 7  # the slope and six triangles at the bump


def roof(rows=4, columns=6):
    """An open mesh, turned out of all axes: its points over the unit grid, and the turn."""
    rng = np.random.default_rng(5)
    heights = 0.2 * rng.uniform(size=(rows, columns))
    heights[:, 3:] = 0.1
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    points = np.stack((x, y, heights), axis=2).reshape(-1, 3)
    cells = [(r * columns + c) for r in range(rows - 1) for c in range(columns - 1)]
    faces = [t for i in cells for t in ((i, i + 1, i + columns), (i + 1, i + columns + 1, i + columns))]
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    return points, np.array(faces), turn


def test_prisms_of_a_mesh_are_as_deep_as_stated_along_its_mean_normal():
    """Their volume is the area across the mean normal times the depth, by the sum of the area vectors."""
    points, faces, turn = roof()
    points = points @ turn.T
    prisms = mesh_prisms(points, faces, 0.5)
    total = 0.5 * np.cross(points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]]).sum(axis=0)
    assert sum(prism.volume for prism in prisms) == pytest.approx(0.5 * np.linalg.norm(total), rel=1e-14)
    for prism, face in zip(prisms, faces, strict=True):
        assert np.array_equal(prism.vertices[:3], points[face])
        assert (prism.normals @ prism.vertices.T - prism.offsets[:, None]).max() <= 1e-14


def test_triangles_of_a_mesh_in_one_plane_have_the_same_top():
    points, faces, turn = roof()
    prisms = mesh_prisms(points @ turn.T, faces, 0.5)
    level = (points[faces][:, :, 0].min(axis=1) >= 3.0).nonzero()[0]
    assert len(level) > 4
    assert len({(tuple(prisms[k].normals[0].tolist()), prisms[k].offsets[0]) for k in level}) == 1
    opposite = {(tuple(-x for x in n), -d) for n, d in planes(prisms)}
    assert sum(plane in opposite for plane in planes(prisms)) == 2 * inner_edges(faces)


def inner_edges(faces):
    """Edges of two triangles."""
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return int((np.unique(edges, axis=0, return_counts=True)[1] == 2).sum())


def test_closed_meshes_and_overhangs_are_refused():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    with pytest.raises(ValueError, match="closed"):
        mesh_prisms(points, faces, 0.1)
    folded = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0.5, 0.05]])
    with pytest.raises(ValueError, match="1 of 2 triangles stand upright or overhang"):
        mesh_prisms(folded, np.array([[0, 1, 2], [1, 0, 3]]), 0.1)
