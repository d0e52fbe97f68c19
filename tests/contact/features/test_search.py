"""Features of a contact: their names and numbers, without duplicates, and the change from one feature to the next."""

from __future__ import annotations

import math
from collections import Counter

import mujoco
import numpy as np
import pytest

from ffsm_mj.contact.features.search import features
from ffsm_mj.tolerances import CROSSING, FEATURE_BOUND_M
from tests.contact.features.test_gap_functions import pair_of
from tests.scenes import HEAD

BOX, LONG = 'type="box" size="0.1 0.15 0.2"', 'type="box" size="0.02 0.02 0.1"'
CAPSULE, CYLINDER = 'type="capsule" size="0.05 0.1"', 'type="cylinder" size="0.05 0.1"'
THIN = 'type="cylinder" size="0.02 0.1"'
BALL, EGG, MESH = 'type="sphere" size="0.05"', 'type="ellipsoid" size="0.1 0.08 0.05"', 'type="mesh" mesh="cube"'
CUBE = " ".join(f"{x} {y} {z}" for x in (-0.1, 0.1) for y in (-0.15, 0.15) for z in (-0.2, 0.2))
UPRIGHT, FALLEN, TURNED = (1, 0, 0, 0), (1, 1, 0, 0), (math.cos(math.pi / 12), 0, 0, math.sin(math.pi / 12))
_DIAGONAL = 0.05 * math.sqrt(0.5)
_ALONG_EDGE = (0.1 + _DIAGONAL, 0.1, 0.2 + _DIAGONAL)
_ON_EDGE = (math.sqrt(0.5), 0.5, 0.5, 0)  # its long axis level, turned about it by 45 degrees

TOUCHES = {
    "boxes flush, corner on corner": (BOX, BOX, (0, 0, 0.4), UPRIGHT, {"vertex on face": 4}),
    "boxes flush, shifted": (BOX, BOX, (0.05, 0.05, 0.4), UPRIGHT, {"vertex on face": 2, "edge on edge": 2}),
    "boxes flush, shifted along an edge": (BOX, BOX, (0.05, 0, 0.4), UPRIGHT, {"vertex on face": 4}),
    "boxes flush, turned by 30 degrees": (BOX, BOX, (0, 0, 0.4), TURNED, {"edge on edge": 8}),
    "boxes flush, turned and shifted": (BOX, BOX, (0.05, 0.05, 0.4), TURNED, {"vertex on face": 2, "edge on edge": 4}),
    "a small box on a box": (BOX, LONG, (0, 0, 0.3), TURNED, {"vertex on face": 4}),
    "a box on its edge": (BOX, LONG, (0, 0, 0.2 + 0.02 * math.sqrt(2)), _ON_EDGE, {"vertex on face": 2}),
    "a capsule on its side": (BOX, CAPSULE, (0, 0, 0.25), FALLEN, {"end on face": 2}),
    "a capsule over the edge": (BOX, CAPSULE, (0, 0.1, 0.25), FALLEN, {"end on face": 1, "side on edge": 1}),
    "a capsule along the edge": (BOX, CAPSULE, _ALONG_EDGE, FALLEN, {"end on edge": 1, "vertex on side": 1}),
    "capsules side by side": (CAPSULE, CAPSULE, (0.1, 0, 0.05), UPRIGHT, {"end on side": 2}),
    "capsules side by side, ends level": (CAPSULE, CAPSULE, (0.1, 0, 0), UPRIGHT, {"end on side": 4}),
    "capsules crossed": (CAPSULE, CAPSULE, (0.1, 0, 0.05), FALLEN, {"side on side": 1}),
    "a ball on a face": (BOX, BALL, (0.02, 0.01, 0.25), UPRIGHT, {"sphere on face": 1}),
    "a cylinder standing": (BOX, CYLINDER, (0, 0, 0.3), UPRIGHT, {"rim on face": 8}),
    "a cylinder standing over the edge": (BOX, CYLINDER, (0.11, 0, 0.3), UPRIGHT, {"rim on face": 3, "edge on rim": 2}),
    "a cylinder standing on the corner": (
        BOX,
        CYLINDER,
        (0.11, 0.16, 0.3),
        UPRIGHT,
        {"vertex on cap": 1, "rim on face": 1, "edge on rim": 2},
    ),
    "a cylinder on its side": (BOX, CYLINDER, (0, 0, 0.25), FALLEN, {"rim on face": 2}),
    "a cylinder on its side over the edge": (BOX, CYLINDER, (0, 0.1, 0.25), FALLEN, {"rim on face": 1, "side on edge": 1}),
    "a cylinder along the edge": (BOX, CYLINDER, _ALONG_EDGE, FALLEN, {"edge on rim": 1, "vertex on side": 1}),
    "a box inside a cap": (CYLINDER, LONG, (0.01, 0, 0.2), UPRIGHT, {"vertex on cap": 4}),
    "a box over the rim of a cap": (
        CYLINDER,
        LONG,
        (0.05, 0, 0.2),
        UPRIGHT,
        {"vertex on cap": 2, "rim on face": 1, "edge on rim": 2},
    ),
    "a capsule across a cap": (CYLINDER, CAPSULE, (0.02, 0, 0.15), FALLEN, {"side on rim": 2}),
    "a capsule over a cap": (CYLINDER, CAPSULE, (0.02, 0.1, 0.15), FALLEN, {"end on cap": 1, "side on rim": 1}),
    "a capsule beside a cylinder": (CYLINDER, CAPSULE, (0.1, 0, 0.05), UPRIGHT, {"end on side": 1, "side on rim": 1}),
    "a box on an ellipsoid": (EGG, BOX, (0.01, 0.02, 0.25), UPRIGHT, {"ellipsoid on face": 1}),
    "cylinders stacked, turned": (CYLINDER, CYLINDER, (0, 0, 0.2), TURNED, {"rim on cap": 16}),
    "cylinders stacked, shifted": (CYLINDER, CYLINDER, (0.02, 0.01, 0.2), TURNED, {"rim on cap": 7, "rim on rim": 2}),
    "a cylinder inside a cap": (CYLINDER, THIN, (0.01, 0.01, 0.2), TURNED, {"rim on cap": 8}),
    "a cylinder over a rim": (CYLINDER, THIN, (0.05, 0, 0.2), TURNED, {"rim on cap": 5, "rim on rim": 2}),
    "cylinders side by side": (CYLINDER, CYLINDER, (0.1, 0, 0.05), UPRIGHT, {"side on rim": 2}),
    "cylinders side by side, ends level": (CYLINDER, CYLINDER, (0.1, 0, 0), UPRIGHT, {"side on rim": 4}),
    "cylinders side by side, turned by 1e-4": (CYLINDER, CYLINDER, (0.1, 0, 0.05), (1, 5e-5, 0, 0), {"side on side": 1}),
    "cylinders crossed": (CYLINDER, CYLINDER, (0.1, 0, 0.05), FALLEN, {"side on side": 1}),
    "a cylinder across a cap": (CYLINDER, CYLINDER, (0.01, 0, 0.15), FALLEN, {"side on rim": 2}),
    "a cylinder over a cap": (CYLINDER, CYLINDER, (0.01, 0.08, 0.15), FALLEN, {"rim on cap": 1, "side on rim": 1}),
    "an ellipsoid on a cap": (CYLINDER, EGG, (0.01, 0.02, 0.15), UPRIGHT, {"ellipsoid on cap": 1}),
    "an ellipsoid beside a cylinder": (CYLINDER, EGG, (0.15, 0, 0.05), UPRIGHT, {"side on ellipsoid": 1}),
    "two ellipsoids": (EGG, EGG, (0.2, 0, 0), UPRIGHT, {"ellipsoid on ellipsoid": 1}),
}


def body(geom):
    asset = f'<asset><mesh name="cube" vertex="{CUBE}"/></asset>' if "mesh" in geom else ""
    return f"""<mujoco>{HEAD}{asset}<worldbody><body name="b"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/><geom name="g" {geom} mass="0"/>
      </body></worldbody></mujoco>"""


def placed(folder, a, b, position, turn, rng):
    """(pair, model, data) of b at a pose relative to a, both at a random pose in space, moving."""
    pair, model, data = pair_of(folder, body(a), body(b))
    place(data, position, turn, rng)
    data.qvel[:] = rng.uniform(-1, 1, 12)
    mujoco.mj_forward(model, data)
    return pair, model, data


def place(data, position, turn, rng):
    whole = rng.normal(size=4)
    whole /= np.linalg.norm(whole)
    origin = rng.uniform(-0.5, 0.5, 3)
    offset, both = np.zeros(3), np.zeros(4)
    mujoco.mju_rotVecQuat(offset, np.array(position, float), whole)
    mujoco.mju_mulQuat(both, whole, np.array(turn, float) / np.linalg.norm(turn))
    data.qpos[:] = [*origin, *whole, *(origin + offset), *both]


@pytest.mark.parametrize("case", TOUCHES)
def test_features_by_name_and_number(tmp_path, rng, case):
    """Names and numbers, in both orders of the geoms; each feature is closed, and flush faces have one normal."""
    a, b, position, turn, expected = TOUCHES[case]
    pair, model, data = placed(tmp_path, a, b, position, turn, rng)
    check(pair, model, data, expected)
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, np.array(turn, float) / np.linalg.norm(turn))
    back = -matrix.reshape(3, 3).T @ position
    pair, model, data = placed(tmp_path, b, a, back, (turn[0], -turn[1], -turn[2], -turn[3]), rng)
    check(pair, model, data, expected)


def stop(model, data):
    """Of features at one place, which one closes first depends on the motion."""
    data.qvel[:] = 0.0
    mujoco.mj_forward(model, data)


def check(pair, model, data, expected):
    stop(model, data)
    near = pair.proximity(model, data)
    found = features(pair, model, data, near)
    assert Counter(feature.name for feature in found) == expected
    for state in (feature.at(data) for feature in found):
        assert abs(state.gap) <= 1e-15 + abs(near.gap)
        assert state.inside >= -1e-15
        np.testing.assert_allclose(state.normal, near.normal, rtol=0, atol=1e-12)
    points = {tuple(np.round(feature.at(data).point, 12)) for feature in found}
    assert len(points) > 1 or len(found) == 1


@pytest.mark.parametrize("angle", [0.9e-6, 1.1e-6, 3e-6, 1e-5])
def test_sides_along_each_other_touch_at_both_ends(tmp_path, rng, angle):
    """Their axes part by y = angle * 0.15 m at most over their overlap, and the normals at its ends by y over both radii."""
    pair, model, data = placed(tmp_path, CYLINDER, CYLINDER, (0.1, 0, 0.05), (1, 0.5 * angle, 0, 0), rng)
    near = pair.proximity(model, data)
    found = [feature.at(data) for feature in features(pair, model, data, near)]
    assert len(found) == len(near.points) == 2
    assert math.dist(found[0].point, found[1].point) == pytest.approx(0.15, rel=1e-9)
    for state in found:
        assert math.dist(state.normal, near.normal) <= 0.15 * angle / 0.1
        assert min(math.dist(state.point, point) for point in near.points) <= 0.15 * angle
        assert 0.0 <= state.gap - near.gap <= (0.15 * angle) ** 2 / 0.2  # two circles part by y^2 / (2 (r1 + r2))


CUBES = [name for name, touch in TOUCHES.items() if touch[0] == BOX and "cylinder" not in name]


@pytest.mark.parametrize("case", CUBES)
def test_a_mesh_cube_is_a_box(tmp_path, rng, case):
    """To single precision: all its features have the gap and the normal of the pair."""
    _, b, position, turn, expected = TOUCHES[case]
    pair, model, data = placed(tmp_path, MESH, MESH if b == BOX else b, position, turn, rng)
    stop(model, data)
    near = pair.proximity(model, data)
    assert 1e-10 < abs(near.gap) < 2e-8  # 0.2 m in single precision is 3e-9 m longer
    found = features(pair, model, data, near)
    assert Counter(feature.name for feature in found) == expected
    for state in (feature.at(data) for feature in found):
        assert state.gap == pytest.approx(near.gap, abs=1e-15)
        if state.normal @ near.normal < 1.0 - 1e-13:
            assert expected.keys() & {"vertex on side", "end on edge"}  # not flush: a face has no part in it


def test_the_contact_patch_of_two_boxes_is_their_overlap(tmp_path, rng):
    """The points of the features are the corners of the intersection of both faces, without duplicates."""
    for _ in range(10):
        angle, (x, y) = rng.uniform(0, 1), rng.uniform(-0.15, 0.15, 2)
        pair, model, data = placed(tmp_path, BOX, BOX, (x, y, 0.4), (math.cos(angle), 0, 0, math.sin(angle)), rng)
        check_patch(pair, model, data)


def check_patch(pair, model, data):
    near = pair.proximity(model, data)
    points = np.array([feature.at(data).point for feature in features(pair, model, data, near)])
    apart = np.linalg.norm(points[:, None] - near.points, axis=2)
    assert len(points) == len(near.points)
    assert apart.min(axis=0).max() < 1e-12
    assert apart.min(axis=1).max() < 1e-12


def test_the_contact_patch_of_two_caps_is_their_overlap(tmp_path, rng):
    """The points of the rim of each over the other, and the crossings of the rims."""
    crossings = 0
    for _ in range(20):
        angle, (x, y) = rng.uniform(0, 1), rng.uniform(-0.05, 0.05, 2)
        other = str(rng.choice([CYLINDER, THIN]))
        pair, model, data = placed(tmp_path, CYLINDER, other, (x, y, 0.2), (math.cos(angle), 0, 0, math.sin(angle)), rng)
        data.qvel[:] = 0.0  # else the point of a rim that approaches fastest is one more
        mujoco.mj_forward(model, data)
        check_patch(pair, model, data)
        found = features(pair, model, data, pair.proximity(model, data))
        crossings += any(feature.name == "rim on rim" for feature in found)
    assert 10 <= crossings < 20


def test_rims_that_hardly_cross_have_no_crossings(tmp_path, rng):
    """Equal caps shifted by d cross at the angle d / radius: below CROSSING the fixed points of their rims are the patch."""
    for share, expected in ((0.9, 0), (1.1, 2)):
        pair, model, data = placed(tmp_path, CYLINDER, CYLINDER, (share * CROSSING * 0.05, 0, 0.2), TURNED, rng)
        found = features(pair, model, data, pair.proximity(model, data))
        assert sum(feature.name == "rim on rim" for feature in found) == expected
        assert sum(feature.name == "rim on cap" for feature in found) >= 7


def test_rims_that_coincide_have_no_crossings(tmp_path):
    """Centre to centre is rounding along the axis: its direction is none, in which no rim can have its angle 0."""
    across = 'quat="0.7071067811865476 0.7071067811865476 0 0"'
    geom = f'type="cylinder" size="0.08 0.05" {across}'
    pair, model, data = pair_of(tmp_path, body(geom), body(geom))
    data.qpos[[1, 8]] = 0.37, 0.47
    mujoco.mj_forward(model, data)
    found = features(pair, model, data, pair.proximity(model, data))
    assert Counter(feature.name for feature in found) == {"rim on cap": 8}


def over_edge(folder, offset, corner):
    """A ball on a box, its centre beyond an edge (or a corner) of the top by an offset: (pair, model, data)."""
    radius, half = 0.05, np.array([0.1, 0.15, 0.2])
    beyond = np.array([offset, offset if corner else -0.1])
    over = float(np.linalg.norm(np.maximum(beyond, 0.0)))
    position = [*(half[:2] + beyond), half[2] + math.sqrt(radius**2 - over**2)]
    return placed(folder, BOX, BALL, position, UPRIGHT, np.random.default_rng(1))


@pytest.mark.parametrize("corner", [False, True])
@pytest.mark.parametrize(
    ("offset", "expected"), [(-1e-3, 0), (-1e-9, 0), (-3e-10, 0), (3e-10, 0), (1e-9, 1), (1e-3, 1), (0.02, 1)]
)
def test_a_ball_changes_its_feature_at_the_edge(tmp_path, offset, expected, corner):
    """One feature at a time: the face up to FEATURE_BOUND_M / 2 beyond its side, then the edge or the vertex."""
    pair, model, data = over_edge(tmp_path, offset, corner)
    (feature,) = features(pair, model, data, pair.proximity(model, data))
    names = ("sphere on face", "sphere on vertex" if corner else "sphere on edge")
    assert feature.name == names[expected]
    # The foot's way past the edge: of the edge's own bounds the one towards the face is the offset of the ball's centre.
    assert feature.at(data).inside == pytest.approx(offset if expected else -offset, abs=1e-15)


def test_a_feature_ends_where_the_foot_leaves_it(tmp_path):
    """Beyond the edge, the gap of the face is that of its plane; over the face, the gap of the edge is that of its line."""
    pair, model, data = over_edge(tmp_path, -0.01, corner=False)
    (face,) = features(pair, model, data, pair.proximity(model, data))
    normal = face.at(data).normal
    outwards = data.geom("robot/g").xmat.reshape(3, 3)[:, 0]
    data.qpos[7:10] += 0.03 * outwards
    mujoco.mj_forward(model, data)
    state = face.at(data)
    assert state.inside == pytest.approx(-0.02, abs=1e-15)
    assert state.gap == pytest.approx(0.0, abs=1e-15)
    np.testing.assert_allclose(state.normal, normal, rtol=0, atol=1e-15)
    data.qpos[7:10] -= (0.05 - math.sqrt(0.05**2 - 0.02**2)) * normal
    mujoco.mj_forward(model, data)
    (edge,) = features(pair, model, data, pair.proximity(model, data))
    assert edge.at(data).inside == pytest.approx(0.02, abs=1e-15)
    data.qpos[7:10] -= 0.03 * outwards
    mujoco.mj_forward(model, data)
    state = edge.at(data)
    assert state.inside == pytest.approx(-0.01, abs=1e-15)
    assert state.gap == pytest.approx(math.hypot(0.01, math.sqrt(0.05**2 - 0.02**2)) - 0.05, abs=1e-15)


@pytest.mark.long
def test_a_ball_keeps_a_feature_over_the_edge_of_a_face_of_several_facets(tmp_path):
    """The top of a mesh is two facets tilted by 1e-5 rad, level within its precision and thus one face with one plane.

    The normals of the ball at the edge end at that of the facet, 6e-7 m of its way short of that of the plane: over all this
    way it must be on the edge or on the face.
    """
    half, high, ridge, radius = 0.005, 0.1, 3e-8, 0.1
    top = [(x, y, high + math.copysign(ridge, x * y)) for x in (-half, half) for y in (-half, half)]
    bottom = [(x, y, -high) for x in (-0.1, 0.1) for y in (-0.1, 0.1)]
    mesh = " ".join(str(number) for corner in top + bottom for number in corner)
    robot = body(MESH).replace(CUBE, mesh)
    pair, model, data = pair_of(tmp_path, robot, body(f'type="sphere" size="{radius}"'))
    data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    names = Counter()
    for way in np.arange(-2e-6, 2e-6, 1e-7):
        data.qpos[7:] = [half + way, 0.001, high + radius, 1, 0, 0, 0]
        for _ in range(3):
            mujoco.mj_forward(model, data)
            near = pair.proximity(model, data)
            data.qpos[7:10] -= near.gap * near.normal
        mujoco.mj_forward(model, data)
        (feature,) = features(pair, model, data, pair.proximity(model, data))
        names[feature.name] += 1
    assert set(names) == {"sphere on face", "sphere on edge"}
    assert min(names.values()) > 10


@pytest.mark.parametrize("beyond", [-0.02, 0.02])
def test_an_edge_ends_at_its_end(tmp_path, rng, beyond):
    """A capsule across the vertical edge of a box, above or below the upper end of the edge."""
    position = (0.1 + _DIAGONAL, 0.15 + _DIAGONAL, 0.2 + beyond)
    across = (math.cos(math.pi / 8), 0, 0, math.sin(math.pi / 8))  # its axis level, square to the diagonal
    level = np.zeros(4)
    mujoco.mju_mulQuat(level, np.array(across), np.array([1.0, 1.0, 0.0, 0.0]) / math.sqrt(2))
    pair, model, data = placed(tmp_path, BOX, CAPSULE, (*position[:2], 0.1), level, rng)
    (feature,) = features(pair, model, data, pair.proximity(model, data))
    assert feature.name == "side on edge"
    assert feature.at(data).inside == pytest.approx(0.1, abs=1e-12)
    data.qpos[7:10] += (0.1 + beyond) * data.geom("robot/g").xmat.reshape(3, 3)[:, 2]
    mujoco.mj_forward(model, data)
    assert feature.at(data).inside == pytest.approx(-beyond, abs=1e-12)
    assert feature.at(data).gap == pytest.approx(0.0, abs=1e-15)


def test_a_feature_is_entered_within_half_of_the_tolerance(tmp_path):
    """A feature that was left is not entered again at the same place; otherwise the event would repeat."""
    pair, model, data = over_edge(tmp_path, 1.01 * FEATURE_BOUND_M, corner=False)
    (feature,) = features(pair, model, data, pair.proximity(model, data))
    assert feature.name == "sphere on edge"
    assert feature.at(data).inside > 0.0


def test_a_wrong_distance_query_in_contact_is_corrected(tmp_path):
    """In some poses MuJoCo's distance of two flush boxes is 0.002 to 0.017 m, with coinciding witness points."""
    _, _, position, turn, expected = TOUCHES["a small box on a box"]
    _, model, data = pair_of(tmp_path, body(BOX), body(LONG))
    wrong = []
    for seed in range(500):
        place(data, position, turn, np.random.default_rng(seed))
        mujoco.mj_kinematics(model, data)
        if mujoco.mj_geomDistance(model, data, 0, 1, 1.0, None) > 1e-3:
            wrong.append(seed)
    assert wrong
    for seed in wrong:
        pair, model, data = placed(tmp_path, BOX, LONG, position, turn, np.random.default_rng(seed))
        assert abs(pair.gap(model, data, 1.0)) < 1e-15
        near = pair.proximity(model, data)
        assert Counter(feature.name for feature in features(pair, model, data, near)) == expected


@pytest.mark.parametrize(("across", "height", "edge"), [(CAPSULE, 0.15, 0.0), (LONG, 0.12, -0.02)])
def test_the_ends_of_a_chord_stay_apart_as_it_shrinks(tmp_path, rng, across, height, edge):
    """A side or an edge across a cap of R = 0.05 m leaves it at +-R sin of half the angle, wherever it was before.

    Rounding of 1e-16 m of the distance, which is the same along the chord, moves its ends by that over the squared sine.
    """
    pair, model, data = placed(tmp_path, CYLINDER, across, (0.01, 0, height), FALLEN, rng)
    found = [each for each in features(pair, model, data, pair.proximity(model, data)) if each.tilt(data) is not None]
    start, turn = data.qpos[7:10].copy(), data.xmat[1].reshape(3, 3).copy()
    places = [turn.T @ (each.at(data).point - data.xpos[1]) for each in found]
    found = [each for each, place in zip(found, places, strict=True) if edge == 0.0 or place[0] < 0.0]
    before = [y for x, y, _ in places if edge == 0.0 or x < 0.0]
    assert len(found) == 2
    for half_angle in (0.5, 1e-3, 1.2, 2e-4):
        data.qpos[7:10] = start + turn @ np.array([0.05 * math.cos(half_angle) - edge - 0.01, 0.0, 0.0])
        mujoco.mj_forward(model, data)
        for each, side in zip(found, before, strict=True):
            state = each.at(data)
            y = (turn.T @ (state.point - data.xpos[1]))[1]
            assert y == pytest.approx(math.copysign(0.05 * math.sin(half_angle), side), abs=1e-16 / half_angle**2)
            assert state.inside == pytest.approx(0.05 * (math.sin(half_angle) - CROSSING), abs=1e-6)
    data.qpos[7:10] = start + turn @ np.array([0.06 - edge - 0.01, 0.0, 0.0])
    mujoco.mj_forward(model, data)
    assert all(each.at(data).inside < 0.0 for each in found)
