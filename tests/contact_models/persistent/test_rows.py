"""Rows of contact points are what differences along the motion say, for points of a face together and for single points."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_mj._core.row_evaluator import RowEvaluator
from ffsm_mj.contact.features.search import features
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from ffsm_mj.dynamics.motion import Motion
from tests.contact.features.test_gap_functions import CHAIN, in_contact, moved, pair_of, slip
from tests.contact.test_geometry import shape
from tests.scenes import HEAD

_STEP = 1e-4
PLATE, BOX = (0.3, 0.35, 0.05), (0.1, 0.15, 0.2)
"""Half sizes."""


def face_to_face(folder, rng, own, other):
    """A box at the end of a chain, face to face along its z axis with one that floats; (pair, model, data, features)."""

    def geom(half):
        return f'type="box" size="{half[0]} {half[1]} {half[2]}"'

    floating = f"""<mujoco>{HEAD}<worldbody><body name="b"><freejoint name="free"/><geom name="g" {geom(other)} mass="0"/>
      <inertial pos="0.1 0 0" mass="1" diaginertia="0.1 0.2 0.1"/></body></worldbody></mujoco>"""
    pair, model, data = pair_of(folder, CHAIN.format(head=HEAD, geom=geom(own)), floating)
    mujoco.mj_integratePos(model, data.qpos, rng.uniform(-1, 1, model.nv), 1.0)
    mujoco.mj_kinematics(model, data)
    at, start = data.geom("robot/g"), int(model.jnt_qposadr[model.body("other/b").jntadr[0]])
    data.qpos[start : start + 3] = at.xpos + at.xmat.reshape(3, 3) @ (0.05, 0.02, own[2] + other[2])
    mujoco.mju_mat2Quat(data.qpos[start + 3 : start + 7], at.xmat)
    data.qvel[:], data.qacc[:] = rng.uniform(-1, 1, (2, model.nv))
    moved(model, data)
    found = features(pair, model, data, pair.proximity(model, data))
    assert len(found) == 4
    return pair, model, data, found


def check(pair, model, data, found):
    """J qdot is gap rate and slip, and J qddot + gamma their rates, along tangents fixed in space.

    Differences of order 4 have a rounding of 1e-16 / h = 1e-12; 1e-9 of the fastest of the rates is allowed, and 1e-7 with
    contact points on rims, which are found to NEWTON_STEP / h = 1e-8.
    """
    pair.mu = 0.5
    accelerations, motion = data.qacc.copy(), Motion(model, data)
    contact_points = [ContactPoint(pair, feature) for feature in found]
    start, velocity = data.qpos.copy(), data.qvel.copy()

    def go_to(time):
        data.qpos[:], data.qvel[:] = start, velocity + time * accelerations
        mujoco.mj_integratePos(model, data.qpos, velocity + 0.5 * time * accelerations, time)
        moved(model, data)

    go_to(0.0)
    evaluator = RowEvaluator(motion, data, contact_points)
    here = evaluator.rows()
    J, gamma = here.J.reshape(-1, 3, model.nv), here.gamma.reshape(-1, 3)
    states = [feature.at(data) for feature in found]

    def velocities(time):
        """Gap rates, and slips along the tangents at the start."""
        go_to(time)
        at = [feature.at(data) for feature in found]
        slips = [axes[1:] @ slip(pair, data, state.point) for axes, state in zip(here.axes, at, strict=True)]
        return np.column_stack(([state.rate for state in at], slips))

    now = velocities(0.0)
    first, second, fourth = ((velocities(k * _STEP) - velocities(-k * _STEP)) / (2.0 * k * _STEP) for k in (1, 2, 4))
    go_to(0.0)
    expected, coarser = (4.0 * first - second) / 3.0, (4.0 * second - fourth) / 3.0
    allowed = 1e-7 * (1.0 + np.abs(expected).max()) if "rim" in found[0].name else 1e-9 * (1.0 + np.abs(expected).max())
    np.testing.assert_allclose(J @ velocity, now, rtol=0, atol=1e-13)
    np.testing.assert_array_less(np.abs(J @ accelerations + gamma - expected), allowed + np.abs(coarser - expected))
    np.testing.assert_allclose(
        here.axes @ here.axes.transpose(0, 2, 1), np.broadcast_to(np.eye(3), here.axes.shape), atol=1e-15
    )
    # All that a state tells agrees with the feature by itself.
    np.testing.assert_allclose(here.axes[:, 0], [state.normal for state in states], rtol=0, atol=1e-15)
    points = np.concatenate([group.points for group in here.groups])
    np.testing.assert_allclose(points, [state.point for state in states], rtol=0, atol=1e-14)
    for of_all, state in zip(here.states, states, strict=True):
        for value, own in zip(of_all, state, strict=True):
            np.testing.assert_allclose(value, own, rtol=1e-13, atol=1e-13)
    M = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    np.testing.assert_allclose(here.G, here.J @ np.linalg.solve(M, here.J.T), rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("halves", [(BOX, PLATE), (PLATE, BOX)])
def test_points_on_a_face_together(tmp_path, rng, halves):
    """The face may belong to either geom."""
    check(*face_to_face(tmp_path, rng, *halves))


@pytest.mark.parametrize(
    ("a", "b"),
    [
        ("sphere", "sphere"),
        ("box", "sphere"),
        ("capsule", "capsule"),
        ("box", "box"),
        ("box", "cylinder"),
        ("ellipsoid", "box"),
    ],
)
def test_single_points(tmp_path, rng, a, b):
    pair, model, data = pair_of(tmp_path, shape(a), shape(b))
    near = in_contact(pair, model, data, rng)
    data.qacc[:] = rng.uniform(-1, 1, model.nv)
    check(pair, model, data, features(pair, model, data, near))


def test_a_pair_without_friction_has_no_tangents(tmp_path, rng):
    pair, model, data, found = face_to_face(tmp_path, rng, BOX, PLATE)
    contact_points = [ContactPoint(pair, feature) for feature in found]
    motion = Motion(model, data)
    here = RowEvaluator(motion, data, contact_points).rows()
    for rows in (here.J, here.response, here.gamma, here.axes, here.G):
        assert not rows.reshape(4, 3, -1)[:, 1:].any()
    pair.mu = 0.5
    rubbing = RowEvaluator(motion, data, contact_points).rows()
    for name in ("J", "response", "gamma"):
        own, other = (getattr(each, name).reshape(4, 3, -1)[:, 0] for each in (here, rubbing))
        np.testing.assert_array_equal(own, other)
    np.testing.assert_array_equal(here.G[::3, ::3], rubbing.G[::3, ::3])
