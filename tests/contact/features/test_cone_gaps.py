"""Gap functions inside a cone: exact along the motion of both bodies, and equal to the gap of their pair."""

from __future__ import annotations

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from ffsm_mj.contact.cone_pair import ConePair, RoundConePair, cone_pairs
from ffsm_mj.contact.cone_rounds import NearestGenerators
from ffsm_mj.contact.features.cone_gaps import RoundOnCone
from ffsm_mj.contact.features.search import StoredFeatures, features
from ffsm_mj.model.composition import compile_system
from ffsm_mj.model.cones import ConeConfig
from ffsm_mj.model.files import read_model
from ffsm_mj.state import from_bytes, to_bytes
from tests.contact.features.test_gap_functions import check_motion, moved, turn_at_random
from tests.contact.features.test_stored import evaluated
from tests.contact.test_geometry import SHAPES, shape
from tests.forgetting import forgetting
from tests.scenes import box

CONE = ConeConfig(
    body="box", apex_m=(0.2, -0.1, 0.3), axis=(1.0, 2.0, -1.0), half_angle_deg=35.0, length_m=2.0, from_m=0.4, name="c"
)


def pairs_in_cone(folder, body, order, cone=CONE):
    """(pairs, model, data) of a cone on a free box and the geom g of a free body."""
    (folder / "holder.xml").write_text(box("box", half=(0.1, 0.1, 0.1)))
    (folder / "body.xml").write_text(body)
    holder, other = replace(read_model(folder / "holder.xml"), cones=(cone,)), read_model(folder / "body.xml")
    system = compile_system(holder, {"other": other}, time_step_s=1e-3)
    geoms = system.index("geom", "robot/c"), system.index("geom", "other/g")
    made = list(cone_pairs(system, "pair", geoms if order else geoms[::-1], 0.5, 0.0, "rule"))
    return made, system.mj, mujoco.MjData(system.mj)


def settle(pair: ConePair, model, data, rng):
    """Bring a rim or an ellipsoid into contact within the bounds of the surface, with a pose at random."""
    for _ in range(200):
        turn_at_random(data.qpos[:7], rng)
        turn_at_random(data.qpos[7:], rng)
        data.qvel[:] = rng.uniform(-1, 1, model.nv)
        mujoco.mj_forward(model, data)
        matrix = data.body("robot/box").xmat.reshape(3, 3)
        data.qpos[7:10] = matrix @ (np.array(CONE.apex_m) + 1.2 * np.array(CONE.direction) + rng.uniform(-0.2, 0.2, 3))
        for _ in range(60):
            mujoco.mj_forward(model, data)
            near = pair.proximity(model, data)
            if abs(near.gap) < 1e-14 and features(pair, model, data, near):
                return near
            if near.gap > 0.9:
                break
            data.qpos[7:10] -= near.gap * near.normal * (1.0 if pair.geom_a == "robot/c" else -1.0)
    pytest.fail("not brought into contact")


def touch(pair: ConePair, model, data, rng, along):
    """Bring the point of a pair into contact at a share of the length of a generator, at a random azimuth."""
    turn_at_random(data.qpos[:7], rng)
    turn_at_random(data.qpos[7:], rng)
    data.qpos[7:10] = rng.uniform(-1, 1, 3)
    data.qvel[:] = rng.uniform(-1, 1, model.nv)
    mujoco.mj_forward(model, data)
    angle, azimuth = math.radians(CONE.half_angle_deg), rng.uniform(0, 2 * math.pi)
    axis = np.array(CONE.direction)
    u, v = np.linalg.svd(axis[None])[2][1:]
    outward = math.cos(azimuth) * u + math.sin(azimuth) * v
    matrix = data.body("robot/box").xmat.reshape(3, 3)
    foot = np.array(CONE.apex_m) + (0.4 + 1.6 * along) * (axis + math.tan(angle) * outward)
    inward = math.sin(angle) * axis - math.cos(angle) * outward
    radius = pair._contact.radius
    wanted = data.body("robot/box").xpos + matrix @ (foot + radius * inward)
    if along in (0.0, 1.0):  # over the rim, half way round to where the surface ends
        off = math.cos(angle) * axis + math.sin(angle) * outward
        lean = (inward + (off if along else -off)) / math.sqrt(2.0)
        wanted = data.body("robot/box").xpos + matrix @ (foot + radius * lean)
    geom = model.geom("other/g").id
    place = data.geom_xpos[geom] + data.geom_xmat[geom].reshape(3, 3) @ pair._contact.place
    data.qpos[7:10] += wanted - place
    mujoco.mj_forward(model, data)
    return pair.proximity(model, data)


@pytest.mark.parametrize("order", [True, False])
@pytest.mark.parametrize(
    ("kind", "along"),
    [(k, 0.6) for k in ("sphere", "capsule", "box", "cylinder", "ellipsoid")] + [("sphere", 0.0), ("capsule", 1.0)],
)
def test_a_feature_has_the_gap_of_the_pair(tmp_path, rng, kind, along, order):
    """Gap, normal, point, rate and second rate of both; formulas of the pair are those of moving points over surfaces."""
    pairs, model, data = pairs_in_cone(tmp_path, shape(kind), order)
    assert len(pairs) == {"sphere": 1, "capsule": 2, "box": 8, "cylinder": 4, "ellipsoid": 2}[kind]
    for pair in pairs[:2]:
        for _ in range(3):
            near = (
                touch(pair, model, data, rng, along)
                if kind in ("sphere", "capsule", "box")
                else settle(pair, model, data, rng)
            )
            assert near.gap == pytest.approx(0.0, abs=1e-14)
            assert pair.gap(model, data) == near.gap
            data.qacc[:] = rng.uniform(-1, 1, model.nv)
            (feature,) = features(pair, model, data, near)
            assert feature.name.endswith({0.6: "on cone", 0.0: "on throat", 1.0: "on mouth"}[along])
            state = feature.at(data)
            assert state.gap == pytest.approx(near.gap, abs=1e-14)
            assert state.rate == pytest.approx(near.rate, abs=1e-13)
            np.testing.assert_allclose(state.point, near.points[0], rtol=0, atol=1e-13)
            np.testing.assert_allclose(state.normal, near.normal, rtol=0, atol=1e-13)
            found = check_motion(pair, model, data, feature)
            expected = pair.second_rate(model, data, near, near.points[0])
            assert found == pytest.approx(expected.value, abs=1e-12 * (1.0 + expected.scale))
            stored = from_bytes(to_bytes(StoredFeatures(model).to_plain(feature)))
            assert to_bytes(tuple(StoredFeatures(model).from_plain(stored).at(data))) == to_bytes(tuple(feature.at(data)))


@pytest.mark.parametrize("order", [True, False])
def test_the_velocity_of_the_contact_over_both_bodies(tmp_path, rng, order):
    """The acceleration of the pair is the derivative of the slip at the moving contact: differences over 1e-4 s, order 2."""
    (pair,), model, data = pairs_in_cone(tmp_path, shape("sphere"), order)
    near = touch(pair, model, data, rng, 0.5)
    # The gap neither opens nor closes: its middle is the contact point of both surfaces to second order.
    data.qvel[6:9] -= (1.0 if order else -1.0) * near.rate * near.normal
    moved(model, data)
    near = pair.proximity(model, data)
    assert near.rate == pytest.approx(0.0, abs=1e-14)
    data.qacc[:] = rng.uniform(-1, 1, model.nv)
    found = pair.second_rate(model, data, near, near.points[0]).acceleration
    start, velocity, step = data.qpos.copy(), data.qvel.copy(), 1e-4

    def relative(time):
        data.qpos[:], data.qvel[:] = start, velocity + time * data.qacc
        mujoco.mj_integratePos(model, data.qpos, velocity + 0.5 * time * data.qacc, time)
        moved(model, data)
        return np.array([pair.rate_along(data, axis, pair.proximity(model, data).points[0]) for axis in np.eye(3)])

    assert (relative(step) - relative(-step)) / (2 * step) == pytest.approx(found, abs=1e-6)


def test_a_body_behind_the_surface_is_apart(tmp_path):
    """Beside the funnel, beyond the mouth and before the throat nothing is near; the gap is continuous in front of it."""
    (pair,), model, data = pairs_in_cone(tmp_path, shape("sphere"), True)
    data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    data.qpos[10:14] = [1, 0, 0, 0]
    axis, apex = np.array(CONE.direction), np.array(CONE.apex_m)
    geom = model.geom("other/g")
    across = np.linalg.svd(axis[None])[2][1]
    mouth = 2.0 * math.tan(math.radians(35.0))

    def gap(height, distance):
        data.qpos[7:10] = apex + height * axis + distance * across
        mujoco.mj_forward(model, data)
        data.qpos[7:10] += data.qpos[7:10] - data.geom_xpos[geom.id]
        mujoco.mj_forward(model, data)
        return pair.gap(model, data, 10.0)

    radius = pair._contact.radius
    for height, distance in ((1.0, 1.5), (2.5, 2.0), (-1.0, 0.1), (0.2, 0.3)):
        assert gap(height, distance) > 0.0
    assert gap(3.0, 0.0) == pytest.approx(math.hypot(1.0, mouth) - radius, abs=1e-12)
    assert gap(1.0, 0.0) == pytest.approx(math.sin(math.radians(35.0)) - radius, abs=1e-12)
    line = np.array([gap(2.0 + d, mouth - 1.3 * radius) for d in np.linspace(-0.1, 0.5, 601)])
    assert line.min() < -0.01
    assert np.abs(np.diff(line)).max() <= 1.001e-3


def tilted(data, turn):
    """A cylinder across the cone, turned about its axis: one of two minima of a rim is lower, to one side."""
    axis = np.array(CONE.direction)
    u, v = np.linalg.svd(axis[None])[2][1:]
    along = math.cos(turn) * u + math.sin(turn) * v
    matrix = np.column_stack((np.cross(axis, along), axis, along))
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.linalg.det(matrix) * matrix.ravel())
    data.qpos[:7], data.qpos[10:14] = [0, 0, 0, 1, 0, 0, 0], quaternion
    data.qpos[7:10] = CONE.apex_m + 1.2 * axis + 0.01 * v


DISC = shape("cylinder").replace(SHAPES["cylinder"], 'type="cylinder" size="0.3 0.02"')


def test_minima_keep_their_pairs_and_need_their_state(tmp_path):
    """Turned half round by small steps, each pair is where the other one was; of new ones the first is the lower."""
    made = [pairs_in_cone(tmp_path, DISC, True) for _ in range(2)]
    (pairs, model, data), (others, *_) = made

    def places(which):
        return [pair._place(data) for pair in which[2:]]

    for turn in np.linspace(0.0, math.pi, 101):
        tilted(data, turn)
        mujoco.mj_forward(model, data)
        one, other = places(pairs)
    assert np.linalg.norm(one - other) > 0.05
    state = pairs[2].get_state()
    assert np.array(places(others)) == pytest.approx(np.array([other, one]), abs=1e-12)
    for kind, field in ((RoundConePair, "generators"), (NearestGenerators, "angles")):
        fresh = pairs_in_cone(tmp_path, DISC, True)[0]
        with forgetting(kind, field):
            fresh[2].set_state(state)
        assert np.array(places(fresh)) == pytest.approx(np.array([other, one]), abs=1e-12)
        fresh[2].set_state(state)
        assert np.array(places(fresh)).tobytes() == np.array([one, other]).tobytes()
    # A replay tells them by a logged point; one that no log of a run has changes nothing.
    for pair, point in ((others[2], one), (others[3], other), (others[3], np.full(3, np.nan)), (others[2], np.zeros(2))):
        pair.recall(data, point)
        assert np.array(places(others)) == pytest.approx(np.array([one, other]), abs=1e-12)


def test_the_angle_of_a_feature(tmp_path, rng):
    """The next generator is searched from it: to rounding, not to the last bit, does it matter where."""
    differ = 0
    for kind in ("cylinder", "ellipsoid"):
        (pair, *_), model, data = pairs_in_cone(tmp_path, shape(kind), True)
        for _ in range(5):
            near = settle(pair, model, data, rng)
            start, velocity = data.qpos.copy(), data.qvel.copy()
            (feature,) = features(pair, model, data, near)
            evaluated(feature, model, data, start, velocity)
            stored = to_bytes(StoredFeatures(model).to_plain(feature))
            expected = evaluated(feature, model, data, start, velocity)
            assert evaluated(StoredFeatures(model).from_plain(from_bytes(stored)), model, data, start, velocity) == expected
            with forgetting(RoundOnCone, "angle"):
                again = StoredFeatures(model).from_plain(from_bytes(stored))
            differ += evaluated(again, model, data, start, velocity) != expected
    assert differ


def test_a_gap_falls_no_faster_than_its_bound(tmp_path):
    """Also where a minimum comes or goes: both pairs have the least distance of the rim. Bounds change by 2 % in a step."""
    pairs, model, data = pairs_in_cone(tmp_path, shape("cylinder"), True)
    tilted(data, 0.4)
    data.qvel[:] = [0, 0, 0, 0, 0, 0, 0.05, -0.1, 0.02, 2.0, 1.5, -1.0]
    gaps, bounds, absent, step = [], [], [], 1e-3
    for _ in range(600):
        mujoco.mj_integratePos(model, data.qpos, data.qvel, step)
        moved(model, data)
        gaps.append([pair.gap(model, data, 10.0) for pair in pairs])
        absent.append([pair._place(data) is None for pair in pairs])
        bounds.append([pair.closing_speed_bound(data) for pair in pairs])
    assert (np.diff(np.array(absent).astype(int), axis=0) < 0).any()  # one appears
    assert (np.diff(gaps, axis=0) >= -1.02 * step * np.array(bounds[1:])).all()
