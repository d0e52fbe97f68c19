"""Servos on every transmission: balance of work and momentum, replay, closed forms of outside ones and a vendor hand."""

from __future__ import annotations

import numpy as np
import pytest

from tests.replays import assert_replayed
from tests.scenario.test_scenario import faults
from tests.scenes import HEAD
from tests.servos.scenes import link, link_scene, playing, run_link, steps
from tests.servos.test_servos import HOLD, RATE, passes

BALL = """<body name="hand" pos="0.2 0.1 0.05"><joint name="wrist" type="ball"/>
  <inertial pos="0.02 0.01 0.03" mass="0.5" diaginertia="0.1 0.12 0.09"/><geom name="hand" size="0.05" mass="0"/>
  <site name="tip" pos="0.1 0 0.02" euler="20 10 30"/></body>"""
MASS = 6.0
OUTSIDE = '<velocity name="servo" site="port" kv="2" gear="1 0 0 0 0 0"/>'


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
    run = run_link(tmp_path, playing(tmp_path, 0.4), model=model, initial=initial, duration_s=0.5, **steps(2e-3))
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
        run = run_link(tmp_path, playing(tmp_path, 0.5), actuators=OUTSIDE, initial={}, duration_s=0.8, **steps(step_s))
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


KP, KV, DAMPING, OPEN = 100.0, 10.0, 1.0, 0.04
_FINGERS = "".join(
    f"""<body name="{name}_finger" pos="0 0 0.0584" quat="{turn}"><inertial mass="0.015" pos="0 0 0"
    diaginertia="2.375e-6 2.375e-6 7.5e-7"/><joint name="{name}" armature="0.1" damping="{DAMPING}" axis="0 1 0" type="slide"
    range="0 0.04"/></body>"""
    for name, turn in (("left", "1 0 0 0"), ("right", "0 0 0 1"))
)
HAND = f"""<mujoco>{HEAD}<worldbody><body name="bus"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="20" diaginertia="2 2 2"/><geom size="0.1" mass="0"/>
  <body name="hand" pos="0.1 0 0" quat="0 0 0 1"><inertial mass="0.73" pos="-0.01 0 0.03" diaginertia="0.001 0.0025 0.0017"/>
  {_FINGERS}</body></body></worldbody>
  <tendon><fixed name="split"><joint joint="left" coef="0.5"/><joint joint="right" coef="0.5"/></fixed></tendon>
  <equality><joint joint1="left" joint2="right"/></equality>
  <actuator><general name="hand" tendon="split" ctrlrange="0 255" forcerange="-100 100" gainprm="0.01568627451"
  biastype="affine" biasprm="0 -{KP} -{KV}"/></actuator></mujoco>"""
FINGER, SPEED = "state.q_robot_left_m", "state.v_robot_left_m_s"
WORK, HEAT = "balance.work_J", "balance.total_damper_heat_J"
AT_END = {FINGER: 0.002345231911, SPEED: -0.024413873141, WORK: 0.013344619293, HEAT: 0.013276075014}
"""At 0.3 s by the closed form of .115 q'' = -(kp q + kv q') / 2 - q' from 0.04 m, with the setpoint 0."""


def closing(folder, step_s):
    """The hand closes from its widest."""
    law = playing(folder, {"robot/hand": 0.0})
    start = {"joints": {"left": OPEN, "right": OPEN}}
    return run_link(folder, law, model=HAND, initial=start, duration_s=0.3, **steps(step_s))


@pytest.mark.parametrize("step_s", [2e-3, 1e-3])
def test_a_hand_closes_as_its_law_says(tmp_path, step_s):
    """Work and heat of the dampers too; the bus feels nothing, and the coupling carries nothing.

    Steps are divided such that errors of the energy add up to 5e-10 J at most, half of what the checks allow at 1 J.
    """
    run = closing(tmp_path, step_s)
    for key, expected in AT_END.items():
        assert run[key][-1] == pytest.approx(expected, abs=5e-10), key
    np.testing.assert_allclose(run["state.q_robot_right_m"], run[FINGER], rtol=0.0, atol=1e-14)
    assert np.abs(run["state.v_robot_free_vx_m_s"]).max() < 1e-14
    assert passes(run)
    assert_replayed(run)


def test_a_gripper_commands_the_servo_of_its_tendon(tmp_path):
    """Both fingers open by its setpoint, k l / gain; what the servo cannot do is refused."""
    law = {"kind": "gripper", "joints": ["left", "right"], "action": "open", "closed_at": 0.0, "open_at": 0.03}
    run = run_link(tmp_path, law, model=HAND, initial={"joints": {"left": 0.01, "right": 0.01}}, duration_s=2.0)
    np.testing.assert_allclose(run["actuators.robot_hand_applied"], KP * 0.03 / 0.01568627451, rtol=1e-14)
    assert run[FINGER][-1] == pytest.approx(0.03, abs=1e-4)
    assert run["state.q_robot_right_m"][-1] == pytest.approx(run[FINGER][-1], abs=1e-12)
    assert passes(run)
    assert_replayed(run)
    for wrong, message in (({"force_N": 3.0}, "a servo presses as its model file says"), ({"open_at": 0.0401}, "beyond")):
        found = faults(path=link_scene(tmp_path, law | wrong, model=HAND, initial={}))
        assert any(message in fault for fault in found), found
