"""What happens at one instant is replayed in the order of the log, which is that in which it happened."""

from __future__ import annotations

from dataclasses import replace

import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.log.mcap.reader import read_log
from ffsm_mj.records.kinds import kind_of
from ffsm_mj.replay import replay_log
from tests.changed_logs import with_records
from tests.contact_models.grasp.scenes import ARM, OFF, grasping
from tests.scenes import falling_box


def test_impact_capture_and_impact_again_at_one_instant(tmp_path):
    """The hull is hit, the hand takes hold at once, and what that does to the velocities drives the two together again."""
    path = grasping(
        tmp_path,
        {"touch": ["hull-target/target"]},
        duration_s=0.2,
        initial={
            "joints": {"target/free": [-0.038656389401170776, 0.3, 0.02, 1, 0, 0, 0]},
            "rates": {"target/free": [-0.37734426308362967, -0.5, 0, 0.4, -0.2, -2.002881094626152], "shoulder": 0.3},
        },
        contacts={"rules": [{"between": ["hull", "target/target"], "restitution": 0.0}]},
        phases=[
            {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": OFF},
            {"name": "hold", "until": "end", "controller": OFF},
        ],
    )
    run = ffsm_mj.run(path, out=tmp_path / "out")
    first, second = run.impacts
    assert first.time_s == run.log.records["grasp_impulses"][0].time_s
    # Rounding of the transferred velocities decides whether the second is due at once or a root within the rounding of time.
    assert second.time_s == pytest.approx(first.time_s, abs=1e-14)
    again = replay_log(run.log)
    assert [str(check) for check in (*all_checks(run), *again.checks()) if not check.passes] == []
    assert again.agrees, again.worst
    log = read_log(tmp_path / "out/run.mcap")
    order = ["impact", "contact_begins", "grasp", "phase", "contact_ends", "impact"]
    assert [kind_of(event).name for event in log.events[2:8]] == order
    assert log.events == run.log.events
    at = [log.events.index(event) for event in (first, log.records["grasp_impulses"][0])]
    turned = list(log.events)
    turned[at[0]], turned[at[1]] = turned[at[1]], turned[at[0]]
    assert not replay_log(replace(log, events=tuple(turned))).agrees


@pytest.mark.long
def test_two_grasps_that_close_at_one_impact_with_friction(tmp_path):
    """The impact is the first of the three: neither latch is closed at it, whatever their impulses do to the velocities."""
    touch = {"touch": ["hand-target/target"]}
    robot = ARM.replace("</body></body></body>", '<site name="pin" pos="0.2 0.08 0"/></body></body></body>', 1)
    path = grasping(
        tmp_path,
        robot=robot,
        duration_s=0.2,
        initial={
            "joints": {"target/free": [1.08, 0.03, 0.02, 1, 0, 0, 0]},
            "rates": {"target/free": [-0.3, 0.2, 0, 4.0, -2.0, 3.0]},
        },
        contacts={"rules": [{"between": ["hand", "target/target"], "restitution": 0.0, "mu": 0.5}]},
        grasps={
            "ball": {"robot_site": "grip", "object_site": "target/handle", "when": touch, "joint": "ball"},
            "hinge": {
                "robot_site": "pin",
                "object_site": "target/handle",
                "when": touch,
                "joint": "hinge",
                "axis": [1, 2, 3],
            },
        },
        phases=[{"name": "meet", "until": "end", "arm": ["ball", "hinge"], "controller": OFF}],
    )
    run = ffsm_mj.run(path)
    first, second = run.log.records["grasp_impulses"]
    assert run.impacts[0].time_s == first.time_s == second.time_s
    assert [str(check) for check in (*all_checks(run), *replay_log(run.log).checks()) if not check.passes] == []


def test_a_grasp_by_touch_that_is_armed_twice(tmp_path):
    """No record says that it was disarmed without a touch: that of the second arming does."""
    path = grasping(
        tmp_path,
        duration_s=0.3,
        phases=[
            {"name": "meet", "for_s": 0.1, "arm": ["grasp"], "controller": OFF},
            {"name": "wait", "for_s": 0.1, "controller": OFF},
            {"name": "again", "until": "end", "arm": ["grasp"], "controller": OFF},
        ],
    )
    run = ffsm_mj.run(path)
    assert [record.time_s for record in run.log.records["armings"]] == pytest.approx([0.0, 0.2])
    assert replay_log(run.log).agrees


def test_points_of_an_impact_in_another_order(tmp_path):
    """Rounding decides which corner of a face is its first: the records of a pair are compared point by point."""
    log = ffsm_mj.run(falling_box(tmp_path, [0.1, 0.2, 0.501, 1, 0, 0, 0], [0.3, 0.1, -1, 0, 0, 0.5])).log
    impacts = log.records["impacts"]
    assert len(impacts) == 4
    assert len({impact.event for impact in impacts}) == 1
    turned = (*impacts[1:], impacts[0])
    assert replay_log(with_records(log, {"impacts": turned})).agrees
    wrong = (replace(turned[0], point_m=turned[1].point_m), *turned[1:])
    assert not replay_log(with_records(log, {"impacts": wrong})).agrees
