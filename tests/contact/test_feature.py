"""Frozen contact features: exact along the motion, the pair's own gap where they hold, smooth beyond their bounds."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_mj.contact.feature import features
from ffsm_mj.contact.pairs import ContactPair
from tests.contact.test_geometry import SHAPES, shape
from tests.scenes import compile_paths

_STEP = 1e-4


def bodies(folder, robot, other):
    """(pair, model, data) of the geoms g of two models."""
    (folder / "robot.xml").write_text(robot)
    (folder / "other.xml").write_text(other)
    system = compile_paths(folder / "robot.xml", {"other": folder / "other.xml"})
    return ContactPair(system, "pair", "robot/g", "other/g", 0.5), system.mj, mujoco.MjData(system.mj)


def touching(pair, model, data, rng):
    """Turn both bodies at random and bring them together to rounding; returns the proximity."""
    quaternions = rng.normal(size=(2, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1)[:, None]
    data.qpos[:] = [0, 0, 0, *quaternions[0], 1, *rng.uniform(-0.1, 0.1, 2), *quaternions[1]]
    data.qvel[:] = rng.uniform(-1, 1, model.nv)
    for _ in range(60):
        mujoco.mj_forward(model, data)
        near = pair.proximity(model, data)
        if abs(near.gap) < 1e-13:
            return near
        data.qpos[7] -= near.gap / max(0.2, near.normal[0])
    pytest.fail("the shapes were not brought together")


def acceleration(model, data, body, point):
    jacobian, rate = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_jac(model, data, jacobian, None, point, body)
    mujoco.mj_jacDot(model, data, rate, None, point, body)
    return jacobian @ data.qacc + rate @ data.qvel


def second_rate(pair, model, data, held):
    here = acceleration(model, data, pair.body_a, held.point_a)
    there = acceleration(model, data, pair.body_b, held.point_b)
    return float(held.normal @ (there - here)) + held.bend


def derivatives(model, data, feature):
    """Rate and second rate of the frozen gap along the motion with the accelerations in ``data``, and their errors.

    By differences of order 4; over twice the time the error is 16 times as large.
    """
    start, velocity = data.qpos.copy(), data.qvel.copy()

    def at(time):
        data.qpos[:], data.qvel[:] = start, velocity + time * data.qacc
        mujoco.mj_integratePos(model, data.qpos, velocity + 0.5 * time * data.qacc, time)
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        return np.array(feature.at(data)[:2])

    first, second, fourth = ((at(k * _STEP) - at(-k * _STEP)) / (2.0 * k * _STEP) for k in (1, 2, 4))
    at(0.0)
    found = (4.0 * first - second) / 3.0
    return found, np.abs((4.0 * second - fourth) / 3.0 - found)


HOLD = [(a, b) for a in SHAPES for b in SHAPES if not {a, b} <= {"cylinder", "ellipsoid"}]


@pytest.mark.parametrize(("a", "b"), HOLD)
def test_gap_rate_and_second_rate_are_exact(tmp_path, rng, a, b):
    """Rounding of the differences is 1e-16 / h, 1e-12: 1e-9 of the terms leaves room; their own error counts where more.

    Against the second rate of the pair itself both are closed forms: 1e-12 of the terms.
    """
    pair, model, data = bodies(tmp_path, shape(a), shape(b))
    for _ in range(8):
        near = touching(pair, model, data, rng)
        data.qacc[:] = rng.uniform(-1, 1, model.nv)
        expected = pair.second_rate(model, data, near, near.points[0])
        (feature,) = features(pair, model, data, near)
        held = feature.at(data)
        assert held.gap == pytest.approx(near.gap, abs=1e-14)
        assert held.rate == pytest.approx(near.rate, abs=1e-12)
        np.testing.assert_allclose(held.point, near.points[0], rtol=0, atol=1e-12)
        np.testing.assert_allclose(held.normal, near.normal, rtol=0, atol=1e-12)
        assert held.inside >= -1e-12
        found = second_rate(pair, model, data, held)
        assert found == pytest.approx(expected.value, abs=1e-12 * (1.0 + expected.scale))
        (rate, second), error = derivatives(model, data, feature)
        assert held.rate == pytest.approx(rate, abs=1e-9 + error[0])
        assert found == pytest.approx(second, abs=1e-9 * (1.0 + held.scale) + error[1])
