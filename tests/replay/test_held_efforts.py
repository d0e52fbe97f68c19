"""Efforts and their bounds are those of the last decision, whatever the speed at a later event or row."""

from __future__ import annotations

import pytest

import ffsm_mj
from ffsm_mj.replay import replay_log
from tests.scenes import HEAD, ball, scene

PADDLE = f"""<mujoco>{HEAD}<worldbody><body name="bus"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="50" diaginertia="1 1 1"/><geom name="bus" size="0.1" mass="0"/>
  <body name="paddle"><joint name="slide" type="slide" axis="1 0 0" stiffness="100" springref="0.3"/>
    <inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>
    <geom name="paddle" type="box" size="0.05 0.3 0.3" pos="0.4 0 0" mass="0"/></body></body></worldbody>
  <actuator><motor name="push" joint="slide"/></actuator></mujoco>"""


def paddle(folder, ball_at_m, **scenario):
    """A motor with a torque-speed line plays 5 N on the paddle, before which a ball floats."""
    (folder / "efforts.csv").write_text("time_s,push_N\n0,5\n1,5\n")
    return scene(
        folder,
        PADDLE,
        {"ball": ball("ball")},
        initial={"joints": {"ball/free": [ball_at_m, 0, 0, 1, 0, 0, 0]}},
        actuators={"push": {"kind": "torque_speed", "stall_torque_N_m": 5.0, "no_load_speed_rad_s": 10.0}},
        phases=[{"name": "a", "until": "end", "controller": {"kind": "playback", "file": "efforts.csv"}}],
        **scenario,
    )


def test_bounds_in_a_row_are_those_of_the_last_late_tick(tmp_path):
    """At a tick of the grid nothing is decided where the controller is late: speed and bounds have changed meanwhile."""
    path = paddle(tmp_path, 2.0, duration_s=0.05, control_period_s=0.01, actuation={"control_jitter_s": 0.005})
    run = ffsm_mj.run(path)
    last = run.log.records["effort_changes"][-1]
    bound = 5.0 * (1.0 - last.qvel_before["robot/slide"][0] / 10.0)
    assert run["actuators.robot_push_upper_N"][-1] == pytest.approx(bound, abs=1e-12)
    again = replay_log(run.log)
    assert again.agrees, again.worst


def test_a_ball_leaves_a_paddle_that_is_faster_than_at_the_last_tick(tmp_path):
    """The spring speeds both up until the ball leaves, within a tick; the motor still has the force of the tick."""
    rules = [{"between": ["paddle", "ball/ball"], "restitution": 0.0}]
    path = paddle(tmp_path, 0.5501, duration_s=0.45, control_period_s=0.15, contacts={"rules": rules})
    run = ffsm_mj.run(path)
    (left,) = run.log.records["contact_endings"]
    row = int(left.time_s / 0.15)
    (force,), (speed,) = left.efforts_after["robot/push"], left.qvel_before["robot/slide"]
    assert force == run["actuators.robot_push_applied_N"][row]
    assert force > 5.0 * (1.0 - speed / 10.0) + 0.01  # what the motor could newly be asked for
    again = replay_log(run.log)
    assert again.agrees, again.worst
