"""The plant's limits, which no controller can bypass."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_mj.actuation.actuation import Actuation
from ffsm_mj.actuation.config import OnOffConfig, TorqueSpeedConfig
from ffsm_mj.controller_protocol import Command
from ffsm_mj.errors import ControllerError, ScenarioFaults
from tests.scenes import HEAD, compile_paths

MOTOR = TorqueSpeedConfig(kind="torque_speed", stall_torque_N_m=14.0, no_load_speed_rad_s=0.54)
THRUSTER = OnOffConfig(kind="on_off", force_N=50.0, threshold_N=1.0)


@pytest.fixture
def plant(case_study):
    data = mujoco.MjData(case_study.mj)
    actuation = Actuation(case_study, {"motor_1": MOTOR, "thruster_x": THRUSTER}, data)

    def apply(name, effort, rate=0.0, powered=True):
        i = case_study.index("actuator", name)
        data.qvel[:] = 0.0
        data.qvel[3] = rate
        mujoco.mj_forward(case_study.mj, data)
        command = Command.off(case_study.mj.nu)
        command.effort[i], command.powered[i] = effort, powered
        actuation.apply(command, data, 0.0)
        return float(data.ctrl[i])

    return apply


@pytest.mark.parametrize(
    ("asked", "rate", "given"),
    [
        (20.0, 0.0, 14.0),
        (-20.0, 0.0, -14.0),
        (5.0, 0.0, 5.0),
        (20.0, 0.27, 7.0),  # half the no-load speed leaves half the stall torque
        (-30.0, 0.27, -21.0),  # and adds to braking
        (0.0, 0.81, -7.0),  # above the no-load speed the line (34) excludes zero: a powered motor brakes
    ],
)
def test_torque_speed_line(plant, asked, rate, given):
    assert plant("motor_1", asked, rate) == pytest.approx(given, rel=1e-14)


def test_a_motor_that_is_off_is_exactly_zero_above_its_no_load_speed(plant):
    assert plant("motor_1", 3.0, rate=0.81, powered=False) == 0.0


@pytest.mark.parametrize(("asked", "given"), [(0.99, 0.0), (1.0, 0.0), (1.01, 50.0), (-70.0, -50.0), (0.0, 0.0)])
def test_thruster_is_off_or_fully_on(plant, asked, given):
    assert plant("thruster_x", asked) == given


def test_an_actuator_without_limits_is_ideal(plant):
    assert plant("wheel", 1e6) == 1e6


def test_efforts_that_are_not_finite_are_refused(plant):
    with pytest.raises(ControllerError, match="non-finite effort for robot/wheel"):
        plant("wheel", np.nan)
    assert plant("wheel", np.nan, powered=False) == 0.0


def model(tmp_path, actuator):
    (tmp_path / "r.xml").write_text(
        f"""<mujoco>{HEAD}<worldbody><body name="b"><freejoint/><geom size="0.1"/>
        <body name="arm"><joint name="j" axis="0 0 1"/><geom size="0.1" pos="1 0 0"/></body></body></worldbody>
        <actuator>{actuator}</actuator></mujoco>"""
    )
    return compile_paths(tmp_path / "r.xml")


def test_effort_is_at_the_joint_whatever_the_gear(tmp_path):
    """Gear 50: a joint torque of 10 N m is 0.2 at the motor; the line is the joint's."""
    system = model(tmp_path, '<motor name="m" joint="j" gear="50"/>')
    data = mujoco.MjData(system.mj)
    data.qvel[6] = 0.27
    mujoco.mj_forward(system.mj, data)
    actuation = Actuation(system, {"m": MOTOR}, data)
    command = Command.off(1)
    command.drive(np.array([0]), np.array([100.0]))
    actuation.apply(command, data, 0.0)
    mujoco.mj_fwdActuation(system.mj, data)
    assert data.qfrc_actuator[6] == pytest.approx(7.0, rel=1e-14)
    assert actuation.applied[0] == pytest.approx(7.0, rel=1e-14)


def test_mjcf_ranges_are_kept(tmp_path):
    system = model(tmp_path, '<motor name="m" joint="j" gear="2" ctrlrange="-1 3" ctrllimited="true"/>')
    data = mujoco.MjData(system.mj)
    mujoco.mj_forward(system.mj, data)
    actuation = Actuation(system, {}, data)
    command = Command.off(1)
    command.drive(np.array([0]), np.array([-50.0]))
    actuation.apply(command, data, 0.0)
    assert actuation.applied[0] == -2.0
    assert actuation.table[0].tolist() == [-50.0, -2.0, -2.0, 6.0]  # asked for, delivered, and the bounds


def test_limits_of_motors_are_refused_for_servos(tmp_path):
    system = model(tmp_path, '<position name="servo" joint="j" kp="5"/>')
    with pytest.raises(ScenarioFaults, match="servo is a servo, and torque_speed is a limit of motors"):
        Actuation(system, {"servo": MOTOR}, mujoco.MjData(system.mj))
