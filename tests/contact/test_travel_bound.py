"""Bounds on the closing of two geoms by joint motion: valid for every configuration and velocity, and attained."""

from __future__ import annotations

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from ffsm_mj.contact.motion_bound import MotionBound, TravelBound

CHAIN = """<mujoco><compiler angle="radian"/><worldbody>
<body name="base"><freejoint name="free"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
  <geom name="base" type="box" size="0.2 0.1 0.3" pos="0.1 0 0"/>
  <body name="arm" pos="0.3 0.1 0"><joint name="turn" axis="1 2 3" pos="0.05 0.1 0"/>
    <geom name="arm" type="capsule" fromto="0 0 0 0.4 0 0.1" size="0.03"/>
    <body name="rail" pos="0.2 0 0.4" quat="1 0.4 0 0.2"><joint name="rail" type="slide" axis="0 1 1" pos="0.1 0 0"/>
      <joint name="roll" axis="1 0 0" pos="0 0.2 0.1"/><geom name="rail" size="0.05" pos="0 0 0.1"/>
      <body name="wrist" pos="0.1 0.1 0.1"><joint name="wrist" type="ball" pos="0.02 0 0.03"/>
        <geom name="hand" type="ellipsoid" size="0.05 0.1 0.02" pos="0.1 0 0"/></body></body></body></body>
<body name="rock" pos="2 0 0"><freejoint name="rock"/><geom name="rock" type="cylinder" size="0.2 0.1" pos="0 0.3 0"/></body>
</worldbody></mujoco>"""
PAIRS = (("hand", "rock"), ("base", "rock"), ("base", "hand"), ("arm", "rail"), ("arm", "hand"))


def relative_speed(model, data, geoms, rng):
    """Fastest closing of points of two geoms, m/s: points on their bounding spheres, fixed to their bodies."""
    velocities, points = [], []
    for geom in geoms:
        body, twist = int(model.geom_bodyid[geom]), np.empty(6)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, body, twist, 0)
        outward = rng.normal(size=(40, 3))
        at = data.geom_xpos[geom] + model.geom_rbound[geom] * outward / np.linalg.norm(outward, axis=1, keepdims=True)
        points.append(at)
        velocities.append(twist[3:] + np.cross(twist[:3], at - data.xpos[body]))
    apart = points[1][None] - points[0][:, None]
    apart /= np.linalg.norm(apart, axis=2, keepdims=True)
    return float(np.abs(np.einsum("ijk,ijk->ij", apart, velocities[1][None] - velocities[0][:, None])).max())


def spheres(model, ids):
    """Pairs of geoms with their bounding spheres."""
    return [SimpleNamespace(ids=pair, radii=tuple(float(model.geom_rbound[geom]) for geom in pair)) for pair in ids]


def test_no_point_of_a_pair_closes_faster_than_its_bound(rng):
    model = mujoco.MjModel.from_xml_string(CHAIN)
    data, slide = mujoco.MjData(model), int(model.joint("rail").qposadr[0])
    ids = [tuple(model.geom(name).id for name in pair) for pair in PAIRS]
    bound = TravelBound(model, data.qpos, spheres(model, ids))
    assert bound.slides.tolist() == [int(model.joint("rail").dofadr[0])]
    largest = np.zeros(len(PAIRS))
    for _ in range(400):
        mujoco.mj_resetData(model, data)
        mujoco.mj_integratePos(model, data.qpos, rng.uniform(-3, 3, model.nv), 1.0)
        data.qpos[slide] = rng.uniform(-0.5, 0.5)  # as far as the bounds hold
        one = np.zeros(model.nv)  # one degree of freedom at a time comes nearer to its bound than all together
        one[rng.integers(model.nv)] = 1.0
        data.qvel[:] = one if rng.random() < 0.5 else rng.normal(size=model.nv)
        mujoco.mj_forward(model, data)
        allowed = bound.rows @ np.abs(data.qvel)
        for i, pair in enumerate(ids):
            speed = relative_speed(model, data, pair, rng)
            assert speed <= allowed[i] * (1.0 + 1e-12) + 1e-14, PAIRS[i]
            largest[i] = max(largest[i], speed / allowed[i] if allowed[i] else 0.0)
    assert largest.min() > 0.3, "the bounds say nothing"


def test_the_bound_of_a_slide_beyond_a_hinge_ends_and_is_computed_again():
    model = mujoco.MjModel.from_xml_string(CHAIN)
    data, hand = mujoco.MjData(model), [(model.geom("hand").id, model.geom("rock").id)]
    turn = int(model.joint("turn").dofadr[0])
    near = TravelBound(model, data.qpos, spheres(model, hand))
    data.qpos[model.joint("rail").qposadr[0]] = 2.0
    assert near.slide_allowance(data.qpos) == pytest.approx([-1.5])
    far = TravelBound(model, data.qpos, spheres(model, hand))
    assert far.slide_allowance(data.qpos) == pytest.approx([0.5])
    assert far.rows[0, turn] == pytest.approx(near.rows[0, turn] + 2.0)


def test_joints_that_move_both_geoms_do_not_count():
    model = mujoco.MjModel.from_xml_string(CHAIN)
    bound = TravelBound(model, np.zeros(model.nq), spheres(model, [(model.geom("arm").id, model.geom("hand").id)]))
    moving = np.flatnonzero(bound.rows[0])
    first = int(model.joint("rail").dofadr[0])
    assert moving.tolist() == list(range(first, first + 5))  # rail, roll and the ball of the wrist


ROUND = {"sphere": "0.2", "capsule": "0.05 0.3", "cylinder": "0.2 0.05", "box": "0.1 0.2 0.3"}


@pytest.mark.parametrize("kind", ROUND)
def test_no_gap_closes_faster_than_the_bound_of_the_present_motion(kind):
    """Distances a moment later, for spins that are mostly about the z axis of the geom, its axis of symmetry if it has one.

    Over 1e-6 s, second rates of some 1e3 m/s^2 leave 1e-3 m/s. Of round geoms nothing counts but the velocity of the middle
    and the turning of the axis: the bound is nearly reached.
    """
    rng, step, nearest = np.random.default_rng(5), 1e-6, 0.0
    bodies = "".join(
        f'<body name="{name}"><freejoint/><geom name="{name}" type="{shape}" size="{size}"/></body>'
        for name, shape, size in (("a", kind, ROUND[kind]), ("b", "sphere", "0.1"))
    )
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    data, bound, fromto = mujoco.MjData(model), MotionBound(model, (0, 1)), np.zeros(6)
    for _ in range(200):
        away = rng.normal(size=3)
        data.qpos[3:7], data.qpos[7:10] = rng.normal(size=4), 0.6 * away / np.linalg.norm(away)
        mujoco.mj_normalizeQuat(model, data.qpos)
        data.qvel[:] = rng.normal(size=12) * (1.0, 1.0, 1.0, 3.0, 3.0, 30.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0)
        mujoco.mj_forward(model, data)
        before, limit = mujoco.mj_geomDistance(model, data, 0, 1, 1.0, fromto), bound.closing_speed(data) / 1.1
        mujoco.mj_integratePos(model, data.qpos, data.qvel, step)
        mujoco.mj_forward(model, data)
        closing = (before - mujoco.mj_geomDistance(model, data, 0, 1, 1.0, fromto)) / step
        assert closing <= limit + 1e-3
        nearest = max(nearest, closing / limit)
    assert nearest > 0.7


@pytest.mark.parametrize("kind", ["sphere", "capsule", "cylinder"])
def test_turning_about_an_axis_of_symmetry_closes_no_gap(kind):
    body = f'<body><freejoint/><geom type="{kind}" size="{ROUND[kind]}" euler="90 0 0"/></body>'
    still = '<body pos="0 0 1"><geom type="box" size="1 1 0.1"/></body>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{body}{still}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    data.qvel[:] = (1.0, 2.0, 2.0, 0.0, 50.0, 0.0)  # the z axis of the geom is -y of its body
    mujoco.mj_forward(model, data)
    # 3 m/s; an axis that is turned by rounding of 1e-16 moves by 50 times that.
    assert MotionBound(model, (0, 1)).closing_speed(data) == pytest.approx(1.1 * 3.0, rel=1e-13)
