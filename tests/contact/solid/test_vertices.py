"""Vertices of unions against brute force: directions around corners that are in any piece."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from ffsm_mj.contact.solid.tree import BoxTree
from ffsm_mj.contact.solid.vertices import UnionVertices
from ffsm_mj.contact.solid.welding import weld
from ffsm_mj.polytope import box, hull_of
from tests.contact.solid.pieces import EYE, cut_at_random, random_boxes

TOLERANCE = 1e-9
RADIUS_M = 1e-6
COUNT = 4000
_TURNS = np.arange(COUNT) * np.pi * (3.0 - np.sqrt(5.0))
_HEIGHTS = 1.0 - 2.0 * (np.arange(COUNT) + 0.5) / COUNT
SPHERE = np.column_stack((np.cos(_TURNS) * np.sqrt(1 - _HEIGHTS**2), np.sin(_TURNS) * np.sqrt(1 - _HEIGHTS**2), _HEIGHTS))
"""Directions that are 0.06 rad apart."""


def vertices_of(pieces):
    """All vertices of a union, and its pieces after welding."""
    welded = weld(pieces, TOLERANCE)
    tree = BoxTree(np.array([piece.bounds for piece in welded.pieces]))
    vertices = UnionVertices(welded, tree, TOLERANCE)
    return list({id(vertex): vertex for k in range(len(pieces)) for vertex in vertices.of(k)}.values()), welded


def margin(pieces, place) -> float:
    """How far a plane through a place can be turned with all pieces around it below: negative or 0 if there is none."""
    points = place + RADIUS_M * SPHERE
    filled = SPHERE[np.any([(points @ p.normals.T - p.offsets).max(axis=1) <= 1e-13 for p in pieces], axis=0)]
    bounds = [(-1.0, 1.0)] * 3 + [(None, 1.0)]
    return -linprog([0, 0, 0, -1], np.column_stack((filled, np.ones(len(filled)))), np.zeros(len(filled)), bounds=bounds).fun


@pytest.mark.parametrize("seed", range(10))
def test_random_unions(seed):
    """Boxes on a grid, with common corners, and at random attitudes."""
    rng = np.random.default_rng(seed)
    pieces = random_boxes(rng, int(rng.integers(2, 6)))
    if seed % 2:
        pieces = [
            box(rng.uniform(0.1, 0.3, 3), rng.uniform(-0.2, 0.2, 3), Rotation.random(random_state=seed + 10 * k).as_matrix())
            for k in range(3)
        ]
    vertices, welded = vertices_of(pieces)
    listed = {tuple(np.round(vertex.position, 9) + 0.0) for vertex in vertices}
    assert len(listed) == len(vertices)
    corners = {tuple(np.round(corner, 9) + 0.0): corner for piece in welded.pieces for corner in piece.vertices}
    clear = 0
    for key, corner in corners.items():
        turn = margin(welded.pieces, corner)
        # Directions 0.06 rad apart leave a margin of up to 0.09 where there is none.
        if turn < 0.1 or turn > 0.15:
            clear += 1
            assert (key in listed) == (turn > 0.15)
    assert clear > 0.9 * len(corners)


@pytest.mark.parametrize("seed", range(6))
def test_a_cut_box_has_the_eight_vertices_of_the_whole(seed):
    """Whatever the cuts; with cones that have the same planes as those of the whole."""
    rng = np.random.default_rng(seed)
    turn = Rotation.random(random_state=seed).as_matrix() if seed % 2 else EYE
    whole = box(np.array([0.5, 0.4, 0.1]), rng.normal(size=3), turn)
    vertices, _ = vertices_of(cut_at_random(rng, whole, int(rng.integers(1, 9))))
    assert len(vertices) == 8
    for vertex in vertices:
        assert np.abs(whole.vertices - vertex.position).max(axis=1).min() < 1e-15
        normals = whole.normals_at(vertex.position, TOLERANCE)
        assert np.abs((vertex.cone @ normals.T).max(axis=0)).max() < 1e-12


def test_a_seam_has_no_vertices():
    """Four boxes around a point of their upper side: the eight outer corners only; with a needle on it also its tip."""
    floor = [box(np.array([0.5, 0.5, 0.1]), np.array([x, y, -0.1]), EYE) for x in (-0.5, 0.5) for y in (-0.5, 0.5)]
    vertices, _ = vertices_of(floor)
    assert sorted(np.abs(vertex.position).tolist() for vertex in vertices) == [[1.0, 1.0, 0.0]] * 4 + [[1.0, 1.0, 0.2]] * 4
    tower = box(np.array([0.1, 0.1, 0.2]), np.array([0.0, 0.0, 0.2]), EYE)
    assert len(vertices_of([*floor, tower])[0]) == 12


def test_corners_that_several_pieces_have():
    """Boxes side by side have four common corners, none of the union; tips that touch oppositely are none either."""
    side_by_side = [box(np.full(3, 0.1), np.array([x, 0.0, 0.0]), EYE) for x in (-0.1, 0.1)]
    assert len(vertices_of(side_by_side)[0]) == 8
    assert len(vertices_of([box(np.full(3, 0.1), np.full(3, x), EYE) for x in (-0.1, 0.1)])[0]) == 14


def test_the_tip_of_two_pieces_has_the_directions_of_both():
    """Two halves of a pyramid, cut through its apex: one vertex, whose cone is that of the whole."""
    base = np.array([[x, y, 1.0] for x in (-0.5, 0.5) for y in (-0.5, 0.5)])
    halves = hull_of(np.vstack((base, np.zeros(3)))).cut(np.array([0.8, 0.6, 0.0]), 0.0)
    vertices, _ = vertices_of(halves)
    assert len(vertices) == 5
    (tip,) = (vertex for vertex in vertices if not vertex.position.any())
    assert tip.pieces == (0, 1)
    for corner in base / np.linalg.norm(base, axis=1)[:, None]:
        assert np.abs(tip.cone - corner).max(axis=1).min() < 1e-15


def test_a_mesh_in_single_precision_has_its_corners():
    rng = np.random.default_rng(1)
    whole = box(np.array([0.3, 0.2, 0.1]), np.zeros(3), Rotation.from_rotvec([0.2, 0.5, 0.1]).as_matrix())
    mesh = hull_of(whole.vertices + 1e-8 * rng.normal(size=(8, 3)), merge=1e-6)
    vertices, welded = vertices_of([mesh, box(np.full(3, 0.01), np.array([0.0, 0.0, 5.0]), EYE)])
    assert welded.flaws[0] > 1e-9
    assert len(vertices) == 16
