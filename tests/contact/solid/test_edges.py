"""Convex edges of unions against brute force: which directions around points of edges are in any piece."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ffsm_mj._core.boxes import BoxTree
from ffsm_mj.contact.solid.edges import Sector, UnionEdges, united
from ffsm_mj.contact.solid.welding import weld
from ffsm_mj.polytope import box, hull_of
from tests.contact.solid.pieces import EYE, cut_at_random, random_boxes

TOLERANCE = 1e-9
RADIUS_M = 1e-6
"""Of the circles: far above rounding, far below the distances of features of the scenes."""
ANGLES = 360
"""Directions on a circle: a sector is known to a degree."""


def edges_of(pieces):
    """All convex edges of a union, and its pieces after welding."""
    welded = weld(pieces, TOLERANCE)
    tree = BoxTree(np.array([piece.bounds for piece in welded.pieces]))
    edges = UnionEdges(welded, tree, TOLERANCE)
    return list({id(edge): edge for k in range(len(pieces)) for edge in edges.of(k)}.values()), welded


def in_any(pieces, points):
    return np.any([(points @ piece.normals.T - piece.offsets).max(axis=1) <= 1e-13 for piece in pieces], axis=0)


def places_on_edges(pieces):
    """Middles of the parts of all edges of all pieces between crossings with any plane, and the edges' directions."""
    for piece in pieces:
        for a, b, *_ in piece.edges:
            start, span = piece.vertices[a], piece.vertices[b] - piece.vertices[a]
            heights, slopes = (np.concatenate([p.normals @ v for p in pieces]) for v in (start, span))
            heights = heights - np.concatenate([p.offsets for p in pieces])
            crossing = np.abs(slopes) > 1e-9
            cuts = -heights[crossing] / slopes[crossing]
            cuts = np.sort(np.concatenate((cuts[(cuts > 0.0) & (cuts < 1.0)], [0.0, 1.0])))
            for low, high in pairwise(cuts):
                if (high - low) * np.linalg.norm(span) > 1e-4:
                    yield start + 0.5 * (low + high) * span, span / np.linalg.norm(span)


def runs(filled):
    """Starts and lengths of the runs of a closed sequence that are true."""
    if filled.all() or not filled.any():
        return []
    ends = np.flatnonzero(filled & ~np.roll(filled, -1))
    starts = np.flatnonzero(filled & ~np.roll(filled, 1))
    return [(int(start), int(min((ends - start) % len(filled))) + 1) for start in starts]


def disagreements(pieces) -> tuple[int, int, int]:
    """Numbers of places on edges, of wrong edges there, and of missed ones."""
    edges, welded = edges_of(pieces)
    places = wrong = missed = 0
    for place, along in places_on_edges(welded.pieces):
        e = np.cross(along, EYE[int(np.argmin(np.abs(along)))])
        e /= np.linalg.norm(e)
        turns = (np.arange(ANGLES) + 0.123) * 2.0 * np.pi / ANGLES
        circle = np.cos(turns)[:, None] * e + np.sin(turns)[:, None] * np.cross(along, e)
        filled = in_any(welded.pieces, place + RADIUS_M * circle)
        expected = [run for run in runs(filled) if run[1] < ANGLES / 2 - 1]
        through = [
            edge
            for edge in edges
            if np.linalg.norm(np.cross(place - edge.start, edge.direction)) < 1e-10
            and abs(along @ edge.direction) > 1.0 - 1e-12
            and edge.start @ edge.direction < place @ edge.direction < edge.end @ edge.direction
        ]
        places += 1
        missed += max(0, len(expected) - len(through))
        wrong += max(0, len(through) - len(expected))
        for edge in through:
            # Between the vectors into both faces, and not beyond them, is one of the runs.
            middle = edge.into.sum(axis=0) / np.linalg.norm(edge.into.sum(axis=0))
            half = np.arccos(np.clip(middle @ edge.into[0], -1.0, 1.0)) * ANGLES / (2.0 * np.pi)
            centre = int(np.argmax(circle @ middle))
            match = [
                length
                for first, length in expected
                if abs((centre - first) % ANGLES - length / 2.0) < 2.0 and abs(length / 2.0 - half) < 2.0
            ]
            wrong += not match
    return places, wrong, missed


@pytest.mark.parametrize("seed", range(10))
def test_boxes_on_a_grid(seed):
    """Many common sides, edges and corners, and boxes that overlap."""
    rng = np.random.default_rng(seed)
    places, wrong, missed = disagreements(random_boxes(rng, int(rng.integers(2, 7))))
    assert places > 20
    assert (wrong, missed) == (0, 0)


@pytest.mark.parametrize("seed", range(5))
def test_boxes_at_random_attitudes(seed):
    rng = np.random.default_rng(seed)
    pieces = [
        box(rng.uniform(0.1, 0.3, 3), rng.uniform(-0.2, 0.2, 3), Rotation.random(random_state=10 * seed + k).as_matrix())
        for k in range(3)
    ]
    places, wrong, missed = disagreements(pieces)
    assert places > 50
    assert (wrong, missed) == (0, 0)


@pytest.mark.parametrize("seed", range(6))
def test_a_cut_box_has_the_twelve_edges_of_the_whole(seed):
    """Whatever the cuts: each edge is one, from corner to corner, with the directions of the whole."""
    rng = np.random.default_rng(seed)
    turn = Rotation.random(random_state=seed).as_matrix() if seed % 2 else EYE
    whole = box(np.array([0.5, 0.4, 0.1]), rng.normal(size=3), turn)
    edges, _ = edges_of(cut_at_random(rng, whole, int(rng.integers(1, 9))))
    singles, _ = edges_of([whole])
    assert len(edges) == len(singles) == 12
    for edge in edges:
        ends = [np.stack((single.start, single.end)) for single in singles]
        apart = [min(np.abs(np.stack((edge.start, edge.end))[::s] - end).max() for s in (1, -1)) for end in ends]
        single = singles[int(np.argmin(apart))]
        assert min(apart) < 1e-14
        assert np.abs(np.cross(edge.direction, single.direction)).max() < 1e-14
        assert min(np.abs(edge.into[::s] - single.into).max() for s in (1, -1)) < 1e-14


def test_an_edge_of_one_geom_has_the_wedge_of_its_faces():
    edges, welded = edges_of([box(np.array([0.1, 0.2, 0.3]), np.zeros(3), EYE)])
    for edge in edges:
        normals = [sense * welded.normals[plane] for plane, sense in edge.planes]
        middle = 0.5 * (edge.start + edge.end)
        for normal, other, into in zip(normals, normals[::-1], edge.into, strict=True):
            assert (normal @ into, other @ into, edge.direction @ into) == (0.0, -1.0, 0.0)
            assert in_any(welded.pieces, (middle + 0.01 * into)[None])
        assert (edge.end - edge.start) @ edge.direction == pytest.approx(np.linalg.norm(edge.end - edge.start))


def test_a_block_on_a_plate():
    """The block has its eight upper edges, the plate its twelve; where they meet all edges are concave."""
    plate = box(np.array([0.5, 0.5, 0.1]), np.array([0.0, 0.0, -0.1]), EYE)
    block = box(np.full(3, 0.1), np.array([0.0, 0.0, 0.1]), EYE)
    edges, _ = edges_of([plate, block])
    assert len(edges) == 20
    assert all(max(edge.start[2], edge.end[2]) > 0.0 for edge in edges if edge.pieces == (1,))


def test_boxes_that_touch_along_an_edge_have_both_edges():
    pieces = [box(np.full(3, 0.1), np.array([x, x, 0.0]), EYE) for x in (-0.1, 0.1)]
    edges, _ = edges_of(pieces)
    assert len(edges) == 24
    common = [edge for edge in edges if np.abs((edge.start + edge.end)[:2]).max() < 1e-15]
    assert len(common) == 2
    assert common[0].planes != common[1].planes


@pytest.mark.parametrize(("step", "along_seam"), [(1e-10, 0), (1e-8, 2), (1e-6, 6)])
def test_a_step_is_an_edge_and_a_welded_one_is_none(step, along_seam):
    """The second plate is higher: its upper edge and the lower one of the first are convex, and above 10 nm the sides."""
    heights = {-0.5: 0.0, 0.5: step}
    edges, _ = edges_of([box(np.array([0.5, 0.5, 0.1]), np.array([x, 0.0, z - 0.1]), EYE) for x, z in heights.items()])
    seam = [edge for edge in edges if edge.start[0] == edge.end[0] == 0.0]
    assert len(seam) == along_seam
    assert sorted(edge.start[2] for edge in seam if abs(edge.direction[1]) == 1.0) == pytest.approx(
        [-0.2, step][: min(along_seam, 2)], abs=1e-16
    )


def test_an_edge_passes_over_shorter_parts_of_itself():
    """A long box, a short one within its length, and one beyond its end, all with the same sides: one box."""
    pieces = [
        box(np.array([half, 0.5, depth]), np.array([x, 0.0, -depth]), EYE)
        for x, half, depth in ((1.5, 1.5, 0.2), (1.5, 0.5, 0.1), (3.5, 0.5, 0.2))
    ]
    edges, _ = edges_of(pieces)
    assert len(edges) == 12
    assert {edge.pieces for edge in edges if abs(edge.direction[0]) == 1.0 and edge.start[2] == 0.0} == {(0, 1, 2)}


def test_order_and_number_of_pieces_do_not_matter():
    """Permuted, and cut once more: the same edges."""
    rng = np.random.default_rng(5)
    pieces = random_boxes(rng, 5)

    def ends(some):
        return sorted(sorted(map(tuple, np.round((edge.start, edge.end), 12))) for edge in edges_of(some)[0])

    expected = ends(pieces)
    assert ends([pieces[k] for k in rng.permutation(5)]) == expected
    middle = pieces[0].vertices.mean(axis=0)
    parts = pieces[0].cut(np.array([0.0, 0.6, 0.8]), float(np.array([0.0, 0.6, 0.8]) @ middle))
    assert ends([*pieces[1:], *parts]) == expected


def test_a_mesh_in_single_precision_has_its_edges():
    """Corners off their planes by 1e-8 m, far above the tolerance: two such boxes, apart by a crack, have 12 edges each."""
    rng = np.random.default_rng(1)
    whole = box(np.array([0.3, 0.2, 0.1]), np.zeros(3), Rotation.from_rotvec([0.2, 0.5, 0.1]).as_matrix())
    meshes = [
        hull_of(whole.vertices + shift + 1e-8 * rng.normal(size=(8, 3)), merge=1e-6)
        for shift in (np.zeros(3), (0.6 + 1e-5) * whole.normals[0])
    ]
    edges, welded = edges_of(meshes)
    assert 1e-9 < max(welded.flaws) < 2e-8
    assert len(edges) == 24


def sector(start, width, name):
    return Sector(start % (2.0 * np.pi), width, (name, 1), (name, -1))


@pytest.mark.parametrize(
    ("sectors", "widths"),
    [
        ([(0.0, 1.0)], [1.0]),
        ([(0.0, 1.0), (1.0, 1.0)], [2.0]),
        ([(0.0, 1.0), (0.0, 1.0)], [1.0]),
        ([(0.0, 1.0), (3.0, 1.0)], [1.0, 1.0]),
        ([(6.0, 1.0), (0.5, 1.0)], [1.0 + 1.5 + 2 * np.pi - 7.0]),
        ([(0.0, np.pi), (np.pi, np.pi)], []),
        ([(0.0, 3.0), (2.0, 3.0), (4.0, 3.0)], []),
        ([(5.0, 3.0), (0.0, 1.0), (1.0, 0.2)], [3.0]),
        ([(k * 0.5 - 1.0, 0.5) for k in range(5)], [2.5]),
        ([(1e-17, 1.0), (-1e-17, 0.5)], [1.0]),
    ],
)
def test_unions_of_sectors(sectors, widths):
    """In any order, whatever starts at zero."""
    rng = np.random.default_rng(1)
    for turn in (0.0, 1.0, 2.5, 6.0):
        some = [sector(start + turn, width, k) for k, (start, width) in enumerate(sectors)]
        union = united([some[k] for k in rng.permutation(len(some))])
        assert sorted(one.width for one in union) == pytest.approx(sorted(widths), abs=1e-12)
