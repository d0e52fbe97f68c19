"""Second rate of the gap of every pair of shapes, against differences of the gap rate along the motion."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.contact_models.impact.rest_rule import RestRule, resolve_resting
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.impact import Contact, resolve
from tests.contact.test_geometry import PAIRS, shape
from tests.scenes import scene

_STEP = 1e-5


def quaternion(rng):
    q = rng.normal(size=4)
    return (q / np.linalg.norm(q)).tolist()


def close_pair(folder, a, b, rng):
    """Two tumbling shapes at a gap of 1e-9 m, with forces on both: (pair, model, data)."""
    path = scene(
        folder,
        shape(a),
        {"other": shape(b)},
        initial={
            "joints": {
                "robot/free": [0, 0, 0, *quaternion(rng)],
                "other/free": [1.0, *rng.uniform(-0.1, 0.1, 2).tolist(), *quaternion(rng)],
            },
            "rates": {key: rng.uniform(-1, 1, 6).tolist() for key in ("robot/free", "other/free")},
        },
        contacts={"rules": [{"between": ["robot/g", "other/g"]}]},
    )
    assembly = prepare(path).assemble()
    (pair,), model, data = assembly.pairs, assembly.system.mj, assembly.data
    approach = np.array([-1.0, 0.0, 0.0])  # always along one line, so that corners meet faces and edges, not corners
    for _ in range(60):
        near = pair.proximity(model, data)
        if abs(near.gap - 1e-9) < 1e-11:
            break
        data.qpos[7:10] += approach * (near.gap - 1e-9) / max(0.2, -near.normal @ approach)
        mujoco.mj_forward(model, data)
    else:
        pytest.fail("the shapes were not brought together")
    data.qfrc_applied[:] = rng.uniform(-1, 1, 12)
    mujoco.mj_forward(model, data)
    return pair, model, data


@pytest.mark.long
@pytest.mark.parametrize(("a", "b"), PAIRS)
def test_second_rate_is_the_derivative_of_the_rate(tmp_path, rng, a, b):
    """Fourth-order differences over 1e-5 s: the rounding is 1e-16 / 1e-5 = 1e-11 of the rate, and h^4 is less."""
    pair, model, data = close_pair(tmp_path, a, b, rng)
    near = pair.proximity(model, data)
    found = pair.second_rate(model, data, near, near.points[0])
    qpos, qvel, forces = data.qpos.copy(), data.qvel.copy(), data.qfrc_applied.copy()

    def rate(time):
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = qpos, qvel, forces
        data.qvel[:] *= np.sign(time)  # backwards: the reversed motion under the same forces
        model.opt.timestep = abs(time)
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        return float(np.sign(time)) * pair.proximity(model, data).rate

    near_by, further = (rate(h) - rate(-h) for h in (_STEP, 2 * _STEP))
    slope = (8.0 * near_by - further) / (12.0 * _STEP)
    assert found.value == pytest.approx(slope, abs=1e-8 * (1.0 + found.scale))


def test_pressing_acceleration_follows_from_a_plastic_impact(tmp_path, rng):
    """The acceleration b is -gap'' at the velocities after a plastic impact under the current efforts."""
    pressed = 0
    for _ in range(12):
        pair, model, data = close_pair(tmp_path, "capsule", "ellipsoid", rng)
        motion, forces = Motion(model, data), data.qfrc_applied.copy()
        motion.push_with([lambda pushed, forces=forces: np.add(pushed.qfrc_applied, forces, out=pushed.qfrc_applied)])
        near = pair.proximity(model, data)
        data.qvel[:] *= -0.4 * np.sign(near.rate)  # it approaches, and the forces count
        mujoco.mj_forward(model, data)
        near = pair.proximity(model, data)
        before = pair.second_rate(model, data, near, near.points[0]).value
        impact = resolve(model, data, [Contact(pair.body_a, pair.body_b, near.points[0], near.normal, 0.0)])
        met = resolve_resting(model, data, [(pair, near)], RestRule(1e-3, 0.0), lambda _, impact=impact: impact, motion)
        data.qvel[:] = impact.after.qvel
        mujoco.mj_forward(model, data)
        after = pair.second_rate(model, data, near, near.points[0]).value
        assert abs(before - after) > 1e-3
        assert (met.used[0] == 0.0) == (after < 0.0)
        assert met.pressing[0] == pytest.approx(max(0.0, -after), rel=1e-9)
        pressed += int(after < 0.0)
    assert pressed >= 3  # half of them, but for chance
