"""Faces and edges of a union at a place and along its pieces."""

from __future__ import annotations

import numpy as np
import pytest

from ffsm_mj.contact.solid.solid import Solid
from ffsm_mj.polytope import box
from tests.contact.solid.pieces import EYE, all_edges, cut_at_random, faces_at


def plate_of_two():
    return Solid([box(np.array([0.5, 0.5, 0.1]), np.array([x, 0.0, -0.1]), EYE) for x in (-0.5, 0.5)], 1e-9)


def test_faces_at_a_point_and_on_an_edge():
    solid = plate_of_two()
    assert [face.normal.tolist() for face in faces_at(solid, np.array([0.3, 0.2, 0.0]))] == [[0.0, 0.0, 1.0]]
    assert len(faces_at(solid, np.array([1.0, 0.2, 0.0]))) == 2
    assert faces_at(solid, np.array([3.0, 0.2, 0.0])) == []


def test_edges_of_a_piece_go_on_over_the_other():
    solid = plate_of_two()
    assert len(all_edges(solid)) == 12
    edges = solid.edges.of(1)
    assert len(edges) == 8
    assert {edge.pieces for edge in edges} == {(0, 1), (1,)}


@pytest.mark.parametrize("seed", range(3))
def test_edges_of_a_place_are_edges_of_the_whole(seed):
    """Whatever is asked first: edges are whole, and one object."""
    rng = np.random.default_rng(seed)
    whole = box(np.array([0.5, 0.4, 0.1]), np.zeros(3), EYE)
    pieces = cut_at_random(rng, whole, 6)
    solid, all_at_once = Solid(pieces, 1e-9), Solid(pieces, 1e-9)
    seen = set()
    for k in rng.permutation(len(pieces)):
        seen |= set(solid.edges.of(int(k)))
    lengths = sorted(float(np.linalg.norm(edge.end - edge.start)) for edge in seen)
    expected = sorted(float(np.linalg.norm(edge.end - edge.start)) for edge in all_edges(all_at_once))
    assert lengths == pytest.approx(expected, abs=1e-14)
    assert lengths == pytest.approx([0.2] * 4 + [0.8] * 4 + [1.0] * 4, abs=1e-14)


def test_without_welding_rounding_counts():
    solid = Solid([box(np.full(3, 0.1), np.array([x, 0.0, 0.0]), EYE) for x in (0.0, 0.2)], 0.0)
    assert solid.tolerance == 1e-12
    assert len(all_edges(solid)) == 12
    assert solid.report.greatest_move_m == 0.0
