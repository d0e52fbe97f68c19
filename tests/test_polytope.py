"""Polytopes: planes against vertices, volumes against closed forms, cuts without loss."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ffsm_mj._core.polytopes import normals_at, outward_vectors
from ffsm_mj.polytope import Polytope, box, hull_of

EYE = np.eye(3)
ROUNDING = 1e-14
"""Coordinates of 1 m after some ten operations."""


def faults(polytope: Polytope) -> list[str]:
    """What is wrong with it: vertices off their planes or outside, faces turned inwards, edges without two faces."""
    heights = polytope.vertices @ polytope.normals.T - polytope.offsets
    wrong = []
    if heights.max() > ROUNDING:
        wrong.append("a vertex is outside a plane")
    sides = []
    for k, face in enumerate(polytope.faces):
        corners = polytope.vertices[list(face)]
        if np.abs(heights[list(face), k]).max() > ROUNDING:
            wrong.append("a corner is off its plane")
        turns = np.cross(np.roll(corners, -1, axis=0) - corners, np.roll(corners, -2, axis=0) - np.roll(corners, -1, axis=0))
        if (turns @ polytope.normals[k]).min() < -ROUNDING:
            wrong.append("a polygon does not turn left")
        sides += zip(face, (*face[1:], face[0]), strict=True)
    if len(set(sides)) != len(sides) or {(b, a) for a, b in sides} != set(sides):
        wrong.append("the faces are not closed")
    if len(polytope.vertices) - len(polytope.edges) + len(polytope.faces) != 2:
        wrong.append("Euler's formula")
    return wrong


def random_hull(rng) -> Polytope:
    return hull_of(rng.normal(size=(int(rng.integers(4, 15)), 3)))


def test_box():
    turn = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    solid = box(np.array([0.1, 0.2, 0.3]), np.array([1.0, 2.0, 3.0]), turn)
    assert faults(solid) == []
    assert solid.volume == pytest.approx(0.2 * 0.4 * 0.6, rel=1e-12)
    assert solid.thickness == pytest.approx(0.2, abs=ROUNDING)
    np.testing.assert_array_equal(solid.normals[:3], turn.T)
    np.testing.assert_array_equal(solid.normals[3:], -turn.T)


def test_boxes_side_by_side_have_exact_planes():
    """Sides of boxes along the axes are where their numbers say, and the same in both senses."""
    one = box(np.array([0.5, 0.5, 0.25]), np.array([-0.5, 0.0, -0.25]), EYE)
    other = box(np.array([0.25, 0.5, 0.25]), np.array([0.25, 0.0, -0.25]), EYE)
    assert one.offsets.tolist() == [0.0, 0.5, 0.0, 1.0, 0.5, 0.5]
    assert other.offsets.tolist() == [0.5, 0.5, 0.0, 0.0, 0.5, 0.5]
    np.testing.assert_array_equal(one.bounds, [[-1.0, -0.5, -0.5], [0.0, 0.5, 0.0]])


def test_hull_of_a_box_with_points_within_its_edges_and_sides():
    """Coplanar triangles are one side; points within edges and sides are no vertices; planes along the axes are exact."""
    grid = np.array([[x, y, z] for x in (0.1, 0.2, 0.7) for y in (-0.3, 0.0, 0.3) for z in (1.0, 1.1, 1.3)])
    solid = hull_of(grid)
    assert faults(solid) == []
    assert (len(solid.vertices), len(solid.faces)) == (8, 6)
    planes = {(*normal, offset) for normal, offset in zip(solid.normals.tolist(), solid.offsets.tolist(), strict=True)}
    assert planes == {(1, 0, 0, 0.7), (-1, 0, 0, -0.1), (0, 1, 0, 0.3), (0, -1, 0, 0.3), (0, 0, 1, 1.3), (0, 0, -1, -1.0)}


def test_random_hulls():
    rng = np.random.default_rng(1)
    for _ in range(100):
        assert faults(random_hull(rng)) == []


def test_facets_within_the_tolerance_are_one_face():
    """The top of a box of which one corner is 1e-7 m high: two triangles, or one square with the mean plane."""
    points = box(np.full(3, 0.5), np.zeros(3), EYE).vertices.copy()
    points[7, 2] += 1e-7
    assert len(hull_of(points).faces) > 6
    merged = hull_of(points, merge=1e-6)
    assert len(merged.faces) == 6
    assert np.abs(merged.vertices @ merged.normals.T - merged.offsets).min(axis=0).max() < 1e-7


@pytest.mark.parametrize(
    "points", [np.eye(3), np.eye(4, 3) * [1, 1, 0], np.random.default_rng(1).normal(size=(9, 3)) * [1, 1, 0]]
)
def test_flat_sets_are_refused(points):
    with pytest.raises(ValueError, match="has no volume"):
        hull_of(points)


def test_sets_thinner_than_the_tolerance_are_refused():
    with pytest.raises(ValueError, match="is no thicker than"):
        hull_of(np.random.default_rng(1).normal(size=(9, 3)) * [1, 1, 1e-5], merge=1e-3)


def test_cuts():
    """Both parts are sound, fill the whole, and keep planes and common vertices bit for bit."""
    rng = np.random.default_rng(2)
    both = 0
    for _ in range(200):
        solid = random_hull(rng)
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        through = solid.vertices[rng.integers(len(solid.vertices))] if rng.random() < 0.3 else 0.5 * rng.normal(size=3)
        offset = float(normal @ through)
        below, above = solid.cut(normal, offset)
        parts = [part for part in (below, above) if part]
        assert sum(part.volume for part in parts) == pytest.approx(solid.volume, rel=1e-12)
        for part in parts:
            assert faults(part) == []
            planes = {(*plane, d) for plane, d in zip(part.normals.tolist(), part.offsets.tolist(), strict=True)}
            old = {(*plane, d) for plane, d in zip(solid.normals.tolist(), solid.offsets.tolist(), strict=True)}
            assert planes - old <= {(*normal, offset), (*-normal, -offset)}
        if below and above:
            both += 1
            assert (below.vertices @ normal).max() <= offset + ROUNDING
            assert (above.vertices @ normal).min() >= offset - ROUNDING
            on_cut = [set(map(tuple, part.vertices[list(part.faces[-1])].tolist())) for part in (below, above)]
            assert on_cut[0] == on_cut[1]
    assert both > 100


def test_cuts_along_sides_and_edges():
    """A plane of a side leaves the whole; one through opposite edges of a cube makes two prisms of five sides."""
    cube = box(np.full(3, 0.5), np.zeros(3), EYE)
    assert cube.cut(np.array([1.0, 0.0, 0.0]), 0.5) == (cube, None)
    assert cube.cut(np.array([-1.0, 0.0, 0.0]), -0.5) == (None, cube)
    below, above = cube.cut(np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0), 0.0)
    assert below is not None
    assert above is not None
    assert (len(below.faces), len(above.faces), len(below.vertices)) == (5, 5, 6)
    assert faults(below) == faults(above) == []
    assert below.volume == pytest.approx(0.5, rel=1e-14)


def test_neighbours_are_cut_at_the_same_points():
    """Two pieces with a common face, whatever their order of vertices: the cut of their common edges is bit for bit one."""
    rng = np.random.default_rng(3)
    for _ in range(50):
        one, other = box(np.array([0.3, 0.7, 0.9]), 0.1 * rng.normal(size=3), EYE).cut(np.array([0.6, 0.8, 0.0]), 0.05)
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        parts = [part for piece in (one, other) for part in piece.cut(normal, 0.02) if part]
        distinct = np.unique(np.concatenate([part.vertices for part in parts]), axis=0)
        apart = np.linalg.norm(distinct[:, None] - distinct, axis=2) + np.eye(len(distinct))
        assert apart.min() > 1e-6


def test_moved():
    rng = np.random.default_rng(4)
    turn = Rotation.random(random_state=4).as_matrix()
    solid = random_hull(rng)
    assert faults(solid.moved(np.array([1.0, -2.0, 0.5]), turn)) == []
    assert solid.moved(np.array([1.0, -2.0, 0.5]), turn).volume == pytest.approx(solid.volume, rel=1e-12)


def test_normals_at():
    cube = box(np.full(3, 0.5), np.zeros(3), EYE)
    assert normals_at(cube, np.array([0.5, 0.5, 0.1]), 1e-9).tolist() == [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    assert normals_at(cube, np.zeros(3), 1e-9).shape == (0, 3)
    assert normals_at(cube, np.array([0.5 + 2e-9, 0.0, 0.0]), 1e-9) is None
    assert len(normals_at(cube, np.array([0.5 + 2e-9, 0.0, 0.0]), 3e-9)) == 1


def parted(solid: Polytope, segment: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Separations of a segment and a polytope along unit vectors, (n, 3), m, (n,)."""
    return (directions @ segment.T).min(axis=1) - (directions @ solid.vertices.T).max(axis=1)


@pytest.mark.parametrize("kind", ["across", "along an edge", "over a face", "point"])
def test_no_direction_parts_a_segment_better(kind):
    """The separation is concave in the direction where it is positive: a local maximum is the greatest, the distance.

    One of the vectors is it. Directions 1e-3 and 1e-6 rad beside that one part the two by no more than rounding further.
    """
    rng = np.random.default_rng(11)
    corners = np.zeros(4, dtype=int)
    for _ in range(150):
        solid = random_hull(rng)
        middle = rng.normal(size=3)
        middle *= (1.5 + 3.0 * rng.random()) * np.linalg.norm(solid.vertices, axis=1).max() / np.linalg.norm(middle)
        span = rng.normal(size=3) * (0.0 if kind == "point" else 2.0)
        if kind == "along an edge":
            a, b, *_ = solid.edges[int(rng.integers(len(solid.edges)))]
            span = solid.vertices[b] - solid.vertices[a]
        if kind == "over a face":
            k = int(rng.integers(len(solid.faces)))
            centre, normal = solid.vertices[list(solid.faces[k])].mean(axis=0), solid.normals[k]
            middle, span = centre + rng.random() * normal, 3.0 * (span - (span @ normal) * normal)
        segment = np.stack((middle - span, middle + span))
        found = np.array(outward_vectors(solid, segment))
        if kind == "over a face":  # bit for bit, be it that the segment ends beyond it on both sides
            np.testing.assert_array_equal(found[0], normal)
        apart = parted(solid, segment, found)
        best = found[int(np.argmax(apart))]
        if apart.max() <= 0.0:
            continue
        heights = solid.vertices @ best
        corners[min(int((heights >= heights.max() - 1e-9).sum()), 3)] += 1
        for turn in (1e-3, 1e-6):
            beside = best + turn * rng.normal(size=(200, 3))
            beside /= np.linalg.norm(beside, axis=1)[:, None]
            assert parted(solid, segment, beside).max() <= apart.max() + 10.0 * ROUNDING
    # It is nearest to corners and edges, and where it lies over a face to nothing else.
    assert (corners[3] if kind == "over a face" else min(corners[1:3])) > 20
