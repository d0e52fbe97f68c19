"""Joint limits of a scenario: what is refused, with which line, and what ``check`` says."""

from __future__ import annotations

import math

import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import InputError
from tests.contact_models.limits import GRIPPER, ROTOR, rotor
from tests.controllers.detumbling import spacecraft
from tests.scenes import HEAD, ball, scene

IGNORE = "or write 'limits: ignore' in the scenario"
BALL_JOINT = ROTOR.replace('name="hinge" axis="0 0 1" range="-30 30"', 'name="hinge" type="ball" range="0 30"').replace(
    '<motor name="motor" joint="hinge"/>', ""
)
ON_RAIL = ROTOR.replace('<freejoint name="free"/>', '<joint name="rail" type="slide" axis="1 0 0" range="-1 1"/>')
TENDON = GRIPPER.replace(
    "<actuator>",
    """<tendon><fixed name="strap" range="0 1e-9" limited="true"><joint joint="left" coef="1"/>
  <joint joint="right" coef="1"/></fixed></tendon><actuator>""",
)


def refused(path, *overrides):
    """The lines of the error that refuses a scenario."""
    with pytest.raises(InputError) as error:
        prepare(path, list(overrides))
    return error.value.lines


@pytest.mark.parametrize(
    ("robot", "line", "what"),
    [
        (
            ROTOR.replace('range="-30 30"', 'range="20 20"'),
            3,
            "joint 'hinge': the range 20 20 allows a single value: use a fixed joint",
        ),
        (
            ROTOR.replace('range="-30 30"', 'range="0 0" limited="true"'),
            3,
            "joint 'hinge': the range 0 0 allows a single value: use a fixed joint",
        ),
        (
            ROTOR.replace('range="-30 30"', 'range="30 -30"'),
            3,
            "joint 'hinge': the range 30 -30 is empty: the lower value comes first",
        ),
        (
            BALL_JOINT,
            3,
            f"joint 'hinge': limits of a ball joint are not supported; remove its range, {IGNORE}",
        ),
        (
            ON_RAIL,
            1,
            "joint 'rail': limits of a joint to the world are not supported, as they would be external forces; remove its "
            f"range, {IGNORE}",
        ),
        (
            TENDON,
            9,
            f"tendon 'strap': the range 0 1e-09 allows a single length; remove its range, {IGNORE}",
        ),
    ],
    ids=["one value", "zero", "empty", "ball", "world", "tendon"],
)
def test_limits_that_cannot_be_stops_are_refused_with_their_line(tmp_path, robot, line, what):
    (refusal,) = refused(scene(tmp_path, robot, {}))
    assert refusal == f"{tmp_path / 'robot.xml'}:{line}: {what}"


@pytest.mark.parametrize("robot", [BALL_JOINT, ON_RAIL, TENDON])
def test_they_can_be_ignored(tmp_path, robot):
    path = scene(tmp_path, robot, {}, duration_s=0.01)
    run = ffsm_mj.run(path, {"robot.limits": "ignore"})
    assert run.outcome == "completed"
    assert not [key for key in run.keys if "_limit" in key]


def test_a_start_past_a_limit_is_refused_with_joint_value_and_range(tmp_path):
    path = rotor(tmp_path, 0.5, initial={"joints": {"hinge": 0.6}})
    (line,) = refused(path)
    assert line.startswith(f"{path}:1:")
    assert line.endswith(
        "initial.joints.hinge: joint robot/hinge starts at 0.6 rad, outside its limits of -0.523599 to 0.523599 rad"
    )
    prepare(path, ["robot.limits=ignore", "joint_limits={}"])
    (line,) = refused(path, "initial.joints.hinge=-0.53")
    assert "starts at -0.53 rad" in line


def test_a_start_that_is_not_stated_is_refused_too(tmp_path):
    path = scene(tmp_path, ROTOR.replace("-30 30", "10 30"), {})
    (line,) = refused(path)
    assert "initial: joint robot/hinge starts at 0 rad, outside its limits of 0.174533 to 0.523599 rad" in line


def test_a_wheel_may_have_turned_often_and_a_joint_of_an_arm_not(tmp_path):
    """As in a state of a log: 34 turns of a wheel are no degrees that were taken for radians."""
    path = scene(tmp_path, spacecraft(), {}, initial={"joints": {"wheel_1": -213.373, "shoulder": -213.373}})
    notes = [line for line in prepare(path).describe() if "beyond one turn" in line]
    assert [note.partition(": robot/")[2][:22] for note in notes] == ["shoulder at -213.373 r"]


@pytest.mark.parametrize(
    ("limits", "start", "hint"),
    [
        ("-30 30", "20", "; angles in a scenario are in rad, and 20 degrees are 0.349066 rad"),
        ("-30 30", "-40", ""),
        (
            "-1.5 1.5",
            "0.3",
            '; if the model file states -1.5 to 1.5 in rad, it needs <compiler angle="radian"/>: '
            "angles in MJCF are in degrees by default",
        ),
        ("-1.5 1.5", "1.6", ""),
        ("-30 30", "3", ""),
    ],
    ids=["start in degrees", "outside in degrees too", "range in radians", "outside in radians too", "plainly outside"],
)
def test_a_start_past_a_limit_says_where_degrees_were_probably_meant(tmp_path, limits, start, hint):
    path = scene(tmp_path, ROTOR.replace("-30 30", limits), {})
    (line,) = refused(path, f"initial.joints.hinge={start}")
    assert line.partition(" rad, outside its limits of ")[2].partition(" rad")[2] == hint


def test_a_start_at_a_limit_is_none_past_it(tmp_path):
    """Degrees of the file and radians of the scenario differ by rounding."""
    path = rotor(tmp_path, 0.5, duration_s=0.01, initial={"joints": {"hinge": math.radians(30.0) + 1e-15}})
    assert ffsm_mj.run(path).outcome == "completed"


@pytest.mark.parametrize(
    ("limits", "what"),
    [
        ({"elbow": {}}, "joint_limits.elbow: unknown joint 'elbow'"),
        ({"free": {}}, "joint_limits.free: the joint has no limits in its model, or they are ignored (limits: ignore)"),
        ({"hinge": {}, "robot/hinge": {}}, "joint_limits.robot/hinge: the joint robot/hinge is listed twice"),
        ({"hinge": {"restitution": 1.1}}, "joint_limits.hinge.restitution: "),
        ({"hinge": {"mu": 0.1}}, "joint_limits.hinge.mu: "),
    ],
)
def test_wrong_entries_are_refused(tmp_path, limits, what):
    (line,) = refused(scene(tmp_path, ROTOR, {}, joint_limits=limits))
    assert what in line


def test_check_names_the_joints_that_stop(tmp_path):
    lines = prepare(rotor(tmp_path, 0.25)).describe()
    heading = lines.index("  joints that stop at their limits")
    assert lines[heading + 1] == "    robot/hinge: -0.5236 to 0.5236 rad, e = 0.25"
    ignored = prepare(rotor(tmp_path, 0.25), ["robot.limits=ignore", "joint_limits={}"]).describe()
    assert not any("stop at their limits" in line for line in ignored)
    assert "note: removed from robot: limits of 1 joint (hinge)" in ignored


def test_an_unlimited_joint_has_none(tmp_path):
    path = scene(tmp_path, ROTOR.replace('range="-30 30"', 'range="-30 30" limited="false"'), {}, duration_s=0.01)
    run = ffsm_mj.run(path)
    assert not [key for key in run.keys if "_limit" in key]
    assert "limit_impacts" not in run.summary()


def test_limits_of_an_object_are_its_own(tmp_path):
    """``limits`` of the robot says nothing of an object."""
    panel = f"""<mujoco>{HEAD}<worldbody><body name="hub"><freejoint name="free"/><inertial pos="0 0 0" mass="2"
      diaginertia="0.1 0.1 0.1"/><body name="panel"><joint name="panel" axis="0 0 1" range="-10 10"/>
      <inertial pos="0.2 0 0" mass="0.3" diaginertia="0.01 0.01 0.01"/></body></body></worldbody></mujoco>"""
    path = scene(tmp_path, ball("ball"), {"target": panel}, duration_s=0.2, initial={"rates": {"panel": 3.0}})
    run = ffsm_mj.run(path, {"robot.limits": "ignore"})
    (hit,) = run.records["limit_impacts"]
    assert (hit.joint, hit.side) == ("target/panel", "upper")
    assert all(check.passes for check in all_checks(run))
    free = ffsm_mj.run(path, {"objects.target.limits": "ignore"})
    assert free["state.q_target_panel_rad"][-1] > 0.3
