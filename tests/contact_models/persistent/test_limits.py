"""Joints at rest at their limits: closed forms of force and release, order, grasps, replay, and wrong code."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.replay import explain, replay_log
from ffsm_mj.replay.truncation import AnalysisLimits
from tests.changed_logs import with_records
from tests.contact_models.grasp.scenes import ARM as HAND
from tests.contact_models.grasp.scenes import OFF, grasping
from tests.contact_models.limits import DRIVEN, FLYWEIGHTS, GRIPPER, PANEL, driven_by, failures, sentences
from tests.replays import assert_replayed, proved
from tests.scenes import ARM, HEAD, ball, box, scene


def gripper(folder, force, **changes):
    """Both jaws are driven by a force in N: a number, or a function of time."""
    effort = force if callable(force) else (lambda _: force)
    path = scene(folder, GRIPPER, {}, **{"phases": DRIVEN, "duration_s": 0.4, **changes})
    return ffsm_mj.run(path, controllers=driven_by(effort))


def test_jaws_that_close_on_nothing_press_on_their_own_stops(tmp_path):
    """By symmetry nothing else moves: each stop carries the force of its motor, and the jaws stay where they are."""
    run = gripper(tmp_path, 1.5)
    for jaw in ("left", "right"):
        force, state, q = (
            run[key]
            for key in (f"contact.robot_{jaw}_limit_force_N", f"contact.robot_{jaw}_limit", f"state.q_robot_{jaw}_m")
        )
        pressed = state == 2.0
        assert 150 < pressed.sum() < 350
        np.testing.assert_allclose(force[pressed], -1.5, rtol=0.0, atol=1e-12)
        np.testing.assert_array_equal(force[~pressed], 0.0)
        np.testing.assert_allclose(q[pressed], 0.04, rtol=0.0, atol=1e-14)
        # From rest at the lower limit: 1.5 N moves the jaws at 1.5 / 0.2 m/s^2, as the base does not move.
        assert sentences(run)[-1][1] == pytest.approx(math.sqrt(2 * 0.04 * 0.2 / 1.5), abs=1e-6)
        impulse = run[f"contact.robot_{jaw}_limit_impulse_N_s"]
        assert impulse[-1] == pytest.approx(1.5 * (0.4 - math.sqrt(2 * 0.04 * 0.2 / 1.5)), abs=1e-10)
    assert [each[0] for each in sentences(run)][-4:] == ["LimitImpactRecord"] * 2 + ["LimitBegins"] * 2
    begins = run.records["limit_beginnings"][-1]
    assert (begins.state, begins.unit, begins.force_after) == ("pressed", "m", pytest.approx(1.5, abs=1e-12))
    proved(run)


def test_a_start_at_a_limit_is_pressed_from_the_first_step(tmp_path):
    run = gripper(tmp_path, -2.0, duration_s=0.05)
    np.testing.assert_array_equal(run["contact.robot_left_limit"], -2.0)
    np.testing.assert_allclose(run["contact.robot_left_limit_force_N"], 2.0, atol=1e-12)
    np.testing.assert_allclose(run["state.q_robot_left_m"], 0.0, atol=1e-16)
    proved(run)


def test_a_start_at_a_limit_with_a_rate_into_it_is_an_impact_at_once(tmp_path):
    run = gripper(
        tmp_path, 0.0, duration_s=0.05, initial={"rates": {"left": -0.5}}, joint_limits={"left": {"restitution": 0.5}}
    )
    hit = run.records["limit_impacts"][0]
    assert (hit.time_s, hit.joint, hit.approach_rate) == (0.0, "robot/left", 0.5)
    proved(run)


def test_the_force_follows_the_efforts_and_the_jaws_leave_when_it_turns_round(tmp_path):
    """A motor effort changes at ticks only: the jaws leave at the first tick with the other sign."""
    run = gripper(tmp_path, lambda t: 1.5 * math.cos(2 * math.pi * t / 0.8), duration_s=0.5)
    force = run["contact.robot_left_limit_force_N"]
    pressed = run["contact.robot_left_limit"] == 2.0
    expected = -1.5 * np.cos(2 * math.pi * run.time / 0.8)
    np.testing.assert_allclose(force[pressed], expected[pressed], atol=1e-10)
    ends = [each for each in run.records["limit_endings"] if each.side == "upper"]
    assert [each.time_s for each in ends] == [pytest.approx(0.201, abs=1e-9)] * 2
    proved(run)


RATE, TORQUE, HELD = 6.0, 2.0, 2.0
SPUN = 0.3 + 2 * (1e-3 + 0.5 * 0.3**2)


def flyweights(folder, **changes):
    """The weights press outwards while the base spins; a spring force of 2 N holds them back, the wheel slows the base."""
    initial = {"joints": {"a": 0.3, "b": 0.3}, "rates": {"robot/free": [0, 0, 0, 0, 0, RATE]}}
    path = scene(folder, FLYWEIGHTS, {}, **{"initial": initial, "duration_s": 0.7, "phases": DRIVEN, **changes})
    return ffsm_mj.run(path, controllers=driven_by(lambda _: (TORQUE, -HELD, -HELD)))


def test_release_at_the_root_of_the_force(tmp_path):
    """At the limit the force is m r w^2 - 2 N with w falling linearly: it is zero at w^2 = 2 N / (m r), at a root in a step.

    The wheel takes the torque; the rest, with the weights as parts, has the inertia SPUN. At rates of 1e-4 N per 1e-4 s the
    root of the force is known to 1e-12 s, less the 10 times its rounding (1e-10 of the terms) at which a contact opens.
    """
    run = flyweights(tmp_path)
    ends = run.records["limit_endings"]
    assert [(each.joint, each.side) for each in ends] == [("robot/a", "upper"), ("robot/b", "upper")]
    at = (RATE - math.sqrt(HELD / (0.5 * 0.3))) * SPUN / TORQUE
    assert ends[0].time_s == ends[1].time_s == pytest.approx(at, abs=1e-8)
    assert ends[0].event == ends[1].event
    assert ends[0].force_before == pytest.approx(0.0, abs=1e-7)
    pressed = run["contact.robot_a_limit"] == 2.0
    spin = RATE - TORQUE / SPUN * run.time
    np.testing.assert_allclose(run["contact.robot_a_limit_force_N"][pressed], HELD - 0.15 * spin[pressed] ** 2, atol=1e-9)
    assert run["state.q_robot_a_m"][-1] < 0.299
    proved(run)


def test_a_force_that_falls_below_zero_and_rises_again_in_one_step_releases(tmp_path):
    """A sprung wheel makes the spin swing: w = RATE - A sin(W t) is least in the middle of a step, at whose ends it presses.

    With h = 2 ms and W h = 0.09 the spin at both ends of that step is 2e-3 rad/s above its least; the force is zero at half
    of that. RK4 errs by (W h)^5 / 120 of A a step, 1.7e-6 rad/s by then, where the spin falls at 2.8 rad/s^2.
    """
    arm, wheel, step_s, turn = SPUN, 0.02, 2e-3, -1.0
    least_s = 17.5 * step_s
    W = 0.5 * math.pi / least_s
    swing = wheel * W / (arm + wheel)
    zero = RATE - swing + 1e-3
    spring = W**2 * arm * wheel / (arm + wheel)
    model = FLYWEIGHTS.replace('name="wheel" axis', f'name="wheel" stiffness="{spring!r}" axis')
    initial = {"joints": {"a": 0.3, "b": 0.3, "wheel": turn}, "rates": {"robot/free": [0, 0, 0, 0, 0, RATE]}}
    steps = {"time_step_s": step_s, "control_period_s": step_s, "duration_s": 0.04}
    path = scene(tmp_path, model, {}, initial=initial, phases=DRIVEN, **steps)
    hold = 0.15 * zero**2
    run = ffsm_mj.run(path, controllers=driven_by(lambda _: (0.0, -hold, -hold)))
    ends = run.records["limit_endings"]
    assert [each.joint for each in ends] == ["robot/a", "robot/b"]
    assert ends[0].time_s == pytest.approx(math.asin((RATE - zero) / swing) / W, abs=2e-6)
    assert ends[0].force_before == pytest.approx(0.0, abs=1e-7)
    assert_replayed(run)


def test_a_sample_between_two_events_changes_no_record(tmp_path):
    """Sampled inside the step of the release: the force before it is that at its root, not that at the sample."""
    sensors = {"base": {"kind": "framepos", "of": "robot/base", "interval_s": 3.7e-4}}
    ends = []
    for name, changes in (("without", {}), ("with", {"sensors": sensors})):
        folder = tmp_path / name
        folder.mkdir()
        run = flyweights(folder, time_step_s=0.01, control_period_s=0.02, **changes)
        ends.append(run.records["limit_endings"])
    assert ends[0] == ends[1]
    assert_replayed(run)


LOOSE = f"""<mujoco>{HEAD}<worldbody><body name="target"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="2" diaginertia="0.02 0.03 0.04"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("back_N", [0.03, 0.2])
def test_a_limit_that_is_left_at_once_leaves_steps_of_a_motion_without_forces(tmp_path, back_N):
    """A jaw stops dead at its limit while its motor pulls it back: no start of a rest and no end are logged.

    Another body spins at 21 rad/s in steps of 10 ms: the truncation is that of the method of the step (1e-6 rad), and a
    replay is as near as rounding only by the same one.
    """
    run = ffsm_mj.run(
        scene(
            tmp_path,
            GRIPPER,
            {"target": LOOSE},
            initial={
                "joints": {"left": 0.02, "right": 0.02, "target/free": [4, 0, 0, 1, 0, 0, 0]},
                "rates": {"left": 0.5, "target/free": [0, 0, 0, 15, 0.2, 15]},
            },
            phases=DRIVEN,
            duration_s=0.4,
            time_step_s=0.01,
            control_period_s=0.01,
        ),
        controllers=driven_by(lambda _: (-back_N, 0.0)),
    )
    assert sentences(run)[0][::2] == ("LimitImpactRecord", "left")
    assert run["contact.robot_left_limit"].any() == (back_N > 0.1)  # the stop at the other end, much later
    again = replay_log(run.log)
    assert again.agrees, again.worst
    assert again.worst["motion"].size < 1e-13
    judged = explain(run, again.checks(), limits=AnalysisLimits()).checks
    assert {check.fails_by_truncation for check in judged if not check.passes} == {True}


def test_the_release_is_of_order_four(tmp_path):
    """Error of the state at the end against steps of 1/16, halving the step: 16 times smaller, the event included."""
    ends = {}
    for k, step in enumerate((0.02, 0.01, 0.005, 0.00125)):
        folder = tmp_path / str(k)
        folder.mkdir()
        run = flyweights(folder, time_step_s=step, control_period_s=0.02, duration_s=0.6)
        ends[step] = np.array([run[key][-1] for key in run.keys if key.startswith("state.") and key != "state.time_s"])
    errors = [np.abs(ends[step] - ends[0.00125]).max() for step in (0.02, 0.01, 0.005)]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all(orders > 3.5), (errors, orders)
    assert np.all(orders < 5.5), (errors, orders)


def test_energy_and_momentum_to_rounding(tmp_path):
    """A folding arm hits its stop with half its rate and then rests there, pushed by a controller.

    With steps of 0.1 ms truncation is 1e-4 of that at 1 ms (3e-9 J): what is left are 6000 roundings of terms of 4 J.
    """
    arm = ARM.replace('name="elbow" axis="0 0 1"', 'name="elbow" axis="0 0 1" range="-10 60"')
    pd = {"kind": "pd", "joints": ["elbow"], "kp": 4.0, "kd": 0.2, "target": [2.0]}
    path = scene(
        tmp_path,
        arm,
        {"rock": ball("rock")},
        duration_s=0.6,
        time_step_s=1e-4,
        initial={
            "joints": {"shoulder": 0.5, "rock/free": [9, 9, 9, 1, 0, 0, 0]},
            "rates": {"elbow": 1.0, "robot/free": [0.1, -0.2, 0.3, 0.05, 0.02, -0.1]},
        },
        joint_limits={"elbow": {"restitution": 0.5}},
        phases=[{"name": "push", "until": "end", "controller": pd}],
    )
    run = ffsm_mj.run(path)
    assert len(run.records["limit_impacts"]) > 3
    assert run["contact.robot_elbow_limit"][-1] == 2.0
    assert max(check.residual for check in all_checks(run)) < 2e-12
    proved(run)


def held_panel(folder, **changes):
    """A hand catches a target whose panel swings to its stop while it is held."""
    path = grasping(folder, **changes)
    (folder / "target.xml").write_text(PANEL)
    return path


def test_a_panel_of_a_grasped_target_stops_at_its_limit(tmp_path):
    """In the coordinates of the motion with the grasp; hits before, while it is held, and after."""
    path = held_panel(tmp_path)
    run = ffsm_mj.run(path, {"initial.rates.panel": 1.0, "joint_limits": {"panel": {"restitution": 0.7}}})
    (caught,), (left,) = run.records["grasp_impulses"], run.records["releases"]
    times = [hit.time_s for hit in run.records["limit_impacts"]]
    assert any(caught.time_s < time < left.time_s for time in times)
    proved(run)


def test_a_panel_of_a_grasped_target_is_pressed(tmp_path):
    """With e = 0 the swinging hand presses the panel on its stop, in the grasp and after."""
    path = held_panel(tmp_path)
    run = ffsm_mj.run(path, {"initial.rates.panel": 1.0})
    assert np.abs(run["contact.target_panel_limit"]).max() == 2.0
    proved(run)


@pytest.mark.long
@pytest.mark.parametrize("late_s", [-4e-4, -1e-9, 0.0])
def test_a_limit_in_the_same_step_as_a_capture(tmp_path, late_s):
    """The range ends where the joint is a little before, or at, the instant at which the grasp closes."""
    free = tmp_path / "free"
    free.mkdir()
    run = ffsm_mj.run(grasping(free))
    (caught,) = run.records["grasp_impulses"]
    at = dict(zip(run.log.header.layout.keys, run.log.rows[int(caught.time_s / 1e-3)], strict=True))
    rate = at["state.v_robot_shoulder_rad_s"]
    angle = at["state.q_robot_shoulder_rad"] + rate * (caught.time_s % 1e-3 + late_s)
    ends = (-90.0, math.degrees(angle)) if rate > 0.0 else (math.degrees(angle), 90.0)
    robot = HAND.replace('name="shoulder" type="hinge"', f'name="shoulder" type="hinge" range="{ends[0]!r} {ends[1]!r}"')
    stopped = ffsm_mj.run(grasping(tmp_path / "stopped", robot=robot))
    hits = stopped.records["limit_impacts"]
    assert any(abs(hit.time_s - caught.time_s) < 1e-3 for hit in hits)
    assert stopped.records["grasp_impulses"]
    proved(stopped)


def test_jaws_on_an_object_and_on_their_own_stops_share_the_load(tmp_path):
    """Both jaws reach their stops and a ball between them at once: four rows in one problem, of impact and of forces.

    Stop and ball together carry the force of the motor; how much each is not determined, and the least norm halves it.
    """
    path = scene(
        tmp_path,
        GRIPPER,
        {"ball": ball("ball", radius=0.005)},
        duration_s=0.3,
        initial={"joints": {"left": 0.02, "right": 0.02, "ball/free": [0.3, 0.0, 0.0, 1, 0, 0, 0]}},
        contacts={"rules": [{"between": [jaw, "ball/ball"], "restitution": 0.0} for jaw in ("left", "right")]},
        phases=DRIVEN,
    )
    run = ffsm_mj.run(path, controllers=driven_by(lambda _: (1.0, 1.0)))
    (first, second), stops = run.impacts[:2], run.records["limit_impacts"][:2]
    assert {first.event, second.event, *(stop.event for stop in stops)} == {0}
    for jaw in ("left", "right"):
        assert run[f"contact.robot_{jaw}_limit_force_N"][-1] == pytest.approx(-0.5, abs=1e-9)
        assert run[f"contact.{jaw}_ball_ball_force_N"][-1] == pytest.approx(0.5, abs=1e-9)
    proved(run)


@pytest.mark.long
def test_a_changed_log_is_detected(tmp_path):
    run = gripper(tmp_path, 1.5)
    log = run.log
    first, *rest = log.records["limit_beginnings"]
    for changed in (
        replace(first, force_after=first.force_after + 1e-6),
        replace(first, state="free"),
        replace(first, joint="robot/none"),
        replace(first, value=first.value + 1e-8),
    ):
        records = {**log.records, "limit_beginnings": (changed, *rest)}
        assert not replay_log(with_records(log, records)).agrees
    for column, error in (("contact.robot_left_limit_force_N", 1e-6), ("contact.robot_right_limit", -1.0)):
        rows_ = log.rows.copy()
        rows_[350, log.header.layout.index[column]] += error
        assert not replay_log(replace(log, rows=rows_)).agrees
    rows_ = log.rows.copy()
    rows_[350, log.header.layout.index["contact.robot_left_limit_force_N"]] += 1e-6
    assert "contact complementarity" in failures(replay_log(replace(log, rows=rows_)).checks())


def test_a_release_is_seen_by_the_phases(tmp_path):
    """``until: limit_begins`` ends a phase where a joint comes to rest at a limit."""
    phases = [
        {"name": "close", "until": "limit_begins", "controller": {"kind": "driven"}},
        {"name": "off", "until": "end", "controller": OFF},
    ]
    run = gripper(tmp_path, 1.5, phases=phases, initial={"joints": {"left": 0.01, "right": 0.01}})
    assert run.phases[1].reason == "limit_begins"
    assert run.phases[1].start_s == pytest.approx(run.records["limit_beginnings"][0].time_s, abs=1.1e-3)
    proved(run)


CRANK = """<mujoco>{head}<worldbody><body name="base"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="50" diaginertia="3 3 3"/>
  <body name="crank"><joint name="crank" axis="0 0 -1"/><inertial pos="0 0 0" mass="0.5" diaginertia="0.02 0.02 0.02"/>
    <geom name="pin" size="0.03" pos="0 0.3 0" mass="0"/></body>
  <body name="jaw" pos="0 -0.3 0"><joint name="jaw" type="slide" axis="1 0 0" range="-0.1 0"/>
    <inertial pos="0 0 0" mass="0.2" diaginertia="1e-4 1e-4 1e-4"/></body></body></worldbody>
  <actuator><motor name="crank" joint="crank"/><motor name="jaw" joint="jaw"/></actuator></mujoco>"""
"""A crank that pushes a box along x, and a jaw that is pressed on its stop meanwhile."""


@pytest.mark.long
def test_a_contact_that_opens_within_a_step_is_no_redistribution_of_its_load(tmp_path):
    """The crank swings back from the box: a smooth root of the force, while the jaw stays pressed.

    With ``accuracy`` a trial step reaches beyond the opening; the tensile force there must not look like an error of it.
    """
    path = scene(
        tmp_path,
        CRANK.format(head=HEAD),
        {"box": box(half=(0.1, 0.5, 0.1))},
        contacts={"rules": [{"between": ["pin", "box/box"], "restitution": 0.0}]},
        initial={"joints": {"box/free": [0.13, 0.3, 0, 1, 0, 0, 0]}},
        phases=DRIVEN,
        duration_s=0.14,
        time_step_s=5e-3,
        control_period_s=5e-3,
        accuracy=1e-9,
    )
    run = ffsm_mj.run(path, controllers=driven_by(lambda _: 10.0))
    proved(run)
    end = run.records["contact_endings"][-1]
    assert 0.1305 < end.time_s < 0.1345  # not at a tick, where efforts could jump
    assert end.force_before_N == pytest.approx(0.0, abs=1e-6)
