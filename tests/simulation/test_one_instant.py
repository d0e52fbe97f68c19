"""Conditions of several contact models that hold at one instant, or to rounding: none is missed, in any inertial frame."""

from __future__ import annotations

import pytest

import ffsm_mj
from tests.replays import assert_replayed
from tests.scenes import ball, scene


@pytest.mark.long
@pytest.mark.parametrize("frame", [(0.0, 0.0, 0.0), (-7.3, 0.4, 2.1)])
@pytest.mark.parametrize("speed", [0.01, 1.0])
@pytest.mark.parametrize(("meets_s", "step_s"), [(0.25, 1e-3), (0.335, 5e-3), (0.2537, 1e-2)])
@pytest.mark.parametrize("restitution", [0.0, 1.0])
def test_a_ball_that_touches_where_the_hand_reaches_it_is_caught(tmp_path, frame, speed, meets_s, step_s, restitution):
    """The balls touch where the distance of their centres, 0.2 m, is the bound of the grasp.

    The root of one condition is before that of the other by rounding, which is 1e-15 m over the speed. Were the impact
    alone applied there, the ball would be on its way back, or at rest at the bound, and be missed. What follows is plastic:
    both move at the mean velocity.
    """
    path = scene(
        tmp_path,
        ball("hand"),
        {"target": ball("target")},
        initial={
            "joints": {"target/free": [0.2 + speed * meets_s, 0, 0, 1, 0, 0, 0]},
            "rates": {"target/free": [frame[0] - speed, *frame[1:], 0, 0, 0], "robot/free": [*frame, 0, 0, 0]},
        },
        contacts={"rules": [{"between": ["hand", "target/target"], "restitution": restitution}]},
        grasps={
            "grasp": {"robot_site": "robot/centre", "object_site": "target/centre", "when": {"within": {"position_m": 0.2}}}
        },
        phases=[{"name": "meet", "until": "end", "arm": ["grasp"], "controller": {"kind": "off"}}],
        duration_s=0.4,
        time_step_s=step_s,
        control_period_s=1e-2,
    )
    run = ffsm_mj.run(path)
    assert_replayed(run)
    (impact,), (capture,) = run.impacts, run.records["grasp_impulses"]
    assert impact.time_s == capture.time_s
    assert impact.time_s == pytest.approx(meets_s, abs=2e-11)  # an instant, and the root of a gap known to 1e-14 m at 1 cm/s
    assert capture.speed_m_s == pytest.approx(restitution * speed, abs=1e-12)
    for name in ("robot", "target"):
        assert capture.qvel_after[f"{name}/free"][0] == pytest.approx(frame[0] - 0.5 * speed, abs=1e-12)


@pytest.mark.parametrize("offset", [-1e-16, 0.0, 1e-16])
def test_sites_that_are_at_rest_at_a_bound_are_within_it_whatever_rounding(tmp_path, offset):
    path = scene(
        tmp_path,
        ball("hand"),
        {"target": ball("target")},
        initial={"joints": {"target/free": [0.3 + offset, 0, 0, 1, 0, 0, 0]}},
        contacts={"rules": []},
        grasps={
            "grasp": {"robot_site": "robot/centre", "object_site": "target/centre", "when": {"within": {"position_m": 0.3}}}
        },
        phases=[{"name": "meet", "until": "end", "arm": ["grasp"], "controller": {"kind": "off"}}],
        duration_s=0.02,
    )
    run = ffsm_mj.run(path)
    assert_replayed(run)
    (capture,) = run.records["grasp_impulses"]
    assert capture.time_s == 0.0
