"""Servos at a limit of their force: impacts, turned and boosted scenes, changed logs, a load pushed from outside."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from ffsm_mj.cli.main import main
from tests.replays import assert_replayed
from tests.scenes import ball
from tests.servos.scenes import link, playing, run_link, steps
from tests.servos.test_servos import ANGLE, CLAMPED, HOLD, RATE, passes
from tests.verification.test_checks import written

FORCE = "actuators.robot_servo_force_N_m"
TIP = '<geom name="tip" size="0.05" pos="0.4 0 0" mass="0"/>'
PLACE = np.array([0.4 * np.cos(0.48), 0.4 * np.sin(0.48), 0.0])
"""A ball of 0.05 m that the tip hits at j = 0.23 or so, at 0.16 s; alone, the servo is at its limit to 0.2336 s."""


def hit(folder, restitution, *, turn=(1.0, 0.0, 0.0, 0.0), boost=(0.0, 0.0, 0.0), step_s=1e-3):
    """A run in which the tip hits a ball, in a scene that is turned and moves as a whole."""
    place = np.zeros(3)
    mujoco.mju_rotVecQuat(place, PLACE, np.array(turn))
    initial = {
        "joints": {"j": 0.2, "robot/free": [0, 0, 0, *turn], "ball/free": [*place, 1, 0, 0, 0]},
        "rates": {"j": -0.3, "robot/free": [*boost, 0, 0, 0.06], "ball/free": [*boost, 0, 0, 0]},
    }
    return run_link(
        folder,
        HOLD,
        model=link(CLAMPED, link_body=TIP),
        others={"ball": ball(mass=0.5, radius=0.05)},
        contacts={"rules": [{"between": ["tip", "ball/ball"], "restitution": restitution}]},
        initial=initial,
        duration_s=0.3,
        **steps(step_s),
    )


@pytest.mark.parametrize("restitution", [0.0, 1.0])
def test_an_impact_at_the_limit_of_the_force(tmp_path, restitution):
    """It takes no energy with e = 1 and some with 0, the force stays at its limit, and momentum and work balance."""
    run = hit(tmp_path, restitution)
    impact = run.impacts[0]
    before, after = run[FORCE][run.time < impact.time_s], run[FORCE][run.time > impact.time_s]
    assert 0.1 < impact.time_s < 0.2336
    assert before[-1] == after[0] == 2.5
    assert (run["energy.total_J"][-1] - run["balance.work_J"][-1] < run["energy.total_J"][0] - 1e-3) == (restitution == 0.0)
    assert passes(run)
    assert_replayed(run)


def test_a_turned_and_boosted_scene_moves_alike(tmp_path):
    """Relative to its base: joint, force and impulse."""
    turn = np.array([0.9, 0.25, -0.2, 0.3]) / np.linalg.norm([0.9, 0.25, -0.2, 0.3])
    one, other = hit(tmp_path, 0.6), hit(tmp_path, 0.6, turn=tuple(turn), boost=(0.3, -0.7, 0.4))
    for key in (ANGLE, RATE, FORCE):
        np.testing.assert_allclose(other[key], one[key], rtol=0.0, atol=1e-9)
    assert other.impacts[0].impulse_N_s == pytest.approx(one.impacts[0].impulse_N_s, rel=1e-9)
    assert passes(other)


@pytest.mark.parametrize("column", [FORCE, "actuators.robot_servo_unclamped_N_m"])
def test_a_changed_force_in_a_log_is_found(tmp_path, capsys, column):
    run = run_link(tmp_path, HOLD, actuators=CLAMPED, duration_s=0.1)
    assert main(["analyze", str(written(run.log, tmp_path / "same.mcap"))]) == 0
    rows = run.log.rows.copy()
    rows[50, run.keys.index(column)] += 1e-6
    assert main(["analyze", str(written(replace(run.log, rows=rows), tmp_path / "changed.mcap"))]) == 1
    assert f"in {column} at 0.050 s" in capsys.readouterr().out


def test_an_external_servo_pushes_what_the_robot_holds(tmp_path):
    """A load of 2 kg at the base's centre: (6 + 2) v' = kv (u - v) from rest."""
    grasp = {"robot_site": "port", "object_site": "centre", "when": {"within": {"position_m": 0.01}}}
    law = playing(tmp_path, 0.5)
    run = run_link(
        tmp_path,
        law,
        model=link('<velocity name="servo" site="port" kv="2" gear="1 0 0 0 0 0"/>'),
        others={"ball": ball(mass=2.0)},
        grasps={"grasp": grasp},
        phases=[{"name": "push", "until": "end", "arm": ["grasp"], "controller": law}],
        initial={"joints": {"ball/free": [0, 0, 0, 1, 0, 0, 0]}},
        duration_s=0.5,
    )
    speed = 0.5 * (1.0 - np.exp(-2.0 * run.time / 8.0))
    # Order four: (h kv / m)^4 is 4e-15.
    np.testing.assert_allclose(run["state.v_robot_free_vx_m_s"], speed, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(run["state.v_ball_free_vx_m_s"], speed, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(run["balance.work_J"], 4.0 * speed**2, rtol=0.0, atol=1e-12)
    assert passes(run)
    assert_replayed(run)
