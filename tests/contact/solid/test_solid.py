"""Features of a union near a place."""

from __future__ import annotations

import numpy as np
import pytest

from ffsm_mj.contact.solid.solid import Solid
from ffsm_mj.polytope import box
from tests.contact.solid.pieces import EYE, cut_at_random

EVERYWHERE = np.full(3, -9.0), np.full(3, 9.0), 0.0


def plate_of_two():
    return Solid([box(np.array([0.5, 0.5, 0.1]), np.array([x, 0.0, -0.1]), EYE) for x in (-0.5, 0.5)], 1e-9)


def test_planes_on_a_seam():
    """On the seam both pieces have the upper side and a covered one; a point of one, or inside, has less."""
    solid = plate_of_two()
    there = solid.planes_at(np.array([0.0, 0.2, 0.0]), 1e-9)
    (one, other) = there.values()
    assert [*there] == [0, 1]
    (common,) = set(one) & set(other)
    assert solid.normal(common).tolist() == [0.0, 0.0, 1.0]
    (seam,), (other_seam,) = set(one) - {common}, set(other) - {common}
    assert seam == (other_seam[0], -other_seam[1])
    assert solid.normal(seam).tolist() == [1.0, 0.0, 0.0]
    assert solid.planes_at(np.array([0.3, 0.2, 0.0]), 1e-9) == {1: (common,)}
    assert solid.planes_at(np.array([0.3, 0.2, -0.1]), 1e-9) == {1: ()}
    assert solid.planes_at(np.array([0.3, 0.2, 0.1]), 1e-9) == {}


def test_faces_at_a_point_and_on_an_edge():
    solid = plate_of_two()
    assert [face.normal.tolist() for face in solid.faces_at(np.array([0.3, 0.2, 0.0]), 1e-9)] == [[0.0, 0.0, 1.0]]
    assert len(solid.faces_at(np.array([1.0, 0.2, 0.0]), 1e-9)) == 2
    assert solid.faces_at(np.array([3.0, 0.2, 0.0]), 1e-9) == ()


def test_features_near_a_place_are_those_of_the_pieces_there():
    """Near one end of a plate: the edges along this piece, with those that go on over the other; all together of a box."""
    solid = plate_of_two()
    assert (len(solid.edges_near(*EVERYWHERE)), len(solid.vertices_near(*EVERYWHERE))) == (12, 8)
    end = np.array([1.0, 0.0, 0.0])
    edges = solid.edges_near(end, end, 0.1)
    assert len(edges) == 8
    assert {edge.pieces for edge in edges} == {(0, 1), (1,)}
    assert len(solid.vertices_near(end, end, 0.1)) == 4


@pytest.mark.parametrize("seed", range(3))
def test_edges_of_a_place_are_edges_of_the_whole(seed):
    """Whatever is asked first: edges are whole, and one object."""
    rng = np.random.default_rng(seed)
    whole = box(np.array([0.5, 0.4, 0.1]), np.zeros(3), EYE)
    pieces = cut_at_random(rng, whole, 6)
    solid, all_at_once = Solid(pieces, 1e-9), Solid(pieces, 1e-9)
    seen = set()
    for k in rng.permutation(len(pieces)):
        middle = pieces[k].vertices.mean(axis=0)
        seen |= set(solid.edges_near(middle, middle, 0.0))
    lengths = sorted(float(np.linalg.norm(edge.end - edge.start)) for edge in seen)
    expected = sorted(float(np.linalg.norm(edge.end - edge.start)) for edge in all_at_once.edges_near(*EVERYWHERE))
    assert lengths == pytest.approx(expected, abs=1e-14)
    assert lengths == pytest.approx([0.2] * 4 + [0.8] * 4 + [1.0] * 4, abs=1e-14)


def test_without_welding_rounding_counts():
    solid = Solid([box(np.full(3, 0.1), np.array([x, 0.0, 0.0]), EYE) for x in (0.0, 0.2)], 0.0)
    assert solid.tolerance == 1e-12
    assert len(solid.edges_near(*EVERYWHERE)) == 12
    assert solid.report.greatest_move_m == 0.0
