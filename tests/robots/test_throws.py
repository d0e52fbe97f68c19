"""Objects thrown at published robots with every contact and limit of the default, judged without our contact pairs."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run import Run
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.replay import replay_log
from tests.robots.geom_distance import Distances
from tests.robots.published import ROBOTS
from tests.robots.throws import write_throw

DEEPEST_M = 1e-9
"""What the check *no penetration* allows, and *no joint past its limit* in rad or m."""


@pytest.mark.robots
@pytest.mark.long
@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("robot", ROBOTS)
def test_throws_at_a_robot(robot, seed, tmp_path):
    throw = write_throw(robot, seed, tmp_path)
    run = ffsm_mj.run(throw.path)
    assert run.outcome == "completed", run.message
    assert run.time[-1] == pytest.approx(20.0)
    assert run.impacts
    assert run.unhandled_contacts == ()
    assert [check for check in all_checks(run) if not check.passes] == []
    again = replay_log(run.log)
    assert again.agrees, (again.obstacle, again.worst)
    judge(run, prepare(throw.path).system.mj)


def judge(run: Run, model: mujoco.MjModel) -> None:
    """No overlap and no joint past its limit in any sample nor at any impact."""
    data, distances = mujoco.MjData(model), Distances(model)
    joints = np.flatnonzero(model.jnt_limited & (model.jnt_type >= int(mujoco.mjtJoint.mjJNT_SLIDE)))
    coordinates, (low, high) = model.jnt_qposadr[joints], model.jnt_range[joints].T
    assert len(joints)
    events = [
        (record.time_s, np.array(record.qpos)) for name in ("impacts", "limit_impacts") for record in run.records[name]
    ]
    near = 0
    for time_s, qpos in [*zip(run.time, run.qpos, strict=True), *events]:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        found = distances.deepest(data)
        near += found.near
        assert found.overlap_m <= DEEPEST_M, (time_s, found, [model.geom(geom).name for geom in found.pair])
        here = qpos[coordinates]
        assert (here >= low - DEEPEST_M).all(), (time_s, joints[here < low])
        assert (here <= high + DEEPEST_M).all(), (time_s, joints[here > high])
    assert near >= len(run.impacts)  # the check saw every pair that hit


GEOMS = {
    "sphere": ('size="0.1"', 0.1),
    "capsule": ('type="capsule" size="0.05 0.1"', 0.15),
    "cylinder": ('type="cylinder" size="0.1 0.15"', 0.15),
    "ellipsoid": ('type="ellipsoid" size="0.1 0.2 0.15"', 0.15),
    "box": ('type="box" size="0.1 0.2 0.15"', 0.15),
    "mesh": ('type="mesh" mesh="tip"', 0.15),
}
"""Geoms with their reach along z."""


@pytest.mark.parametrize("lower", GEOMS)
@pytest.mark.parametrize("upper", GEOMS)
def test_the_judge_sees_an_overlap_of_a_nanometre(lower, upper):
    """One geom above another, at a random pose in space: an overlap of 2e-9 m is seen, half a nanometre apart is none."""
    (below, height), (above, depth) = GEOMS[lower], GEOMS[upper]
    option = '<option ccd_tolerance="1e-12" ccd_iterations="200"/>'
    tip = '<mesh name="tip" vertex="0 0 0.15  0 0 -0.15  0.1 0 0  -0.1 0 0  0 0.1 0  0 -0.1 0"/>'
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>{option}<asset>{tip}</asset>
      <worldbody><body><freejoint/><geom {below}/></body><body><freejoint/><geom {above}/></body></worldbody></mujoco>""")
    data, distances = mujoco.MjData(model), Distances(model)
    turn, up = np.array([0.6, 0.3, -0.5, np.sqrt(0.3)]), np.zeros(3)
    for gap in (-2e-9, 5e-10):
        # A mesh stands off its vertices by their rounding to single precision.
        precise = not {"mesh"} & {lower, upper}
        mujoco.mju_rotVecQuat(up, np.array([0, 0, height + depth + gap * (1 if precise else 100)]), turn)
        data.qpos[:] = [0, 0, 0, *turn, *up, *turn]
        mujoco.mj_kinematics(model, data)
        found = distances.deepest(data)
        assert found.near == 1
        assert (found.overlap_m > DEEPEST_M) == (gap < 0.0)
