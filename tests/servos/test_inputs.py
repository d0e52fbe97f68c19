"""Controllers with several inputs: a setpoint each, closed forms, ranges, laws, replays, restarts; motors without inputs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import ControllerError
from ffsm_mj.replay import replay_log
from tests.laws import Law
from tests.replays import assert_replayed
from tests.scenario.test_scenario import faults
from tests.servos.scenes import START, link, link_scene, playing, run_link, steps
from tests.servos.test_activations import ACTIVATION, CASES
from tests.servos.test_servos import ANGLE, RATE, passes
from tests.simulation.restored import goes_on, is_rest_of

PID = '<pid name="servo" joint="j" kp="8" kv=".6" ki="20"/>'
POSITION, SPEED = "actuators.robot_servo_applied_rad", "actuators.robot_servo_vel_applied_rad_s"
SECOND = """<body name="two" pos="0 0.3 0"><joint name="k" axis="0 1 0"/>
  <inertial pos="0 0 0" mass="1" diaginertia="0.3 0.3 0.3"/><geom name="two" size="0.05" mass="0"/></body>"""


def run_of(folder, actuators, given, duration_s, **scenario):
    initial = START | {"activations": {"servo": 0.0}}
    return run_link(folder, playing(folder, given), actuators=actuators, initial=initial, duration_s=duration_s, **scenario)


@pytest.mark.parametrize(
    ("actuator", "duration_s", "expected"),
    [
        # With z' = u - q a linear system of three states.
        (PID, 1.0, (0.763700284353, -3.553404827190, -0.179127927080)),
        # The integral stops at imax from .060340469475 to .368605306447 s.
        (PID.replace("/>", ' imax=".0303"/>'), 0.3, (0.551642478531, 2.127737720125, 0.0303)),
    ],
)
def test_a_controller_of_angle_and_rate_moves_as_its_law_says(tmp_path, actuator, duration_s, expected):
    """To order four, or the error of divided steps, with its integral free and at its limit."""
    errors = []
    for step_s in (4e-3, 1e-3):
        run = run_of(tmp_path, actuator, {POSITION: 0.7, SPEED: 0.5}, duration_s, **steps(step_s))
        assert passes(run), [check for check in run.checks() if not check.passes]
        errors.append(max(abs(run[key][-1] - value) for key, value in zip((ANGLE, RATE, ACTIVATION), expected, strict=True)))
    assert errors[0] < 1e-8
    # The limit is met within the error of the root, 1e-9 of it, of which 3e-11 is left in the integral.
    assert errors[1] < 5e-11
    assert_replayed(run)


def test_the_feedforward_and_the_voltage_of_a_motor_are_torques(tmp_path):
    """Its controller delivers its torque exactly, and a voltage V gives K V / R on top: as a servo in torques does."""
    pid = '<pid name="servo" joint="j" kp="8" kv=".6" input="pos vel ff"/>'
    motor = '<dcmotor name="servo" joint="j" motorconst=".5" resistance="2" controller="8 0 .6" input="pos vel ff voltage"/>'
    given = {POSITION: 0.7, SPEED: 0.5, "actuators.robot_servo_ff_applied_N_m": 0.3}
    law = playing(tmp_path, given | {"actuators.robot_servo_voltage_applied_V": 0.8})
    one = run_link(tmp_path, law, actuators=motor, duration_s=0.5)
    assert passes(one)
    law = playing(tmp_path, given | {"actuators.robot_servo_ff_applied_N_m": 0.3 + 0.5 * 0.8 / 2.0})
    other = run_link(tmp_path, law, actuators=pid, duration_s=0.5)
    np.testing.assert_allclose(one[ANGLE], other[ANGLE], rtol=0.0, atol=1e-13)
    assert_replayed(one)


def both(first, second):
    """Base with two links: a controller each, and motors around them."""
    motors = ['<motor name="push" site="port" gear="1 0 0 0 0 0"/>', '<motor name="turn" joint="k" gear="3"/>']
    return link(f"{motors[0]}{first}{motors[1]}{second}", link_body=SECOND)


FIRST = '<pid name="one" joint="j" kp="3" kv=".2" slewmax="2" velrange="-.1 .1"/>'
OTHER = '<dcmotor name="other" joint="k" motorconst=".2" resistance="1" controller="2 0 .1" input="vel ff"/>'
GIVEN = {
    "robot/push_N": 0.2,
    "robot/one": 0.4,
    "robot/one.vel": 0.5,
    "robot/other": 0.1,
    "robot/other.ff": 0.05,
    "turn_N_m": 0.02,
}


@pytest.fixture(scope="module")
def mixed(tmp_path_factory):
    """A run with two controllers of several inputs between motors, and its folder."""
    folder = tmp_path_factory.mktemp("mixed")
    run = run_link(folder, playing(folder, GIVEN), model=both(FIRST, OTHER), duration_s=0.3, initial={})
    return run, folder


def test_controllers_and_motors_have_one_file(mixed):
    """Indices of controls, actuators and forces agree, and each command is under its name, within its range."""
    run, folder = mixed
    assert passes(run)
    model = prepare(folder / "scene.yaml").system.mj
    assert model.nu == model.nactuator == model.nout == 6
    names = [model.actuator(i).name for i in range(model.nu)]
    assert names == [f"robot/{each}" for each in ("push", "turn", "one", "one.vel", "other", "other.ff")]
    for column, value in (
        ("push_applied_N", 0.2),
        ("turn_applied_N_m", 0.02),
        ("one_command_rad", 0.4),
        ("one_vel_command_rad_s", 0.5),
        ("one_vel_applied_rad_s", 0.1),
        ("one_vel_upper_rad_s", 0.1),
        ("other_applied_rad_s", 0.1),
        ("other_ff_applied_N_m", 0.05),
    ):
        assert set(run[f"actuators.robot_{column}"]) == {value}, column
    assert "actuators.robot_one_vel_force_N_m" not in run.keys
    # At rest at l = 0: 3 (0 - 0) + .2 (.1 - 0), as the setpoint of the slewed angle begins at 0; -2 * 0 + .1 * .1 + .05.
    assert run["actuators.robot_one_force_N_m"][0] == pytest.approx(0.02, abs=1e-14)
    assert run["actuators.robot_other_force_N_m"][0] == pytest.approx(0.06, abs=1e-14)
    assert_replayed(run)


def test_a_file_has_its_controllers_in_any_order(mixed, tmp_path):
    """The motion is the same; without the places of the further inputs the commands would go elsewhere."""
    other = run_link(tmp_path, playing(tmp_path, GIVEN), model=both(OTHER, FIRST), duration_s=0.3, initial={})
    for key in (ANGLE, RATE, "state.q_robot_k_rad", "balance.work_J"):
        np.testing.assert_allclose(other[key], mixed[0][key], rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("column", ["one_vel_applied_rad_s", "other_ff_applied_N_m"])
def test_a_changed_setpoint_in_a_log_is_found(mixed, column):
    run, rows = mixed[0], mixed[0].log.rows.copy()
    rows[50, run.keys.index(f"actuators.robot_{column}")] -= 1e-3
    again = replay_log(replace(run.log, rows=rows))
    assert not again.agrees or again.obstacle


class NotANumber(Law):
    """Commands a rate that is none from 0.05 s on."""

    def __init__(self, config, context):
        self._rate = context.system.index("actuator", "servo.vel")

    def control(self, observation, command):
        command.set([self._rate], np.nan if observation.time_s >= 0.05 else 0.1)


@pytest.mark.parametrize(
    "actuator",
    [
        PID,
        '<pid name="servo" joint="j" kp="8" kv=".6" input="pos"/>',
        '<pid name="servo" joint="j" kp="8" kv=".6" input="vel ff"/>',
        '<dcmotor name="servo" joint="j" motorconst=".5" resistance="2" controller="8 0 .6" input="pos vel voltage"/>',
    ],
)
def test_laws_of_joints_drive_controllers(tmp_path, actuator):
    """On the fastest path the error stays at that of the wanted acceleration, kp e = I q'': no lag of the rate."""
    path = {"kind": "joint_path", "waypoints": [{"at_s": 1.0, "positions": [0.5]}]}
    run = run_link(tmp_path, path, actuators=actuator.replace(' ki="20"', ""), initial={"joints": {"j": 0.2}})
    u = run.time
    wanted = 0.2 + 0.3 * (10.0 * u**3 - 15.0 * u**4 + 6.0 * u**5)
    # Greatest q'' of the path 10/sqrt(3) * .3 = 1.73: e = .4 * 1.73 / 8 = .087, and as much again of the oscillation; with
    # a lag of kv q' / kp it would be .042 rad at the greatest rate alone, for which the error at rest at the end stands.
    assert np.abs(run[ANGLE] - wanted).max() < 0.17
    assert passes(run)
    hold = run_link(tmp_path, {"kind": "hold"}, actuators=actuator, initial={"joints": {"j": 0.2}}, duration_s=0.2)
    assert np.abs(hold[RATE]).max() < 1e-15
    assert_replayed(hold)


def test_a_motor_without_inputs_brakes_and_takes_no_command(tmp_path):
    """Shorted, it brakes with K^2 / R, and the joint's motor is driven by laws; its command stays zero."""
    passive = '<dcmotor name="brake" joint="j" motorconst=".5" resistance="1" input="none"/>'
    run = run_link(tmp_path, {"kind": "off"}, actuators=f'{passive}<motor name="motor" joint="j"/>', duration_s=1.0)
    assert run[RATE][-1] == pytest.approx(-0.3 * np.exp(-0.25 / 0.4), abs=1e-11)
    law = {"kind": "hold", "bandwidth_rad_s": 4.0}
    held = run_link(tmp_path, law, actuators=f'{passive}<motor name="motor" joint="j"/>', duration_s=0.1)
    assert held["actuators.robot_motor_applied_N_m"].any()
    assert not held["actuators.robot_brake_applied_V"].any()
    assert passes(run)
    assert passes(held)


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ("servo.vel", "has an input 'servo.vel', and so is another"),
        ("servo_vel", "both logged as actuators.robot_servo_vel;"),
    ],
)
def test_the_name_of_an_input_is_free(tmp_path, other, message):
    """In the model, and in columns that differ in their units alone."""
    path = link_scene(tmp_path, {"kind": "off"}, actuators=f'{PID}<motor name="{other}" joint="j"/>')
    (fault,) = faults(path=path)
    assert "robot.xml:" in fault
    assert message in fault


def test_names_in_a_scenario_are_those_of_inputs(tmp_path):
    """Delays are those of the controller unless stated; ``kind: torque`` is of the controller, and is told."""
    model = both(FIRST, OTHER).replace('name="other"', 'name="other" delay=".004" nsample="9"')
    path = link_scene(tmp_path, playing(tmp_path, GIVEN), model=model, initial={}, duration_s=0.01)
    run = ffsm_mj.run(path, {"actuators": {"one": {"kind": "ideal", "delay_s": 0.002}}})
    for name, delay_s in (("turn_applied_N_m", 0.0), ("one_vel_applied_rad_s", 0.002), ("other_ff_applied_N_m", 0.004)):
        assert run.time[np.flatnonzero(run[f"actuators.robot_{name}"])[0]] == pytest.approx(delay_s), name
    (fault,) = faults("actuators={one.vel: {kind: torque}}", path=path)
    assert "'robot/one: {kind: torque}' makes it a motor" in fault
    path = link_scene(tmp_path, {"kind": "off"}, model=model, initial={})
    motor = prepare(path, {"actuators": {"one": {"kind": "torque"}}}).system
    assert motor.names("actuator") == ("robot/push", "robot/one", "robot/turn", "robot/other", "robot/other.ff")


def test_a_setpoint_that_is_no_number_is_named(tmp_path):
    """The log up to it can be read."""
    path = link_scene(tmp_path, {"kind": "none"}, actuators=PID)
    with pytest.raises(ControllerError, match=r"non-finite setpoint for robot/servo\.vel"):
        ffsm_mj.run(path, controllers={"none": NotANumber}, out=tmp_path / "out", rerun=False)
    run = ffsm_mj.load_run(tmp_path / "out")
    assert run.time[-1] >= 0.049
    assert np.isfinite(run["actuators.robot_servo_force_N_m"]).all()


@pytest.mark.long(one_of=4)
@pytest.mark.parametrize("what", [what for what in CASES if what != "motor without inductance"] + ["of two controllers"])
def test_a_run_goes_on_from_activations_and_setpoints(tmp_path, what):
    """From bytes, bit by bit, in every kind of activation; of setpoints in mid-ramp, which no law commands any more."""
    if what in CASES:
        path = link_scene(tmp_path, playing(tmp_path, 0.7), actuators=CASES[what][0], duration_s=0.1)
    else:
        phases = [
            {"name": "go", "for_s": 0.05, "controller": playing(tmp_path, GIVEN)},
            {"name": "off", "until": "end", "controller": {"kind": "off"}},
        ]
        path = link_scene(tmp_path, {}, model=both(FIRST, OTHER), phases=phases, duration_s=0.2, initial={})
    assert is_rest_of(*goes_on(path, at_s=0.1 if what not in CASES else 0.05))
