"""Servos on every transmission: work and momentum balance, replay, and closed forms of those that act from outside."""

from __future__ import annotations

import numpy as np
import pytest

from ffsm_mj.dynamics.actuators import ExternalServos
from tests.replays import assert_replayed
from tests.servos.scenes import link, run_link, steps
from tests.servos.test_servos import HOLD, RATE, passes

BALL = """<body name="hand" pos="0.2 0.1 0.05"><joint name="wrist" type="ball"/>
  <inertial pos="0.02 0.01 0.03" mass="0.5" diaginertia="0.1 0.12 0.09"/><geom name="hand" size="0.05" mass="0"/>
  <site name="tip" pos="0.1 0 0.02" euler="20 10 30"/></body>"""
MASS = 6.0
OUTSIDE = '<velocity name="servo" site="port" kv="2" gear="1 0 0 0 0 0"/>'


def law(setpoint, folder):
    """Plays a constant setpoint."""
    (folder / "setpoints.csv").write_text(f"time_s,actuators.robot_servo_applied\n0,{setpoint}\n9,{setpoint}\n")
    return {"kind": "playback", "file": "setpoints.csv"}


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize(
    "actuator",
    [
        '<position name="servo" joint="wrist" kp="3" kv=".2" gear="0.6 0 0.8"/>',
        '<position name="servo" jointinparent="wrist" kp="3" kv=".2" gear="0.6 0 0.8"/>',
        '<intvelocity name="servo" joint="wrist" kp="3" kv=".2" gear="0 1 0" actrange="-2 2"/>',
        '<position name="servo" site="tip" refsite="port" kp="3" kv=".2" gear="1 0.4 0 0 0 0.3"/>',
        '<position name="servo" cranksite="tip" slidersite="port" cranklength=".6" kp="3" kv=".2"/>',
        '<velocity name="servo" site="port" kv="2" gear="0.6 0.3 -0.2 0.1 -0.4 0.3"/>',
        '<velocity name="servo" site="tip" kv="2" gear="0.6 0.3 -0.2 0.1 -0.4 0.3" forcerange="-.7 .7"/>',
        '<velocity name="servo" joint="free" kv="2" gear="0.6 0.3 -0.2 0.1 -0.4 0.3"/>',
        '<position name="servo" site="tip" kp="2" kv=".3" timeconst=".05" gear="0.6 0.3 -0.2 0.1 -0.4 0.3"/>',
    ],
)
def test_work_and_momenta_are_balanced(tmp_path, actuator):
    """With both joints and the base in motion; internal servos keep the momenta, the others change them."""
    rates = {"free": [0.1, -0.05, 0.02, 0.3, -0.2, 0.1], "j": 0.4, "wrist": [0.5, -0.3, 0.2]}
    initial = {"joints": {"j": 0.2, "wrist": [0.8, 0.2, -0.4, 0.4]}, "rates": rates}
    model = link(actuator, link_body=BALL)
    run = run_link(tmp_path, law(0.4, tmp_path), model=model, initial=initial, duration_s=0.5, **steps(2e-3))
    assert passes(run), [check for check in run.checks() if not check.passes]
    momenta = np.stack([run[f"momentum.robot_{name}_{at}"] for name, at in _COMPONENTS], axis=1)
    external = np.stack([run[f"balance.external_{name}_{at}"] for name, at in _COMPONENTS], axis=1)
    # Truncation of 250 steps at 2 ms is 1e-11 of the size of the momenta.
    np.testing.assert_allclose(momenta - momenta[0], external, rtol=0.0, atol=1e-10)
    acts_outside = 'joint="free"' in actuator or ("site=" in actuator and "ref" not in actuator and "crank" not in actuator)
    assert (np.abs(external).max() > 1e-3) == acts_outside
    assert abs(run["balance.work_J"][-1]) > 1e-4
    assert_replayed(run)


@pytest.mark.parametrize(
    ("where", "unit", "ending"),
    [
        ('joint="wrist" gear="1 0 0"', "N_m", ""),
        ('jointinparent="wrist"', "N_m", ""),
        ('joint="free"', "N", ""),
        ('joint="j"', "N_m", "_rad_s"),
    ],
)
def test_a_force_has_its_unit(tmp_path, where, unit, ending):
    """A torque on a ball joint, as on a hinge; a setpoint has one on hinges and slides alone."""
    actuator = f'<velocity name="servo" {where} kv="1"/>'
    run = run_link(tmp_path, {"kind": "off"}, model=link(actuator, link_body=BALL), initial={}, duration_s=0.01)
    assert f"actuators.robot_servo_force_{unit}" in run.keys
    assert f"actuators.robot_servo_command{ending}" in run.keys


_COMPONENTS = [("P", "x_N_s"), ("P", "y_N_s"), ("P", "z_N_s"), ("L", "x_N_m_s"), ("L", "y_N_m_s"), ("L", "z_N_m_s")]


def test_a_servo_from_outside_moves_the_whole(tmp_path):
    """By m v' = kv (u - v) from rest, of order four; the impulse is m v, the work what the kinetic energy gains."""
    errors = []
    for step_s in (8e-3, 4e-3):
        run = run_link(tmp_path, law(0.5, tmp_path), actuators=OUTSIDE, initial={}, duration_s=0.8, **steps(step_s))
        speed = 0.5 * (1.0 - np.exp(-2.0 * run["state.time_s"] / MASS))
        errors.append(np.abs(run["state.v_robot_free_vx_m_s"] - speed).max())
        np.testing.assert_allclose(run["balance.external_P_x_N_s"], MASS * speed, rtol=0.0, atol=1e-10)
        np.testing.assert_allclose(run["balance.work_J"], 0.5 * MASS * speed**2, rtol=0.0, atol=1e-10)
        assert passes(run)
    assert errors[1] < errors[0] / 12.0 + 1e-15


@pytest.mark.parametrize("of_tendon", [False, True])
def test_damping_of_an_actuator_is_that_of_its_target(tmp_path, of_tendon):
    """Times the square of the gear, in all three coefficients, outside the limits of its force; heat is in the balance."""
    tendon = '<tendon><fixed name="t" {}><joint joint="j" coef="-2"/></fixed></tendon>'
    servo = '<position name="servo" {}="{}" kp="8" gear="3" forcerange="-.5 .5" {}/>'
    target = ("tendon", "t") if of_tendon else ("joint", "j")
    own = link(servo.format(*target, 'damping=".02 .01 .03"'), joint='damping=".1"')
    of_target = 'damping=".18 .09 .27"' if of_tendon else 'damping=".28 .09 .27"'
    other = link(servo.format(*target, ""), joint='damping=".1"' if of_tendon else of_target)
    runs = []
    for model, damping in ((own, ""), (other, of_target if of_tendon else "")):
        whole = model.replace("</mujoco>", f"{tendon.format(damping)}</mujoco>")
        runs.append(run_link(tmp_path, {"kind": "off"}, model=whole, duration_s=0.3))
        assert passes(runs[-1])
    np.testing.assert_allclose(runs[0].log.rows, runs[1].log.rows, rtol=0.0, atol=1e-14)
    assert runs[0]["balance.total_damper_heat_J"][-1] > 1e-4
    assert_replayed(runs[0])


def test_a_law_of_joints_ignores_a_servo_from_outside(tmp_path):
    """The motor of the joint is driven though the servo at the link's site moves it too."""
    tip = '<site name="tip" pos="0.2 0 0"/>'
    actuators = '<motor name="motor" joint="j"/><velocity name="servo" site="tip" kv=".1"/>'
    run = run_link(tmp_path, HOLD | {"bandwidth_rad_s": 4.0}, model=link(actuators, link_body=tip), duration_s=1.0)
    assert abs(run[RATE][-1]) < 0.2
    assert passes(run)


def test_the_impulse_of_a_servo_from_outside_is_checked(tmp_path, monkeypatch):
    """The control: an impulse entered twice fails the momentum balance."""
    wrench = ExternalServos._wrench
    monkeypatch.setattr(ExternalServos, "_wrench", lambda self, servo: 2.0 * wrench(self, servo))
    assert not passes(run_link(tmp_path, law(0.5, tmp_path), actuators=OUTSIDE, initial={}, duration_s=0.1))
