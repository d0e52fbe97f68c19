"""Joints that stick and are blocked besides: by couplings, limits and contacts, whose share of the load is a convention."""

from __future__ import annotations

import numpy as np
import pytest

from ffsm_mj.assembly.prepare import prepare
from tests.contact_models.joint_friction.scenes import arm, changes, gear, grip, heat, rubbing, run, slider
from tests.scenes import ball, box
from tests.servos.scenes import START, link
from tests.servos.test_servos import HOLD

pytestmark = pytest.mark.usefixtures("example_contact_models")


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("step_s", [1e-2, 2e-3])
def test_coupled_joints_stop_together(tmp_path, step_s):
    """In all 0.08 N m at B against a reduced inertia of 0.0685 kg m^2."""
    rates = {"a": 1.5, "b": 6.0, "free": [0, 0, 0, 0, 0, -0.9 / 3.45]}
    made = run(tmp_path, gear(), step_s, duration_s=6.0, initial={"rates": rates})
    assert [(joint, *senses) for joint, _, *senses in changes(made)] == [("a", 1, 0), ("b", 1, 0)]
    assert [each[1] for each in changes(made)] == pytest.approx([5.135869565217] * 2, abs=2e-12)
    assert made["state.q_robot_b_rad"][-1] == pytest.approx(15.407608695652, abs=2e-12)
    assert heat(made)[-1] == pytest.approx(1.232608695652, abs=1e-12)


def test_coupled_joints_break_away_together(tmp_path):
    """At n f_A + f_B = 0.08 N m at B, and not where a share of least norm leaves its limit, at 0.0319 N m."""
    load = [{"kind": "drive", "joint": "b", "slope": 0.08}]
    made = run(tmp_path, gear(), 1e-2, duration_s=1.5, contact_models=load)
    assert [(joint, *senses) for joint, _, *senses in changes(made)] == [("a", 0, 1), ("b", 0, 1)]
    assert [each[1] for each in changes(made)] == pytest.approx([1.0] * 2, abs=1e-9)
    assert made["contact.robot_b_friction_torque_N_m"][-1] == -0.03


def test_a_servo_leaves_an_error(tmp_path):
    """A position servo against dry friction stops within f / kp of its setpoint, and stays there."""
    model = link(joint='frictionloss="0.5"')
    phases = [{"name": "all", "until": "end", "controller": HOLD}]
    errors = []
    for step_s in (2e-3, 1e-3):
        made = run(tmp_path, model, step_s, duration_s=2.0, initial=START, phases=phases)
        times = [each[1] for each in changes(made)]
        errors.append(np.abs(np.array(times) - (0.026028927402, 0.738602431068, 1.451175934734)).max())
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.1)
    assert made["state.q_robot_j_rad"][-1] == pytest.approx(0.684179505096, abs=1e-10)
    assert made["contact.robot_j_friction_torque_N_m"][-1] == pytest.approx(-0.126563959234, abs=1e-9)
    assert heat(made)[-1] == pytest.approx(0.457945560183, abs=1e-10)


@pytest.mark.parametrize("load", [0.0, -0.05, 0.05])
def test_light_coupled_joints_stick_at_their_limit(tmp_path, load):
    """Their rows of the limit are held by friction and coupling: of 1e8 (kg m^2)^-1 rounding is left, which is no motion."""
    model = gear().replace('axis="0 0 1"', 'axis="0 0 1" range="0 90" limited="true"')
    for inertia in ("0.4 0.4 0.4", "0.05 0.05 0.05"):
        model = model.replace(inertia, "1e-8 2e-8 1e-8")
    push = [{"kind": "drive", "joint": "b", "amplitude": load, "rate_rad_s": 9.0}]
    made = run(tmp_path, model, 1e-2, duration_s=0.2, contact_models=push)
    assert np.abs(made["state.q_robot_b_rad"]).max() < 1e-12
    assert changes(made) == []


def test_a_limit_carries_force_under_friction_that_begins_to_slide(tmp_path):
    """One joint is pressed on its limit by the friction of the other alone, which slides from the first step on."""
    robot = arm(0.0).replace('name="one" axis="0 0 1"', 'name="one" axis="0 0 1" range="0 90" limited="true"')
    names = "time_s,actuators.robot_one_applied_N_m,actuators.robot_two_applied_N_m"
    (tmp_path / "efforts.csv").write_text(f"{names}\n0,-0.55,-0.5\n1,-0.55,-0.5\n")
    phases = [{"name": "all", "until": "end", "controller": {"kind": "playback", "file": "efforts.csv"}}]
    made = run(tmp_path, robot, duration_s=2e-3, initial={"joints": {"two": 0.7}}, phases=phases)
    assert made["contact.robot_two_sliding"][0] == -1.0
    assert made["contact.robot_one_limit_torque_N_m"][0] > 0.0
    assert len(made.records["limit_beginnings"]) == 1
    assert not made.records["limit_changes"]


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("step_s", [5e-3, 1e-3])
def test_friction_is_idle_at_a_limit(tmp_path, step_s):
    """Pressed by 10 N sin 2t against a friction of 3 N: the limit carries all of it, then the friction what pulls."""
    robot = slider(3.0, 'range="-9 0.2" limited="true"')
    load = [{"kind": "drive", "joint": "s", "amplitude": 10.0, "rate_rad_s": 2.0}]
    made = run(tmp_path, robot, step_s, duration_s=2.0, initial={"joints": {"s": 0.2}}, contact_models=load)
    pressed = made.time < 0.5 * np.pi
    drive = 10.0 * np.sin(2.0 * made.time)
    np.testing.assert_allclose(made["contact.robot_s_limit_force_N"][pressed], -drive[pressed], atol=1e-11)
    assert not made["contact.robot_s_friction_force_N"][pressed].any()
    assert set(made["contact.robot_s_sliding"][pressed][1:]) == {2.0}
    held = (made.time > 0.5 * np.pi) & (made.time < 1.72)
    np.testing.assert_allclose(made["contact.robot_s_friction_force_N"][held], -drive[held], atol=1e-11)
    ((_, time_s, *senses),) = changes(made)
    assert (time_s, *senses) == (pytest.approx(0.5 * (np.pi + np.arcsin(0.3)), abs=1e-12), 0, -1)


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("mu", [0.0, 0.5])
@pytest.mark.parametrize(("right", "force", "friction"), [(2.0, 2.0, 0.0), (2.3, 2.15, 0.15)])
def test_friction_is_idle_in_a_grip(tmp_path, mu, right, force, friction):
    """A free box between two fingers with 0.5 N each: it is pressed by the drives; their difference is shared evenly."""
    rows = "".join(f"{time},2.0,{right}\n" for time in (0, 2))
    (tmp_path / "drive.csv").write_text(f"time_s,actuators.robot_left_applied_N,actuators.robot_right_applied_N\n{rows}")
    made = run(
        tmp_path,
        grip(),
        5e-3,
        {"box": box("box", mass=0.1, half=(0.02, 0.02, 0.02))},
        duration_s=0.2,
        initial={"joints": {"box/free": [0, 0, 0, 1, 0, 0, 0]}},
        contacts={"rules": [{"between": [each, "box/box"], "restitution": 0.0, "mu": mu} for each in ("left", "right")]},
        phases=[{"name": "grip", "until": "end", "controller": {"kind": "playback", "file": "drive.csv"}}],
    )
    for name, sign in (("left", 1.0), ("right", -1.0)):
        assert abs(made[f"contact.{name}_box_box_force_y_N"][-1]) == pytest.approx(force, abs=1e-12)
        assert made[f"contact.robot_{name}_friction_force_N"][-1] == pytest.approx(sign * friction, abs=1e-12)
        assert abs(made[f"state.v_robot_{name}_m_s"][-1]) < 1e-14


def test_the_convention_is_noted(tmp_path):
    """Where a limit or a contact may block a joint with friction, and nowhere else."""

    def noted(robot, objects=None, **keys):
        return any("idle_friction" in note for note in prepare(rubbing(tmp_path, robot, objects=objects, **keys)).notes())

    limited = 'range="-9 0.2" limited="true"'
    rule = {"between": ["mass", "ball/ball"], "restitution": 0.5}
    far = {"initial": {"joints": {"ball/free": [9, 0, 0, 1, 0, 0, 0]}}}
    assert noted(slider(3.0, limited))
    assert not noted(slider(3.0, limited), joint_limits={"s": {"restitution": 1.0}})
    assert not noted(slider(0.0, limited))
    assert not noted(slider(3.0))
    assert noted(slider(3.0), {"ball": ball("ball")}, contacts={"rules": [rule]}, **far)
