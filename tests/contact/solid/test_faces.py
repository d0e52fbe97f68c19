"""Faces of unions: of a cut plate that of the whole; of random unions against membership in any polygon."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ffsm_mj.contact.solid.faces import UnionFaces
from ffsm_mj.contact.solid.welding import weld
from ffsm_mj.polytope import box
from tests.contact.solid.pieces import EYE, cut_at_random

TOLERANCE = 1e-9


def upper_faces(pieces, normal=(0.0, 0.0, 1.0), height=None):
    """The union faces that look along a normal; at the given height, or the highest."""
    welded = weld(pieces, TOLERANCE)
    faces = UnionFaces(welded, TOLERANCE)
    along = {plane: plane[1] * welded.normals[plane[0]] @ np.array(normal) for plane in faces.planes}
    heights = {plane: plane[1] * welded.offsets[plane[0]] for plane in faces.planes if along[plane] > 1.0 - 1e-12}
    plane = max(heights, key=lambda key: heights[key] if height is None else -abs(heights[key] - height))
    return faces.at(plane)


def rectangle(x, y, half_x, half_y, angle=0.0):
    """A plate with its upper side at z = 0."""
    turn = Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix()
    return box(np.array([half_x, half_y, 0.1]), np.array([x, y, -0.1]), turn)


def in_any(pieces, points):
    """Whether points of the plane z = 0 are in any of the plates."""
    return np.any([(points @ piece.normals.T - piece.offsets).max(axis=1) <= 1e-15 for piece in pieces], axis=0)


@pytest.mark.parametrize("seed", range(8))
def test_a_cut_plate_has_the_face_of_the_whole(seed):
    """Whatever the cuts: one face, with the sides of the uncut plate, and inside by the same distance."""
    rng = np.random.default_rng(seed)
    turn = Rotation.random(random_state=seed).as_matrix() if seed % 2 else EYE
    whole = box(np.array([0.5, 0.4, 0.1]), rng.normal(size=3), turn)
    (face,) = upper_faces(cut_at_random(rng, whole, int(rng.integers(1, 9))), whole.normals[2])
    (single,) = upper_faces([whole], whole.normals[2])
    assert len(face.sides) == len(single.sides) == 4
    # Coordinates of 3 m, four operations, and sides of 1 m.
    for vector, level in single.sides:
        assert min(abs(level - at) + np.abs(np.subtract(vector, v)).max() for v, at in face.sides) < 1e-14
    for point in whole.vertices[0] + rng.normal(size=(50, 3)):
        assert face.inside(point) == pytest.approx(single.inside(point), abs=1e-14)


def test_sides_have_the_format_of_faces_of_single_geoms():
    (face,) = upper_faces([rectangle(0.0, 0.0, 0.5, 0.2), rectangle(1.0, 0.0, 0.5, 0.2)])
    assert set(face.sides) == {
        ((1.0, 0.0, 0.0), -0.5),
        ((-1.0, 0.0, 0.0), -1.5),
        ((0.0, 1.0, 0.0), -0.2),
        ((0.0, -1.0, 0.0), -0.2),
    }
    assert face.pieces == (0, 1)


def test_an_l_is_not_convex_and_its_seam_is_no_side():
    """Two arms of 1 m by 0.4 m: at the seam the distance is that from the concave corner or the outer sides."""
    (face,) = upper_faces([rectangle(0.5, 0.2, 0.5, 0.2), rectangle(0.2, 0.7, 0.2, 0.3)])
    assert face.sides == ()
    lengths = np.linalg.norm(face.boundary[:, 1] - face.boundary[:, 0], axis=1)
    assert lengths.sum() == pytest.approx(4.0, abs=1e-14)
    at = {
        (0.2, 0.4): 0.2,
        (0.5, 0.2): 0.2,
        (0.4, 0.4): 0.0,
        (0.35, 0.35): 0.05 * np.sqrt(2.0),
        (0.7, 0.7): -0.3,
        (-0.3, -0.4): -0.5,
    }
    for (x, y), distance in at.items():
        assert face.inside(np.array([x, y, 0.3])) == pytest.approx(distance, abs=1e-14)


def test_sides_of_overlapping_pieces_on_one_line_are_outline():
    """Two rectangles that overlap and end at y = 0 both, with the solid on one side: this side is covered by neither."""
    (face,) = upper_faces([rectangle(0.5, 0.5, 0.5, 0.5), rectangle(1.0, 0.25, 0.5, 0.25)])
    assert face.sides == ()
    assert face.inside(np.array([0.75, 0.1, 0.0])) == pytest.approx(0.1, abs=1e-14)
    assert face.inside(np.array([0.75, -0.1, 0.0])) == pytest.approx(-0.1, abs=1e-14)


def test_the_distance_is_continuous_across_seams():
    """Along lines over the L: it changes by no more than the point moves, also within rounding of the seam."""
    (face,) = upper_faces([rectangle(0.5, 0.2, 0.5, 0.2), rectangle(0.2, 0.7, 0.2, 0.3)])
    rng = np.random.default_rng(1)
    for x in rng.uniform(0.0, 0.4, 20):
        for step in (1e-3, 1e-12, 1e-16):
            places = [np.array([x, 0.4 + k * step, 0.0]) for k in range(-5, 6)]
            distances = [face.inside(place) for place in places]
            assert np.abs(np.diff(distances)).max() <= step + 1e-15


def test_parts_that_do_not_touch_are_two_faces():
    faces = upper_faces([rectangle(0.0, 0.0, 0.2, 0.2), rectangle(1.0, 0.0, 0.2, 0.2), rectangle(0.0, 0.4, 0.2, 0.2)])
    assert sorted(face.pieces for face in faces) == [(0, 2), (1,)]
    assert all(len(face.sides) == 4 for face in faces)


def test_both_senses_of_a_plane_are_apart():
    """A box on a plate: the upper side of the plate, and the lower one of the box, which it covers."""
    pieces = [rectangle(0.0, 0.0, 0.5, 0.5), box(np.full(3, 0.1), np.array([0.0, 0.0, 0.1]), EYE)]
    (plate,), (lower,) = upper_faces(pieces, height=0.0), upper_faces(pieces, (0.0, 0.0, -1.0), height=0.0)
    assert plate.plane == (lower.plane[0], -lower.plane[1])
    assert (plate.pieces, lower.pieces) == ((0,), (1,))


@pytest.mark.parametrize("seed", range(6))
def test_random_unions_against_membership_in_any_polygon(seed):
    """The sign of the distance is membership; no outline is nearer than the distance, and some is as near."""
    rng = np.random.default_rng(seed)
    turned = 0.0 if seed % 2 else 1.0
    pieces = [rectangle(*rng.uniform(-0.5, 0.5, 2), *rng.uniform(0.1, 0.4, 2), turned * rng.uniform(0, 3)) for _ in range(5)]
    faces = upper_faces(pieces)
    angles = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    circle = np.column_stack((np.cos(angles), np.sin(angles), np.zeros(400)))
    checked = 0
    for x, y in rng.uniform(-1.0, 1.0, (60, 2)):
        point = np.array([x, y, 0.0])
        distance = max(face.inside(point) for face in faces)
        within = bool(in_any(pieces, point[None])[0])
        assert (distance > 0.0) == within
        nearer, farther = (in_any(pieces, point + factor * abs(distance) * circle) for factor in (1.0 - 1e-9, 1.02))
        assert (nearer == within).all()
        # Outside a convex face the distance is that from the lines of its sides, which may be nearer than its outline.
        if within or not any(face.sides for face in faces):
            # An outline that is as near is crossed over an angle of 2 sqrt(2 * 0.02) = 0.4 rad.
            assert (farther != within).any()
            checked += 1
    assert checked > 0
