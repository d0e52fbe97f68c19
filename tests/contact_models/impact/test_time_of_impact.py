"""Time and state of an impact within a step: closed forms, grid points, several impacts, grazes, thin plates."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj._core.steppers import WHOLE_STATE
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.dynamics.step_path import StepPath
from tests.scenes import ball, box, scene, two_balls


@pytest.mark.parametrize("step", [0.001, 0.01])
@pytest.mark.parametrize("speed", [0.3, 7.7, 240.0])
def test_two_balls_meet_at_the_closed_form_time(tmp_path, speed, step):
    """Time = gap / speed. The clock resolves 1e-16 relative, the root is found to 1e-14 m."""
    run = ffsm_mj.run(two_balls(tmp_path, speed=speed, duration_s=1.2, time_step_s=step, control_period_s=step))
    (impact,) = run.impacts
    assert impact.time_s == pytest.approx(0.3 / speed, abs=1e-13)
    assert abs(impact.gap_m) < 1e-9
    # 2 kg on 3 kg, elastic: (m1 - m2)/(m1 + m2), 2 m1/(m1 + m2).
    assert impact.qvel_after["robot/x"][0] == pytest.approx(-0.2 * speed, rel=1e-13)
    assert impact.qvel_after["target/x"][0] == pytest.approx(0.8 * speed, rel=1e-13)


def test_impact_on_a_grid_point(tmp_path):
    """0.25 m at 0.5 m/s: exactly at the end of a step, once."""
    run = ffsm_mj.run(two_balls(tmp_path, speed=0.5, gap=0.25, duration_s=1.0, time_step_s=0.125, control_period_s=0.125))
    (impact,) = run.impacts
    assert impact.time_s == pytest.approx(0.5, abs=1e-12)


def test_touching_and_approaching_at_the_start(tmp_path):
    """An impact at t = 0 precedes any motion; the first row is the state before it."""
    run = ffsm_mj.run(two_balls(tmp_path, gap=0.0, duration_s=0.1))
    (impact,) = run.impacts
    assert impact.time_s == 0.0
    assert run["state.v_robot_x_m_s"][0] == 1.0
    assert run["state.v_target_x_m_s"][-1] == pytest.approx(0.8, rel=1e-14)
    assert all(check.passes for check in all_checks(run, 1e-13))


def test_touching_and_separating_is_no_impact(tmp_path):
    run = ffsm_mj.run(two_balls(tmp_path, gap=0.0, speed=-1.0, duration_s=0.1))
    assert run.impacts == ()


def test_two_impacts_in_one_step(tmp_path):
    """A ball between two that approach from both sides: hit twice within one 10 ms step, each at its own time."""
    path = scene(
        tmp_path,
        ball("ball", mass=1.0, joints="x"),
        {"left": ball("left", mass=1.0, joints="x"), "right": ball("right", mass=1.0, joints="x")},
        duration_s=0.02,
        time_step_s=0.01,
        control_period_s=0.01,
        initial={"joints": {"left/x": -0.202, "right/x": 0.205}, "rates": {"left/x": 1.0, "right/x": -1.0}},
        contacts={
            "rules": [
                {"between": ["robot/ball", "left/left"]},
                {"between": ["robot/ball", "right/right"]},
            ]
        },
    )
    run = ffsm_mj.run(path)
    # Equal masses exchange velocities: at 2 ms the middle one takes off at 1 m/s and meets the right one at 3.5 ms.
    assert [impact.time_s for impact in run.impacts[:2]] == pytest.approx([0.002, 0.0035], abs=1e-13)
    assert [impact.object_geom for impact in run.impacts[:2]] == ["left/left", "right/right"]
    assert [impact.event for impact in run.impacts[:2]] == [0, 1]
    assert all(check.passes for check in all_checks(run, 1e-13))


@pytest.mark.parametrize(("offset", "hits"), [(0.2 - 1e-6, 1), (0.2 + 1e-9, 0), (0.2 + 1e-6, 0)])
def test_a_graze_is_neither_missed_nor_invented(tmp_path, offset, hits):
    """A ball that passes another at almost the sum of the radii, both inside one step."""
    path = scene(
        tmp_path,
        ball("ball", joints="xy"),
        {"target": ball("target", joints="xy")},
        duration_s=0.4,
        time_step_s=0.02,
        control_period_s=0.02,
        initial={"joints": {"target/x": 1.003, "target/y": offset}, "rates": {"robot/x": 5.0}},
        contacts={"rules": [{"between": ["ball", "target/target"]}]},
    )
    run = ffsm_mj.run(path)
    assert len(run.impacts) == hits
    if hits:
        # Touch where the centres are 0.2 m apart.
        assert run.impacts[0].time_s == pytest.approx((1.003 - np.sqrt(0.2**2 - offset**2)) / 5.0, abs=1e-12)


@pytest.mark.parametrize("speed", [10.0, 100.0, 1000.0])
@pytest.mark.parametrize("step", [0.001, 0.01])
def test_no_tunnelling_through_a_thin_plate(tmp_path, speed, step):
    """A 20 mm ball and a 1 mm plate: at 1000 m/s a 10 ms step covers ten metres."""
    path = scene(
        tmp_path,
        ball("ball", radius=0.01, joints="x"),
        {"plate": box("plate", mass=100.0, half=(0.0005, 0.3, 0.3))},
        duration_s=max(step, round(2.0 / speed / step) * step),
        time_step_s=step,
        control_period_s=step,
        initial={"joints": {"plate/free": [1.0105, 0.01, -0.02, 1, 0, 0, 0]}, "rates": {"robot/x": speed}},
        contacts={"rules": [{"between": ["ball", "plate/plate"]}]},
    )
    run = ffsm_mj.run(path)
    (impact,) = run.impacts
    assert impact.time_s == pytest.approx(1.0 / speed, abs=1e-12)


def test_oblique_impact_on_a_spinning_rotated_box(tmp_path):
    """Sign errors do not show for a resting, aligned object: here everything turns, and the balance holds."""
    turn = np.array([np.cos(0.4), 0.2, -0.3, np.sqrt(1 - np.cos(0.4) ** 2 - 0.13)])
    path = scene(
        tmp_path,
        ball("ball", mass=0.7),
        {"block": box("block", mass=1.3, half=(0.3, 0.2, 0.1))},
        duration_s=0.6,  # the spinning block hits back at 0.625 s
        initial={
            "joints": {"block/free": [1.0, 0.07, -0.05, *turn.tolist()]},
            "rates": {
                "robot/free": [1.5, 0.1, 0.05, 0.3, -0.7, 0.2],
                "block/free": [-0.2, 0.03, 0.02, 0.9, -1.1, 0.8],
            },
        },
        contacts={"rules": [{"between": ["ball", "block/block"], "restitution": 0.6}]},
    )
    run = ffsm_mj.run(path)
    (impact,) = run.impacts
    assert impact.separation_speed_m_s == pytest.approx(0.6 * impact.approach_speed_m_s, rel=1e-12)
    assert impact.energy_change_J < 0.0
    assert np.ptp([abs(c) for c in impact.normal]) > 0.05  # oblique indeed
    # Independent geometry: the contact is the point of the box nearest to the ball's centre, the normal leads there.
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, np.array(impact.qpos[10:14]))
    rotation = rotation.reshape(3, 3)
    centre, position = np.array(impact.qpos[:3]), np.array(impact.qpos[7:10])
    nearest = position + rotation @ np.clip(rotation.T @ (centre - position), (-0.3, -0.2, -0.1), (0.3, 0.2, 0.1))
    np.testing.assert_allclose(impact.point_m, nearest, rtol=0, atol=1e-12)
    np.testing.assert_allclose(impact.normal, (nearest - centre) / 0.1, rtol=0, atol=1e-12)
    # RK4 at 1 ms and 1 rad/s leaves about (1e-3)^4 per second.
    assert all(check.passes for check in all_checks(run, 1e-11))


def test_time_step_survives_an_exception(case_study):
    """A Ctrl-C during event localisation leaves the time step of the model unchanged."""
    data = mujoco.MjData(case_study.mj)
    path = StepPath(case_study.mj, data)
    mujoco.mj_getState(case_study.mj, data, path.start, WHOLE_STATE)
    data.ctrl = np.zeros(case_study.mj.nu)

    def interrupt(*_):
        raise KeyboardInterrupt

    mujoco.set_mjcb_control(interrupt)
    try:
        with pytest.raises(KeyboardInterrupt):
            path.move_to(1e-5)
    finally:
        mujoco.set_mjcb_control(None)
    assert case_study.mj.opt.timestep == 1e-3


@pytest.mark.parametrize("step", [0.01, 0.005, 0.002, 0.001])
def test_coasting_impact_does_not_depend_on_the_step(coasting_reference, step):
    """RK4 at 10 ms leaves 1e-11 over these 5 s; event localisation adds nothing."""
    run = ffsm_mj.run("coasting", {"time_step_s": step})
    (impact,) = run.impacts
    assert impact.time_s == pytest.approx(coasting_reference.time_s, abs=1e-9)
    for joint, rate in impact.qvel_after.items():
        assert rate[0] == pytest.approx(coasting_reference.qvel_after[joint][0], abs=1e-9)


@pytest.fixture(scope="module")
def coasting_reference():
    return ffsm_mj.run("coasting", {"time_step_s": 0.0005}).impacts[0]
