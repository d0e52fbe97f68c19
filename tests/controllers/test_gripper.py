"""The law of grippers: fingers go to the ends of their ranges, and press with the stated force."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import InputError
from tests.scenes import HEAD, ball, scene

SLIDES = f"""<mujoco>{HEAD}<worldbody><body name="hand"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="3" diaginertia="0.04 0.04 0.02"/>
  <body name="left" pos="0.2 0 0"><joint name="left" type="slide" axis="0 1 0" limited="true" range="0 0.1"/>
    <inertial pos="0 0.04 0" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/>
    <geom name="left" type="box" size="0.02 0.01 0.02" pos="0 0.01 0" mass="0"/></body>
  <body name="right" pos="0.2 0 0"><joint name="right" type="slide" axis="0 -1 0" limited="true" range="0 0.1"/>
    <inertial pos="0 -0.04 0" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/>
    <geom name="right" type="box" size="0.02 0.01 0.02" pos="0 -0.01 0" mass="0"/></body>
  </body></worldbody>
  <actuator><motor name="left" joint="left"/><motor name="right" joint="right" gear="2"/></actuator></mujoco>"""
"""Two fingers that slide apart, as those of common hands: 0 is closed."""

HINGES = f"""<mujoco><compiler angle="radian"/>{HEAD}<worldbody><body name="hand"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="3" diaginertia="0.04 0.04 0.02"/>
  <body name="left" pos="0 0.1 0"><joint name="left" axis="0 0 -1" limited="true" range="-0.5 0.3"/>
    <inertial pos="0.1 0 0" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/><geom name="left" size="0.01" mass="0"/></body>
  <body name="right" pos="0 -0.1 0"><joint name="right" axis="0 0 -1" limited="true" range="-0.3 0.5"/>
    <inertial pos="0.1 0 0" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/>
    <body name="tip" pos="0.2 0 0"><joint name="tip" axis="0 0 1" limited="true" range="-0.2 0.4"/>
      <inertial pos="0.05 0 0" mass="0.05" diaginertia="1e-4 1e-4 1e-4"/></body></body>
  </body></worldbody>
  <actuator><motor name="left" joint="left"/><motor name="right" joint="right"/><motor name="tip" joint="tip"/></actuator>
  </mujoco>"""
"""Two fingers that turn, with closing positions at other ends of their ranges, one of them with two joints."""

PLACES = {"left": 0.05, "right": 0.06}
ALL = ["left", "right", "tip"]


def hand(folder, law, robot=SLIDES, joints=("left", "right"), **changes):
    gripper = {"kind": "gripper", "joints": list(joints), **law}
    places = {"rock/free": [0.2, 0, 0, 1, 0, 0, 0] if robot is SLIDES else [9, 0, 0, 1, 0, 0, 0]}
    return scene(
        folder,
        robot,
        {"rock": ball("rock", mass=0.5, radius=0.02)},
        **{
            "initial": {"joints": places | (PLACES if robot is SLIDES else {})},
            "contacts": {"ignored": [{"between": ["robot", "rock"], "reason": "only the law is of interest"}]},
            "phases": [{"name": "all", "until": "end", "controller": gripper}],
            **changes,
        },
    )


def places(run, names=("left", "right")):
    keys = {signal.key for signal in run.log.header.layout.signals}
    return [run[next(key for key in keys if key.startswith(f"state.q_robot_{name}_"))] for name in names]


@pytest.mark.parametrize(("action", "end"), [("open", 0.1), ("close", 0.0)])
def test_slides_go_to_the_ends_of_their_range(tmp_path, action, end):
    """(1 + w t) exp(-w t) of the way is left after a time, whatever the mass of the hand; no finger overshoots."""
    run = ffsm_mj.run(hand(tmp_path, {"action": action, "bandwidth_rad_s": 10.0}))
    assert run.outcome == "completed", run.message
    for place, start in zip(places(run), PLACES.values(), strict=True):
        left = (1.0 + 10.0 * run.time) * np.exp(-10.0 * run.time)
        # The effort is held over 1 ms: half of w dt, 5e-3, of the way.
        np.testing.assert_allclose(place, end + (start - end) * left, atol=5e-3 * 0.06)
        assert (np.sign(start - end) * (place - end) > 0.0).all()
    assert all(check.passes for check in all_checks(run))


@pytest.mark.parametrize(("action", "ends"), [("close", (0.3, -0.3, 0.4)), ("open", (-0.5, 0.5, -0.2))])
def test_hinges_close_towards_each_other(tmp_path, action, ends):
    """The closing end is that towards the other finger, be it the upper or the lower end of the range."""
    run = ffsm_mj.run(hand(tmp_path, {"action": action, "bandwidth_rad_s": 10.0}, HINGES, ALL, duration_s=2.0))
    assert run.outcome == "completed", run.message
    np.testing.assert_allclose([place[-1] for place in places(run, ALL)], ends, atol=1e-3)


def test_given_ends_win(tmp_path):
    law = {"action": "close", "bandwidth_rad_s": 10.0, "closed_at": [0.01, 0.02], "open_at": 0.09}
    run = ffsm_mj.run(hand(tmp_path, law, duration_s=2.0))
    np.testing.assert_allclose([place[-1] for place in places(run)], [0.01, 0.02], atol=1e-5)
    run = ffsm_mj.run(hand(tmp_path, law | {"action": "open"}, duration_s=2.0))
    np.testing.assert_allclose([place[-1] for place in places(run)], 0.09, atol=1e-5)


@pytest.mark.parametrize(
    "law", [{"force_N": 4.0}, {"action": "close", "bandwidth_rad_s": 100.0, "damping_ratio": 1.0, "force_N": 4.0}]
)
def test_fingers_press_with_the_stated_force(tmp_path, law):
    """What they close on is pressed from both sides: the contact forces are the stated one."""
    pairs = [{"between": [name, "rock/rock"], "restitution": 0.0, "name": name} for name in ("left", "right")]
    start = {"rock/free": [0.2, 0, 0, 1, 0, 0, 0], "left": 0.021, "right": 0.021}
    path = hand(tmp_path, law, contacts={"rules": pairs}, initial={"joints": start}, duration_s=0.3)
    run = ffsm_mj.run(path)
    assert run.outcome == "completed", run.message
    for name in ("left", "right"):
        assert run[f"actuators.robot_{name}_command_N"].min() >= -4.0 - 1e-12
        np.testing.assert_allclose(run[f"contact.{name}_force_N"][-50:], 4.0, rtol=1e-6)
    assert all(check.passes for check in all_checks(run))


@pytest.mark.parametrize(("force", "signs"), [(2.0, (1.0, -1.0, 1.0)), (-2.0, (-1.0, 1.0, -1.0))])
def test_hinges_press_with_force_times_lever(tmp_path, force, signs):
    law = {"force_N": force, "lever_m": [0.1, 0.2, 0.05]}
    run = ffsm_mj.run(hand(tmp_path, law, HINGES, ALL, duration_s=0.01))
    for name, sign, lever in zip(ALL, signs, law["lever_m"], strict=True):
        assert run[f"actuators.robot_{name}_command_N_m"][0] == pytest.approx(sign * 2.0 * lever)


@pytest.mark.parametrize(
    ("robot", "law", "said"),
    [
        (SLIDES, {}, r"controller: write 'action: open', 'action: close' or 'force_N'"),
        (SLIDES, {"action": "close"}, r"controller: write 'bandwidth_rad_s' or 'bandwidth_Hz', one of the two"),
        (SLIDES, {"action": "shut"}, r"controller\.action: should be 'open' or 'close', got \"shut\""),
        (
            SLIDES,
            {"action": "close", "bandwidth_Hz": 1.0, "force_N": -1.0},
            r"force_N is a bound and must be positive, got -1",
        ),
        (
            SLIDES,
            {"action": "open", "bandwidth_Hz": 1.0, "open_at": 0.2},
            r"open_at\.0: 0\.2 is beyond the range of robot/left",
        ),
        (SLIDES, {"force_N": 1.0, "joints": ["left"]}, r"joints: which way robot/left closes the gripper does not follow"),
        (HINGES, {"force_N": 1.0}, r"force_N: needs 'lever_m', the distance from the axis of robot/left, robot/right"),
        (
            SLIDES.replace('limited="true" range="0 0.1"', ""),
            {"action": "close", "bandwidth_Hz": 1.0},
            r"controller\.action: robot/left, robot/right has no range; write 'closed_at'",
        ),
    ],
)
def test_faults(tmp_path, robot, law, said):
    with pytest.raises(InputError, match=said) as refused:
        ffsm_mj.run(hand(tmp_path, law, robot))
    assert len(refused.value.lines) in (1, 2)


def test_an_arm_that_tracks_leaves_the_fingers_to_their_law(tmp_path):
    """Without joints the two laws share the robot as one would expect, and the fingers close on the way."""
    robot = SLIDES.replace('<body name="hand"><freejoint name="free"/>', _MOUNT).replace(
        "</body></worldbody>", "</body></body></body></worldbody>"
    )
    robot = robot.replace("<actuator>", '<actuator><motor name="turn" joint="turn"/><motor name="reach" joint="reach"/>')
    robot = robot.replace('<geom name="left"', '<site name="pad"/><geom name="left"')
    arm = {"kind": "track", "robot_site": "palm", "object_site": "rock/centre", "position": {"kp_1_s2": 1.0, "kd_1_s": 2.0}}
    fingers = {"kind": "gripper", "joints": ["left", "right"], "action": "close", "bandwidth_rad_s": 10.0}
    path = hand(tmp_path, {}, robot)
    start = {"rock/free": [0.5, 0.3, 0, 1, 0, 0, 0], **PLACES}
    laws = {"controllers": {"arm": arm, "fingers": fingers}}
    changes = {"initial.joints": start, "duration_s": 2.0, "phases": [{"name": "all", "until": "end", **laws}]}
    prepared = prepare(path, changes)
    assert not any("drives" in line for line in prepared.describe())
    run = prepared.run()
    assert run.outcome == "completed", run.message
    # The arm accelerates the hand by 0.1 m/s^2 or less, over w^2 = 100 1/s^2 in the end.
    np.testing.assert_allclose([place[-1] for place in places(run)], 0.0, atol=1e-3)
    error = run["controller.arm_track_error_m"]
    assert error[-1] < 0.5 * error[0]


_MOUNT = """<body name="base"><freejoint name="free"/><inertial pos="0 0 0" mass="20" diaginertia="4 4 4"/>
  <body name="link"><joint name="turn" axis="0 0 1"/><inertial pos="0.1 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>
  <body name="hand"><joint name="reach" type="slide" axis="1 0 0"/><site name="palm" pos="0.1 0 0"/>"""
