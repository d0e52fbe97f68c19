"""Meshes that bound no solid are refused by name and reason; those that do pass unchanged."""

from __future__ import annotations

import time

import numpy as np
import pytest

from ffsm_mj.decomposition.gate import MOST_FACES, gate
from ffsm_mj.errors import InputError
from tests.decomposition import meshes

NAME = "part.obj: mesh 'part'"
PARTS = [meshes.box, meshes.plate, meshes.bracket, meshes.slot, meshes.frame, meshes.cone, meshes.nozzle]


def refusal(vertices, faces):
    with pytest.raises(InputError) as refused:
        gate(np.asarray(vertices, dtype=float), np.asarray(faces), NAME)
    assert len(refused.value.lines) == 1
    assert refused.value.lines[0].startswith(NAME)
    return refused.value.lines[0]


@pytest.mark.parametrize("part", PARTS)
def test_parts_pass_and_a_flipped_one_is_turned(part):
    vertices, faces = part()
    passed = gate(vertices, faces, NAME)
    turned = gate(vertices, faces[:, ::-1], NAME)
    assert not passed.turned
    assert turned.turned
    assert passed.surface.volume > 0.0
    assert turned.surface.volume == pytest.approx(passed.surface.volume, rel=1e-12)
    assert len(passed.surface.vertices) == len(vertices)


def test_vertices_of_equal_coordinates_are_one():
    """STL has three vertices of its own for each triangle."""
    vertices, faces = meshes.plate()
    passed = gate(vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3), NAME)
    assert len(passed.surface.vertices) == len(vertices)


@pytest.mark.parametrize("part", PARTS)
def test_holes_and_half_flipped_meshes_are_refused(part):
    vertices, faces = part()
    assert "is not closed: 3 edges belong to one triangle only" in refusal(vertices, faces[1:])
    half = len(faces) // 2
    assert "is not oriented" in refusal(vertices, np.vstack((faces[:half, ::-1], faces[half:])))


def test_a_million_faces_are_refused_at_once():
    vertices, _ = meshes.box()
    start = time.process_time()
    line = refusal(vertices, np.zeros((1_000_000, 3), dtype=int))
    assert str(MOST_FACES) in line
    assert time.process_time() - start < 1.0


def test_many_faces_pass_in_bounded_time():
    """A sphere of 16 000 triangles takes 0.5 s; the time grows in proportion."""
    angles = np.linspace(-0.49 * np.pi, 0.49 * np.pi, 80)
    sphere = meshes.revolved([(np.cos(a), np.sin(a)) for a in angles], 100)
    start = time.process_time()
    gate(*sphere, NAME)
    assert time.process_time() - start < 5.0


def test_sheets_are_refused():
    """Also those whose two sides share edges, of four triangles each, as the plate's."""
    for part in (meshes.plate, meshes.cone):
        vertices, faces = part()
        assert "has no thickness: it encloses " in refusal(vertices * [1.0, 1.0, 0.0], faces)


def test_parts_that_touch_along_an_edge_are_refused():
    vertices, faces = meshes.of_cells([[0.0, 0.1, 0.2], [0.0, 0.1], [0.0, 0.1, 0.2]], [[[1, 0]], [[0, 1]]])
    assert "is not a surface: 1 edges belong to more than two triangles" in refusal(vertices, faces)


def test_a_part_without_thickness_is_refused():
    """A box with a fin: its sides have the same place, and no volume between them."""
    vertices, faces = meshes.of_cells([[0.0, 0.1, 0.2], [0.0, 0.1], [0.0, 0.05, 0.1]], [[[1, 1]], [[1, 0]]])
    flat = vertices.copy()
    flat[(vertices[:, 0] == 0.2) & (vertices[:, 2] == 0.05), 2] = 1e-12
    flat[(vertices[:, 0] == 0.1) & (vertices[:, 2] == 0.05), 2] = 1e-12
    assert "no thickness there" in refusal(flat, faces)


@pytest.mark.parametrize("offset", [(0.01, 0.003, 0.002), (0.05, 0.0, 0.0), (0.02, 0.02, 0.0)])
def test_parts_that_overlap_are_refused(offset):
    """Two boxes, also with faces in one plane and edges that cross."""
    vertices, faces = meshes.box()
    both = np.vstack((vertices, vertices + offset)), np.vstack((faces, faces + len(vertices)))
    assert "overlaps itself" in refusal(*both)


def test_shells_are_cavities_or_refused():
    vertices, faces = meshes.box()
    inner = vertices * 0.5 + 0.02
    for second, what in ((faces, "is inside another one"), (faces[:, ::-1], "")):
        both = np.vstack((vertices, inner)), np.vstack((faces, second + len(vertices)))
        if what:
            assert what in refusal(*both)
        else:
            assert gate(*both, NAME).surface.volume == pytest.approx(1e-3 * (1.0 - 0.125), rel=1e-12)
    beside = np.vstack((vertices, 0.5 * vertices + 0.2)), np.vstack((faces, faces[:, ::-1] + len(vertices)))
    assert "is turned inwards" in refusal(*beside)
