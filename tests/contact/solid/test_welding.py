"""Common planes of pieces: shared bit for bit, moved by no more than printed, whatever the order of the pieces."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ffsm_mj.contact.solid.welding import Step, TooThinError, weld
from ffsm_mj.polytope import box, hull_of

EYE = np.eye(3)


def plates(*tops: float, thickness: float = 0.1, width: float = 1.0):
    """Boxes side by side along x, from x = 0 on, with their upper sides at some heights."""
    half = np.array([width / 2.0, 0.5, thickness / 2.0])
    return [box(half, np.array([(k + 0.5) * width, 0.0, top - thickness / 2.0]), EYE) for k, top in enumerate(tops)]


def upper(welded):
    """Planes and offsets of the upper sides."""
    return [(planes[2], piece.offsets[2]) for planes, piece in zip(welded.planes, welded.pieces, strict=True)]


def consistent(welded) -> bool:
    """Whether all faces have their plane bit for bit, and all vertices are on their planes within the residual."""
    for piece, planes in zip(welded.pieces, welded.planes, strict=True):
        for k, (plane, sense) in enumerate(planes):
            if (piece.normals[k] != sense * welded.normals[plane]).any():
                return False
            if piece.offsets[k] != sense * welded.offsets[plane]:
                return False
            corners = piece.vertices[list(piece.faces[k])]
            if np.abs(corners @ piece.normals[k] - piece.offsets[k]).max() > welded.report.residual_m + 2e-15:
                return False
    return True


def test_exact_planes_are_shared_in_both_senses():
    """Two boxes of one height: upper, lower and outer sides are common, and the seam with opposite senses."""
    welded = weld(plates(0.0, 0.0), 1e-9)
    assert consistent(welded)
    assert (welded.report.merged, welded.report.greatest_move_m, welded.report.steps) == (5, 0.0, ())
    one, other = welded.planes
    assert one[2] == other[2]
    assert one[0][0] == other[3][0]  # x = 1
    assert one[0][1] == -other[3][1]
    assert len(welded.offsets) == 7
    np.testing.assert_array_equal(welded.pieces[0].vertices, plates(0.0, 0.0)[0].vertices)


def test_case_7_a_step_of_a_micrometre_is_welded():
    """The second plate is 1 um high: with a tolerance of 1e-5 m it is brought down, and the move is printed."""
    pieces = plates(0.0, 1e-6)
    pieces[0] = box(np.array([1.0, 0.5, 0.05]), np.array([0.0, 0.0, -0.05]), EYE)
    welded = weld(pieces, 1e-5)
    assert consistent(welded)
    assert {plane for plane, _ in upper(welded)} == {upper(welded)[0][0]}
    assert [offset for _, offset in upper(welded)] == [0.0, 0.0]
    assert welded.report.greatest_move_m == pytest.approx(1e-6, abs=1e-15)
    assert str(welded.report).endswith("greatest move 1.0e-06 m")


def test_a_real_step_stays_and_is_reported():
    """One that is 5 tolerances high looks like a missed weld; one of 1000 is meant."""
    assert weld(plates(0.0, 5e-9), 1e-9).report.steps == (Step((0, 1), pytest.approx(5e-9, abs=1e-15), crack=False),)
    far = weld(plates(0.0, 1e-6), 1e-9)
    assert far.report.steps == ()
    assert upper(far)[0][0] != upper(far)[1][0]
    assert far.pieces[1].offsets[2] == pytest.approx(1e-6, abs=1e-16)


def test_a_crack_is_reported():
    pieces = [box(np.full(3, 0.5), np.array([x, 0.0, 0.0]), EYE) for x in (0.0, 1.0 + 3e-9)]
    assert weld(pieces, 1e-9).report.steps == (Step((0, 1), pytest.approx(3e-9, abs=1e-15), crack=True),)


def test_faces_of_distant_pieces_are_no_step():
    pieces = [box(np.full(3, 0.1), np.array([x, 0.0, z]), EYE) for x, z in ((0.0, 0.0), (5.0, 3e-9))]
    assert weld(pieces, 1e-9).report.steps == ()


def test_case_13_alternate_heights_become_one():
    """Plates alternately 1e-9 m high, tolerance 1e-8 m."""
    welded = weld(plates(*[0.0, 1e-9] * 5), 1e-8)
    assert consistent(welded)
    assert len({*upper(welded)}) == 1
    assert welded.report.greatest_move_m == pytest.approx(1e-9, abs=1e-15)


def test_nothing_depends_on_the_order():
    rng = np.random.default_rng(1)
    turn = Rotation.from_rotvec([0.2, 0.3, -0.1]).as_matrix()
    pieces = [piece.moved(np.array([1.0, 2.0, 3.0]), turn) for piece in plates(*(1e-10 * rng.normal(size=8)))]
    welded = weld(pieces, 1e-9)
    assert consistent(welded)
    for _ in range(5):
        order = rng.permutation(8)
        other = weld([pieces[k] for k in order], 1e-9)
        for k, place in enumerate(order):
            np.testing.assert_array_equal(other.pieces[k].normals, welded.pieces[place].normals)
            np.testing.assert_array_equal(other.pieces[k].offsets, welded.pieces[place].offsets)
            np.testing.assert_array_equal(other.pieces[k].vertices, welded.pieces[place].vertices)


def test_without_a_tolerance_rounding_is_shared():
    """Boxes cut from one along a turned axis have planes that differ in their last digits."""
    turn = Rotation.from_rotvec([0.2, 0.3, -0.1]).as_matrix()
    half = np.array([0.15, 0.5, 0.05])
    pieces = [box(half, np.array([0.1, 0.2, 0.3]) + turn @ [0.3 * k, 0.0, -0.05], turn) for k in range(6)]
    raw = {(*piece.normals[2], piece.offsets[2]) for piece in pieces}
    welded = weld(pieces, 0.0)
    assert len(raw) > 1
    assert len({*upper(welded)}) == 1
    assert welded.report.greatest_move_m == 0.0


def test_pieces_of_one_source_are_not_welded():
    assert len({*upper(weld(plates(0.0, 5e-10), 1e-9, sources=(0, 0)))}) == 2
    assert len({*upper(weld(plates(0.0, 5e-10), 1e-9, sources=(0, 1)))}) == 1


def test_a_sliver_joins_by_its_vertices():
    """A face of 1 m by 1e-8 m that is 5e-10 m out of plane at one side is tilted by 0.05: its normal says nothing."""
    profile = [(0, 0), (-1e-8, -5e-10), (-1, -1), (0, -1)]
    sliver = hull_of(np.array([[x, y, z] for x in (0, 1) for y, z in profile]))
    welded = weld([sliver, box(np.full(3, 0.5), np.array([0.5, 0.5, -0.5]), EYE)], 1e-9)
    thin = int(np.argmax(sliver.normals[:, 2]))
    assert sliver.normals[thin, 2] < 0.999
    assert welded.planes[0][thin] == welded.planes[1][2]
    assert consistent(welded)


def test_vertices_on_many_planes_keep_a_residual():
    """The apex of a pyramid of six sides of which one is moved cannot be on all of them."""
    angles = np.arange(6) * np.pi / 3.0
    ring = np.column_stack((np.cos(angles), np.sin(angles), np.zeros(6)))
    pyramid = hull_of(np.vstack((ring, [0.0, 0.0, 1.0])))
    side = int(np.argmax(pyramid.normals[:, 0] + 0.1 * pyramid.normals[:, 1]))
    corners = pyramid.vertices[list(pyramid.faces[side])] + 4e-9 * pyramid.normals[side]
    middle = corners.mean(axis=0)
    large = hull_of(np.vstack((middle + 10.0 * (corners - middle), middle + 5.0 * pyramid.normals[side])))
    report = weld([pyramid, large], 1e-8).report
    assert 1e-9 < report.residual_m < 4e-9
    assert report.greatest_move_m < 1e-8


def test_a_tolerance_above_a_tenth_of_the_thinnest_piece_is_refused():
    thin = [*plates(0.0), *plates(0.0, thickness=0.005)]
    message = r"0\.005 m thick: a welding tolerance of 0\.001 m is more than a tenth of this, at most 0\.0005 m is allowed"
    with pytest.raises(TooThinError, match=message) as caught:
        weld(thin, 1e-3, sources=(7, 8))
    assert caught.value.source == 8
    weld(plates(0.0, thickness=0.005), 1e-3)  # nothing to be welded to
