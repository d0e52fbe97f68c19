"""The shipped scenarios of a linkage gripper and of an arm with its own servos: checks, replay, statics and closed forms."""

from __future__ import annotations

import runpy
from pathlib import Path

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from tests.replays import proved

DOCS = Path(__file__).parents[2] / "docs"
FINGERS = ("right", "left")


def assert_shipped(run):
    assert proved(run).unhandled_contacts == ()


@pytest.fixture(scope="module")
def gripped():
    return ffsm_mj.run("gripper-2f85")


def test_a_linkage_gripper_holds_a_cube_by_friction_and_lets_it_go(gripped):
    """No slip while it swings; from the release on the cube has its velocity and no force."""
    run = gripped
    assert_shipped(run)
    assert [phase.name for phase in run.phases] == ["close", "swing", "let_go"]
    swing, free = (run.time > 0.5) & (run.time < 1.7), run.time > 1.72
    assert run.qpos[swing][-1, prepare("gripper-2f85").system.joint("wrist").qpos][0] > 0.75
    for finger in FINGERS:
        assert np.ptp(run[f"contact.{finger}_slip_m"][swing]) == 0.0
        assert 0.3 < run[f"contact.{finger}_friction_use"][swing].max() < 1.0
        assert not run[f"contact.{finger}_force_N"][free].any()
    for axis in "xyz":
        # A free body: its velocity is constant to the rounding of the steps.
        assert np.ptp(run[f"state.v_cube_free_v{axis}_m_s"][free]) < 1e-13


def test_loads_in_the_linkage_are_in_equilibrium(gripped):
    """All is at rest after the grip: a pin's moment on its coupler is what the stop takes, on both drivers the servo's.

    To the 1e-9 m and 1e-8 m/s within which contacts are at rest: forces of 130 N at arms of 5 cm.
    """
    run = gripped
    row = int(np.searchsorted(run.time, 0.45))
    model = prepare("gripper-2f85").system.mj
    data = mujoco.MjData(model)
    data.qpos[:] = run.qpos[row]
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    total = 0.0
    for finger in FINGERS:
        # The constraint acts on the follower; its reaction on the coupler.
        force = -np.array([run[f"contact.robot_{finger}_pin_force_{x}_N"][row] for x in "xyz"])
        pin = data.site(f"robot/{finger}_pin_coupler").xpos

        def moment(joint, force=force, pin=pin):
            one = data.joint(f"robot/{joint}")
            return float(one.xaxis @ np.cross(pin - one.xanchor, force))

        stop = float(run[f"contact.robot_{finger}_coupler_limit_torque_N_m"][row])
        assert moment(f"{finger}_coupler") == pytest.approx(-stop, abs=1e-6)
        total += moment(f"{finger}_driver")
    assert float(run["contact.robot_right_coupler_limit_torque_N_m"][row]) == 0.0
    # The tendon is half the sum of the drivers' angles: both together get the servo's force, which is at its limit.
    assert run["actuators.robot_fingers_force_N"][row] == 5.0
    assert total == pytest.approx(-5.0, abs=1e-6)


def test_servos_of_an_arm_take_an_impact():
    """Friction leaves each joint within f / kp of its setpoint, and all heat, work and impact energy in the balance."""
    run = ffsm_mj.run("servo-arm")
    assert_shipped(run)
    assert len(run.impacts) >= 1
    system = prepare("servo-arm").system
    limits = {"pan": 8.0, "lift": 8.0, "elbow": 8.0, "wrist_1": 2.0, "wrist_2": 2.0, "wrist_3": 2.0}
    for name, limit in limits.items():
        joint, servo = system.joint(name), system.mj.actuator(f"robot/{name}")
        off = abs(run.qpos[-1][joint.qpos][0] - run.qpos[0][joint.qpos][0])
        # One that still slides nears that end as .02 rad exp(-kp/kv t), after 1.7 s to 4e-6 rad.
        assert off < limit / servo.gainprm[0] + 5e-6
    assert np.abs(run["actuators.robot_wrist_1_force_N_m"]).max() == 28.0  # at the limit of its force
    assert run["balance.total_joint_friction_heat_J"][-1] > 0.0


def test_an_impact_does_not_see_the_drives():
    """Impulse of the first impact with servos, and with ideal motors and no friction: forces that are bounded have none."""
    joints = ("pan", "lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
    motors = {
        "actuators": {joint: {"kind": "torque"} for joint in joints},
        "phases.before.controller.bandwidth_Hz": 2.0,
        "phases.after.controller.bandwidth_Hz": 2.0,
        "robot.strip": ["frictionloss"],
        "duration_s": 0.22,
    }
    first = [ffsm_mj.run("servo-arm", given).impacts[0] for given in ({"duration_s": 0.22}, motors)]
    assert first[0].impulse_N_s == pytest.approx(first[1].impulse_N_s, rel=1e-10)
    assert first[0].time_s == pytest.approx(first[1].time_s, abs=1e-12)


def script(name):
    """What a script of the documentation defines."""
    return runpy.run_path(str(DOCS / f"{name}.py"))


def test_the_table_of_the_linkage_gripper_is_current(gripped):
    page = (DOCS / "grippers.md").read_text()
    assert "\n".join(script("linkage_gripper")["table"](gripped)) in page


@pytest.mark.long
def test_the_table_of_the_servo_arm_is_current():
    made, page = script("servo_arm"), (DOCS / "grippers.md").read_text()
    runs = {name: ffsm_mj.run("servo-arm", overrides) for name, (overrides, *_) in made["DRIVES"].items()}
    assert "\n".join(made["table"](runs)) in page
