"""Gap functions of features: exact along the motion, equal to the gap of the pair in contact, smooth beyond their bounds."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.contact.features.search import features
from ffsm_mj.contact.pairs import ContactPair
from tests.contact.test_geometry import SHAPES, shape
from tests.scenes import HEAD, compile_paths, scene

_STEP = 1e-4
HOLD = [(a, b) for a in SHAPES for b in SHAPES]
FLAT = ("sphere", "capsule", "box")

CHAIN = """<mujoco>{head}<worldbody><body name="base"><freejoint name="free"/>
  <inertial pos="0.1 0 0" mass="2" diaginertia="0.2 0.1 0.3"/>
  <body name="arm" pos="0.1 0 0.1"><joint name="one" axis="0 0.6 0.8"/>
  <inertial pos="0 0.1 0" mass="1" diaginertia="0.1 0.1 0.1"/>
  <body name="hand" pos="0.2 0.1 0"><joint name="two" axis="1 0 0" pos="0 0.1 0"/>
  <inertial pos="0 0 0.1" mass="0.5" diaginertia="0.1 0.1 0.1"/>
  <geom name="g" {geom} pos="0.1 0.05 0" quat="0.8 0.6 0 0" mass="0"/></body></body></body></worldbody></mujoco>"""


def pair_of(folder, robot, other):
    """(pair, model, data) of the geoms g of two models."""
    (folder / "robot.xml").write_text(robot)
    (folder / "other.xml").write_text(other)
    system = compile_paths(folder / "robot.xml", {"other": folder / "other.xml"})
    return ContactPair(system, "pair", "robot/g", "other/g", 0.5), system.mj, mujoco.MjData(system.mj)


def turn_at_random(qpos, rng):
    qpos[:] = [0, 0, 0, *rng.normal(size=4)]
    qpos[3:] /= np.linalg.norm(qpos[3:])


def meet(pair, model, data, mover):
    """Move a free body along x until the pair is in contact to rounding; returns the proximity."""
    for _ in range(60):
        mujoco.mj_forward(model, data)
        near = pair.proximity(model, data)
        if abs(near.gap) < 1e-13:
            return near
        sign = 1.0 if mover else -1.0  # the first body is the robot's, and the normal points away from it
        data.qpos[mover] -= sign * near.gap / max(0.2, near.normal[0])
    pytest.fail("the shapes were not brought together")


def in_contact(pair, model, data, rng):
    """Turn two free bodies at random and bring them into contact."""
    turn_at_random(data.qpos[:7], rng)
    turn_at_random(data.qpos[7:], rng)
    data.qpos[7:10] = [1, *rng.uniform(-0.1, 0.1, 2)]
    data.qvel[:] = rng.uniform(-1, 1, model.nv)
    return meet(pair, model, data, 7)


def acceleration(model, data, body, point):
    jacobian, rate = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_jac(model, data, jacobian, None, point, body)
    mujoco.mj_jacDot(model, data, rate, None, point, body)
    return jacobian @ data.qacc + rate @ data.qvel


def second_rate(pair, model, data, state):
    here = acceleration(model, data, pair.body_a, state.point_a)
    there = acceleration(model, data, pair.body_b, state.point_b)
    return float(state.normal @ (there - here)) + state.bend


def moved(model, data):
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)


def turn_at_point(data, body, point):
    """Velocity of the material point of a body at a point, and the angular velocity of the body."""
    omega, linear = data.cvel[body, :3], data.cvel[body, 3:]
    return linear + np.cross(omega, point - data.subtree_com[data.model.body_rootid[body]]), omega


def slip(pair, data, point):
    """Velocity of b relative to a at a point."""
    return turn_at_point(data, pair.body_b, point)[0] - turn_at_point(data, pair.body_a, point)[0]


def slip_rate(pair, model, data, state):
    """Rate of the relative velocity at the contact point, which moves at ``point_rate``: a_b + omega_b x (c' - v_b) - ..."""
    rates = []
    for body in (pair.body_b, pair.body_a):
        velocity, omega = turn_at_point(data, body, state.point)
        rates.append(acceleration(model, data, body, state.point) + np.cross(omega, state.point_rate - velocity))
    return rates[0] - rates[1]


def derivatives(pair, model, data, feature):
    """Derivatives of gap, rate, contact point and slip along the motion with the accelerations in ``data``; their errors.

    Differences of order 4; over twice the time the error is 16 times as large.
    """
    start, velocity = data.qpos.copy(), data.qvel.copy()

    def at(time):
        data.qpos[:], data.qvel[:] = start, velocity + time * data.qacc
        mujoco.mj_integratePos(model, data.qpos, velocity + 0.5 * time * data.qacc, time)
        moved(model, data)
        state = feature.at(data)
        return np.concatenate((state[:2], state.point, slip(pair, data, state.point)))

    first, second, fourth = ((at(k * _STEP) - at(-k * _STEP)) / (2.0 * k * _STEP) for k in (1, 2, 4))
    at(0.0)
    found = (4.0 * first - second) / 3.0
    return found, np.abs((4.0 * second - fourth) / 3.0 - found)


def check_motion(pair, model, data, feature):
    """The rates are derivatives of the gap, and those of the contact point and the slip derivatives of theirs.

    The rounding of differences is 1e-16 / h = 1e-12, that of the places of points on rims and ellipsoids NEWTON_STEP / h =
    1e-8; 1e-9 and 1e-7 are allowed, of the fastest motion of the contact point.
    """
    state = feature.at(data)
    slip_rates = slip_rate(pair, model, data, state)
    (rate, second, *others), error = derivatives(pair, model, data, feature)
    fastest = 1.0 + np.abs(others).max()
    np.testing.assert_array_less(np.abs(others[:3] - np.array(state.point_rate)), 1e-7 * fastest + error[2:5])
    np.testing.assert_array_less(np.abs(others[3:] - slip_rates), 1e-7 * fastest + error[5:])
    assert state.rate == pytest.approx(rate, abs=1e-9 + error[0])
    found = second_rate(pair, model, data, state)
    assert found == pytest.approx(second, abs=1e-9 * (1.0 + state.scale) + error[1])
    return found


@pytest.mark.long
@pytest.mark.parametrize(("a", "b"), HOLD)
def test_a_feature_in_contact_has_the_gap_of_the_pair(tmp_path, rng, a, b):
    """Gap, normal, point, rate and second rate equal those of the pair; both are closed forms: 1e-12 of the terms."""
    pair, model, data = pair_of(tmp_path, shape(a), shape(b))
    for _ in range(6):
        near = in_contact(pair, model, data, rng)
        data.qacc[:] = rng.uniform(-1, 1, model.nv)
        expected = pair.second_rate(model, data, near, near.points[0])
        (feature,) = features(pair, model, data, near)
        state = feature.at(data)
        assert state.gap == pytest.approx(near.gap, abs=1e-14)
        assert state.rate == pytest.approx(near.rate, abs=1e-12)
        np.testing.assert_allclose(state.point, near.points[0], rtol=0, atol=1e-12)
        np.testing.assert_allclose(state.normal, near.normal, rtol=0, atol=1e-12)
        assert state.inside >= -1e-12
        found = check_motion(pair, model, data, feature)
        assert found == pytest.approx(expected.value, abs=1e-12 * (1.0 + expected.scale))
        data.qvel[:] *= 3.0
        moved(model, data)
        faster = feature.at(data)
        assert (faster.rate, faster.bend) == pytest.approx(
            (3.0 * state.rate, 9.0 * state.bend), abs=1e-12 * (1.0 + state.scale)
        )


@pytest.mark.long
@pytest.mark.parametrize(("a", "b"), HOLD)
def test_a_gap_function_is_smooth_beyond_its_bounds(tmp_path, rng, a, b):
    """The function stays the same after both bodies have moved and turned by far more than in a step, in contact or not."""
    pair, model, data = pair_of(tmp_path, shape(a), shape(b))
    outside = 0
    for _ in range(6):
        near = in_contact(pair, model, data, rng)
        (feature,) = features(pair, model, data, near)
        # Not deep into an ellipsoid: the nearest point of its surface is smooth to its radii of curvature only.
        data.qpos[7:10] += 0.03 * near.normal + rng.uniform(-0.03, 0.03, 3)
        mujoco.mj_integratePos(model, data.qpos, rng.uniform(-0.1, 0.1, 12), 1.0)
        data.qacc[:] = rng.uniform(-1, 1, model.nv)
        moved(model, data)
        outside += feature.at(data).inside < 0.0
        check_motion(pair, model, data, feature)
    assert outside or {a, b} & {"sphere", "ellipsoid"}  # else the test has not left a feature


@pytest.mark.parametrize("geom", ["sphere", "capsule", "box", "cylinder"])
@pytest.mark.parametrize("other", ["sphere", "capsule", "box"])
def test_features_of_a_chain_and_of_a_fixed_body(tmp_path, rng, geom, other):
    """Bodies of one tree share its centre of mass; a fixed body has no velocity and no acceleration."""
    robot = CHAIN.format(head=HEAD, geom=SHAPES[geom])
    still = shape(other).replace('<freejoint name="free"/>', "")
    pairs = [{"between": ["robot/g", name]} for name in ("other/g", "wall/g")]
    far = {"position_m": [6.0, 0.0, 0.0], "quaternion": [0.8, 0.0, 0.6, 0.0]}
    path = scene(tmp_path, robot, {"other": shape(other), "wall": still}, fixed={"wall": far}, contacts={"rules": pairs})
    assembly = prepare(path).assemble()
    model, data = assembly.system.mj, assembly.data
    for pair, mover in zip(assembly.pairs, (9, 0), strict=True):
        for _ in range(2):
            turn_at_random(data.qpos[:7], rng)
            data.qpos[7:9] = rng.uniform(-1, 1, 2)
            turn_at_random(data.qpos[9:], rng)
            data.qpos[9], data.qpos[0] = 2.0, 0.0 if mover else 4.0
            data.qvel[:] = rng.uniform(-1, 1, model.nv)
            mujoco.mj_kinematics(model, data)
            aside = np.subtract(*(data.geom(name).xpos for name in pair.geoms)) + rng.uniform(-0.05, 0.05, 3)
            data.qpos[mover + 1 : mover + 3] += (1.0 if mover else -1.0) * aside[1:]
            near = meet(pair, model, data, mover)
            data.qacc[:] = rng.uniform(-1, 1, model.nv)
            expected = pair.second_rate(model, data, near, near.points[0])
            (feature,) = features(pair, model, data, near)
            found = check_motion(pair, model, data, feature)
            assert found == pytest.approx(expected.value, abs=1e-11 * (1.0 + expected.scale))
            assert feature.at(data).rate == pytest.approx(near.rate, abs=1e-11)


@pytest.mark.long
@pytest.mark.parametrize(("a", "b"), [(a, b) for a in FLAT for b in FLAT])
def test_inside_its_bounds_the_gap_is_the_distance(tmp_path, rng, a, b):
    """Apart along the normal, MuJoCo's distance is exact for these shapes; 1e-12 m is rounding."""
    pair, model, data = pair_of(tmp_path, shape(a), shape(b))
    apart = 1e-3
    compared = 0
    for _ in range(12):
        near = in_contact(pair, model, data, rng)
        (feature,) = features(pair, model, data, near)
        data.qpos[7:10] += apart * near.normal + rng.uniform(-1e-4, 1e-4, 3)
        moved(model, data)
        state = feature.at(data)
        if state.inside > 2.0 * apart:  # of two sharp features another might be nearer by now
            compared += 1
            assert state.gap == pytest.approx(pair.gap(model, data, 1.0), abs=1e-12)
    assert compared > 4


@pytest.mark.parametrize(
    ("b", "name"), [("disc", "rim on rim"), ("capsule", "side on rim"), ("ellipsoid", "rim on ellipsoid")]
)
def test_gap_functions_of_rims(tmp_path, rng, b, name):
    """Thin discs meet others by their rims most often; the second rate equals that of the support functions, too."""
    disc = shape("cylinder").replace(SHAPES["cylinder"], 'type="cylinder" size="0.12 0.02"')
    pair, model, data = pair_of(tmp_path, disc, disc if b == "disc" else shape(b))
    found = 0
    for _ in range(20):
        near = in_contact(pair, model, data, rng)
        (feature,) = features(pair, model, data, near)
        if feature.name != name:
            continue
        found += 1
        data.qacc[:] = rng.uniform(-1, 1, model.nv)
        expected = pair.second_rate(model, data, near, near.points[0])
        assert check_motion(pair, model, data, feature) == pytest.approx(expected.value, abs=1e-11 * (1.0 + expected.scale))
        data.qpos[7:10] += 0.003 * near.normal
        moved(model, data)
        check_motion(pair, model, data, feature)
    assert found >= 4
