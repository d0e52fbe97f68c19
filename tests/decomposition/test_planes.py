"""The exact partition: known numbers of pieces, volumes, points inside and outside, shared planes, rounded files, limits."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from ffsm_mj.decomposition import planes
from ffsm_mj.decomposition.gate import gate
from ffsm_mj.errors import InputError
from ffsm_mj.polytope import hull_of
from tests.decomposition import meshes

NAME = "part.obj: mesh 'part'"
CONVEX_PARTS = {
    meshes.box: 1,
    meshes.bracket: 2,
    meshes.plate: 4,
    meshes.slot: 5,
    meshes.posts: 3,
    meshes.frame: 12,
    meshes.cone: 64,
}
"""Least numbers of pieces that face planes cut: two legs, four sides, a base with two walls and two lips, three
posts, twelve bars, and a piece behind each of the 64 inner facets."""


def surface_of(part):
    return gate(*part, NAME).surface


def pieces_of(surface, tolerance_m=None):
    return planes.partition(surface, surface.rounding if tolerance_m is None else tolerance_m, NAME)


def turn(vertices):
    """A rigid motion, so that no plane is parallel to those of the axes."""
    q = np.array([0.8, 0.3, -0.2, 0.4])
    w, x, y, z = q / np.linalg.norm(q)
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return vertices @ rotation.T + [0.3, -0.2, 0.7]


def number_around(pieces, points):
    """In how many pieces each point is."""
    return sum(((points @ piece.normals.T - piece.offsets).max(axis=1) < 0.0).astype(int) for piece in pieces)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("part", CONVEX_PARTS)
def test_pieces_fill_the_solid_once(part, turned):
    """Number and volume; and every point is in one piece if it is inside, by the winding number, and in none outside.

    Rounding: coordinates of 1 m have 1e-16, and the planes of adjacent facets of the cone meet at 0.1 rad, which is ten
    times as much at their corners; 0.02 m3 times that is below 1e-16 m3 for the smaller parts and 1e-15 m3 for the cone.
    """
    vertices, faces = part()
    surface = surface_of((turn(vertices) if turned else vertices, faces))
    pieces = pieces_of(surface)
    assert len(pieces) == CONVEX_PARTS[part]
    assert abs(sum(piece.volume for piece in pieces) - surface.volume) < 1e-15
    for piece in pieces:
        for face, normal, offset in zip(piece.faces, piece.normals, piece.offsets, strict=True):
            assert np.abs(piece.vertices[list(face)] @ normal - offset).max() < 1e-14
    # Points at random, and on both sides of every triangle.
    rng = np.random.default_rng(1)
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    points = rng.uniform(low - 0.02, high + 0.02, (200, 3))
    inside = [surface.winding(point) > 0.5 for point in points]
    centres = surface.triangles.mean(axis=1)
    off = 1e-4 * surface.areas / np.linalg.norm(surface.areas, axis=1)[:, None]
    for sense in (-1.0, 1.0):
        points, inside = np.vstack((points, centres + sense * off)), [*inside, *[sense < 0.0] * len(centres)]
    np.testing.assert_array_equal(number_around(pieces, points), inside)


@pytest.mark.parametrize(("part", "count"), [(meshes.slot, 12), (meshes.posts, 11)])
def test_neighbours_share_planes_bit_for_bit(part, count):
    """Of any two planes of the pieces either both are one, in the same or the other sense, or they differ visibly."""
    vertices, faces = part()
    pieces = pieces_of(surface_of((turn(vertices), faces)))
    distinct = {}
    for piece in pieces:
        for normal, offset in zip(piece.normals.tolist(), piece.offsets.tolist(), strict=True):
            first = next(value for value in normal if abs(value) > 0.1)
            sense = 1.0 if first > 0.0 else -1.0
            distinct[tuple(sense * value for value in (*normal, offset))] = True
    for one, other in combinations(map(np.array, distinct), 2):
        assert np.abs(one - other).max() > 1e-3
    # Slot: two ends, two outer sides, bottom, top, floor of the slot, lips, and two walls of the slot and of its neck.
    # Posts: six planes across x, two across y, three levels.
    assert len(distinct) == count


@pytest.mark.parametrize("part", CONVEX_PARTS)
def test_single_precision_changes_no_number(part):
    """STL has coordinates in single precision, so that corners of a face are no longer in one plane."""
    vertices, faces = part()
    surface = surface_of((turn(vertices).astype(np.float32).astype(np.float64), faces))
    pieces = pieces_of(surface)
    assert len(pieces) == CONVEX_PARTS[part]
    # Each face moves by no more than the tolerance.
    area = 0.5 * np.linalg.norm(surface.areas, axis=1).sum()
    assert abs(sum(piece.volume for piece in pieces) - surface.volume) < surface.rounding * area


@pytest.mark.parametrize("scale", [1e-3, 1e2, 1e4])
def test_the_unit_of_length_changes_no_number(scale):
    """Tolerances follow the coordinates: a file in mm, and a station of a kilometre."""
    part, faces = meshes.cone(16)
    for vertices in (turn(part), turn(part).astype(np.float32).astype(np.float64)):
        surface = surface_of((scale * vertices, faces))
        pieces = pieces_of(surface)
        assert len(pieces) == 16
        area = np.linalg.norm(surface.areas, axis=1).sum()
        assert abs(sum(piece.volume for piece in pieces) - surface.volume) < surface.rounding * area


def test_decimal_digits_need_a_tolerance():
    """An OBJ with six digits is rounded by 5e-7 m: facets that meet at 0.1 rad move by ten times that."""
    vertices, faces = meshes.cone()
    surface = surface_of((np.round(turn(vertices), 6), faces))
    assert len(pieces_of(surface, 1e-5)) == 64
    assert len(pieces_of(surface, 1e-6)) > 64


def test_pieces_of_random_parts_fill_them_and_no_two_have_a_convex_union():
    """Boundaries of random cells: volumes to rounding, each cell in one piece; and merging was worth it somewhere."""
    rng, fewer, parts = np.random.default_rng(3), 0, 0
    while parts < 40:
        shape = rng.integers(2, 6, 3)
        filled = rng.random(shape) < rng.choice([0.5, 0.8, 0.9, 0.95])
        lines = [np.concatenate([[0.0], np.cumsum(rng.random(count) + 0.1)]) for count in shape]
        try:
            surface = surface_of(meshes.of_cells(lines, filled))
        except InputError:  # two cells touch along an edge, or there is none
            continue
        parts += 1
        cut = planes._Partition(surface, surface.rounding, NAME).pieces()
        pieces = pieces_of(surface)
        fewer += len(cut) - len(pieces)
        assert abs(sum(piece.volume for piece in pieces) - surface.volume) < 1e-14
        middles = [0.5 * (line[1:] + line[:-1]) for line in lines]
        centres = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1)
        np.testing.assert_array_equal(number_around(pieces, centres.reshape(-1, 3)).reshape(shape), filled)
        for one, other in combinations(pieces, 2):
            corners = np.vstack((one.vertices, other.vertices))
            assert hull_of(corners).volume > one.volume + other.volume + 1e-9
    assert fewer > 0


@pytest.mark.long
def test_nozzle():
    """A piece behind each of its 64 x 12 inner facets."""
    surface = surface_of(meshes.nozzle())
    pieces = pieces_of(surface)
    assert len(pieces) == 768
    assert abs(sum(piece.volume for piece in pieces) - surface.volume) < 1e-15


def test_small_nozzle():
    surface = surface_of(meshes.nozzle(16, 4))
    pieces = pieces_of(surface)
    assert len(pieces) == 64
    assert abs(sum(piece.volume for piece in pieces) - surface.volume) < 1e-16


def test_cavities_and_separate_parts():
    """A box in a hollow box: the six walls of the hollow one, and the inner one."""
    vertices, faces = meshes.box()
    scaled = [(1.0, faces), (0.8, faces[:, ::-1]), (0.5, faces)]
    centre = vertices.mean(axis=0)
    both = (
        np.vstack([centre + scale * (vertices - centre) for scale, _ in scaled]),
        np.vstack([triangles + k * len(vertices) for k, (_, triangles) in enumerate(scaled)]),
    )
    surface = surface_of(both)
    pieces = pieces_of(surface)
    assert len(pieces) == 7
    assert sum(piece.volume for piece in pieces) == pytest.approx(1e-3 * (1.0 - 0.512 + 0.125), rel=1e-12)


@pytest.mark.parametrize("tolerance_m", [1e-9, 1e-7, 1e-6, 1e-5])
@pytest.mark.parametrize("digits", [4, 5, 6])
def test_rounded_files_are_partitioned_or_refused(digits, tolerance_m):
    """Facets of a rounded file are no planes: the pieces fill what it says to the tolerance, or it is refused in a line."""
    vertices, faces = meshes.cone(16)
    surface = surface_of((np.round(turn(vertices), digits), faces))
    pieces, message = [], ""
    try:
        pieces = pieces_of(surface, tolerance_m)
    except InputError as refused:
        message = refused.lines[0]
    if message:
        assert "; use 'method: coacd', or a tolerance_m" in message
        return
    area = np.linalg.norm(surface.areas, axis=1).sum()
    assert abs(sum(piece.volume for piece in pieces) - surface.volume) <= 1e-9 * surface.volume + tolerance_m * area
    centres = surface.triangles.mean(axis=1)
    off = 3e-3 * surface.areas / np.linalg.norm(surface.areas, axis=1)[:, None]
    np.testing.assert_array_equal(number_around(pieces, centres - off), 1)
    np.testing.assert_array_equal(number_around(pieces, centres + off), 0)


@pytest.mark.parametrize(("limit", "least"), [("MOST_PLANES", 20), ("MOST_PIECES", 20), ("LONGEST_S", 0.0)])
def test_limits_suggest_the_other_method(monkeypatch, limit, least):
    monkeypatch.setattr(planes, limit, least)
    with pytest.raises(InputError, match="method: coacd") as refused:
        pieces_of(surface_of(meshes.cone()))
    assert refused.value.lines[0].startswith(NAME)


def test_pieces_that_do_not_fill_the_mesh_are_refused():
    """A tolerance beyond what separates facets takes some together and not others."""
    vertices, faces = meshes.cone()
    surface = surface_of((np.round(turn(vertices), 6), faces))
    with pytest.raises(InputError, match=r"the pieces have 0\.60.* m3, the mesh has 0\.00696"):
        pieces_of(surface, 1e-4)


@pytest.mark.parametrize("tolerance_m", [0.05, 1.0])
def test_a_tolerance_that_leaves_no_pieces_is_refused(tolerance_m):
    """Nearly half the size of the part, so that nothing is thicker, and more than all of it, so that no face has a plane."""
    with pytest.raises(
        InputError, match=rf"the pieces have 0 m3, the mesh has 0\.000116: .* tolerance_m = {tolerance_m:g} m"
    ):
        pieces_of(surface_of(meshes.bracket()), tolerance_m)
