"""Servos against closed forms of the link's angle, to order four of the step; what laws command them; kinds; refusals."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import effort
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import ControllerError
from tests.laws import Law
from tests.replays import assert_replayed
from tests.scenario.test_scenario import faults
from tests.servos.scenes import INERTIA, KP, KV, SERVO, link, link_scene, playing, run_link, steps

HOLD = {"kind": "hold", "positions": [0.7]}
ANGLE, RATE = "state.q_robot_j_rad", "state.v_robot_j_rad_s"
PATH = {"kind": "joint_path", "waypoints": [{"at_s": 1.0, "positions": [0.5]}]}


def passes(run):
    return run.outcome == "completed" and all(check.passes for check in run.checks())


@pytest.mark.parametrize(
    ("actuator", "controller", "expected", "at_2_ms"),
    [
        # I_r q'' = kp (u - q) - kv q', from q = .2, q' = -.3: a sum of two exponentials.
        (SERVO, HOLD, (0.839620148366, -1.003061558434, 0.183226498002), 1.3e-10),
        # I_r q'' = kv (u - q'): one exponential.
        (
            '<velocity name="servo" joint="j" kv="0.6"/>',
            None,
            (0.285669418746, 0.321495871881, None),
            1.3e-11,
        ),
    ],
)
def test_a_servo_moves_as_its_law_says(tmp_path, actuator, controller, expected, at_2_ms):
    """To order four in angle, rate and work; the base takes what momentum says."""
    errors = []
    for step_s in (2e-3, 1e-3):
        run = run_link(tmp_path, controller or playing(tmp_path, 0.5), actuators=actuator, **steps(step_s))
        assert passes(run)
        found = run[ANGLE][-1], run[RATE][-1], run["balance.work_J"][-1]
        errors.append(max(abs(a - b) for a, b in zip(found, expected, strict=True) if b is not None))
        np.testing.assert_allclose(run["state.v_robot_free_wz_rad_s"], -0.2 * run[RATE], rtol=0.0, atol=1e-12)
    assert errors[0] < at_2_ms
    assert errors[1] < errors[0] / 12.0 + 5e-13  # 16 of order four, and the rounding of the digits
    assert_replayed(run)


@pytest.mark.parametrize(("setpoint", "applied"), [(0.7, 0.6), (-5.0, -1.0)])
def test_the_log_has_setpoints_and_forces(tmp_path, setpoint, applied):
    """Force before and after the limits of the file; the setpoint within its range is in effect."""
    actuator = SERVO.replace("/>", ' ctrlrange="-1 0.6" forcerange="-2 2"/>')
    run = run_link(tmp_path, playing(tmp_path, setpoint), actuators=actuator, duration_s=0.4)
    assert set(run["actuators.robot_servo_command_rad"]) == {setpoint}
    assert set(run["actuators.robot_servo_applied_rad"]) == {applied}
    assert (run["actuators.robot_servo_lower_rad"][0], run["actuators.robot_servo_upper_rad"][0]) == (-1.0, 0.6)
    law = KP * (applied - run[ANGLE]) - KV * run[RATE]
    np.testing.assert_allclose(run["actuators.robot_servo_unclamped_N_m"], law, rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(run["actuators.robot_servo_force_N_m"], np.clip(law, -2, 2), rtol=0.0, atol=1e-13)
    assert effort(run)["robot_servo"]["at_bound"] == pytest.approx(np.mean(np.abs(law) > 2.0), abs=0.01)
    assert np.abs(law[0]) > 2.0


def test_a_servo_that_nothing_commands_keeps_its_setpoint(tmp_path):
    """At first that at which it exerts no force: the link stays where it is. After a law, the last one."""
    at_rest = {"joints": {"j": 0.2}}
    run = run_link(tmp_path, {"kind": "off"}, initial=at_rest)
    assert set(run["actuators.robot_servo_applied_rad"]) == {0.2}
    assert np.abs(run[RATE]).max() == 0.0
    phases = [
        {"name": "go", "for_s": 0.1, "controller": HOLD},
        {"name": "off", "until": "end", "controller": {"kind": "off"}},
    ]
    run, held = (run_link(tmp_path, HOLD, **given) for given in ({"phases": phases}, {}))
    np.testing.assert_array_equal(run.qpos, held.qpos)


def test_joint_path_has_no_lag_of_first_order(tmp_path):
    """The setpoint contains kv qd_d / kp: what is left is the inertia, I_r qdd_d / kp, and the hold of the setpoint."""
    still = {"joints": {"j": 0.2}}
    run = run_link(tmp_path, PATH, initial=still)
    most = INERTIA * 0.3 * 5.7736 / KP  # of 10 s^3 - 15 s^4 + 6 s^5 the greatest second derivative is 5.77
    assert most / 4.0 < run["controller.path_error_rad"].max() < 1.6 * most
    assert passes(run)
    assert_replayed(run)


def test_velocity_servos_hold_positions_with_a_bandwidth(tmp_path):
    velocity = '<velocity name="servo" joint="j" kv="4"/>'
    path = link_scene(tmp_path, HOLD, actuators=velocity, duration_s=3.0)
    assert any("write 'bandwidth_rad_s'" in fault for fault in faults(path=path))
    run = run_link(tmp_path, HOLD | {"bandwidth_rad_s": 3.0}, actuators=velocity, duration_s=3.0)
    assert run[ANGLE][-1] == pytest.approx(0.7, abs=2e-3)
    assert passes(run)


def test_a_scenario_makes_a_servo_a_motor(tmp_path):
    """With ``kind: torque`` it moves as the motor of another file, bit by bit; laws that compute efforts ask for it."""
    hold = HOLD | {"bandwidth_rad_s": 4.0}
    path = link_scene(tmp_path, {"kind": "pd", "kp": 1.0, "kd": 1.0, "target": [0.7]}, actuators=SERVO)
    assert any("write 'actuators: {robot/servo: {kind: torque}}'" in fault for fault in faults(path=path))
    assert any("with gains of their own: leave it out" in fault for fault in faults(path=link_scene(tmp_path, hold)))
    actuator = SERVO.replace("/>", ' ctrlrange="-1 1" forcerange="-2 2"/>')
    as_motor = {"actuators": {"servo": {"kind": "torque"}}}
    run = ffsm_mj.run(link_scene(tmp_path, hold, actuators=actuator), as_motor)
    motor = ffsm_mj.run(link_scene(tmp_path, hold, actuators='<motor name="servo" joint="j" forcerange="-2 2"/>'))
    np.testing.assert_array_equal(run.log.rows, motor.log.rows)
    assert_replayed(run)


@pytest.mark.parametrize(
    ("actuator", "expected"),
    [
        ('<orientation name="servo" site="port" refsite="port" kp="1"/>', "is an <orientation> servo"),
        ('<adhesion name="servo" body="link" ctrlrange="0 1"/>', "is an <adhesion>"),
    ],
)
def test_what_is_not_modelled_is_refused_by_name(tmp_path, actuator, expected):
    found = faults(path=link_scene(tmp_path, {"kind": "off"}, actuators=actuator))
    assert any("robot.xml:" in fault and "actuator 'servo'" in fault and expected in fault for fault in found), found


class Damping(Law):
    """Damps the joint by efforts, as a law of a user."""

    def control(self, observation, command):
        command.drive([0], -observation.data.qvel[6])


@pytest.mark.parametrize("parts", [False, True])
def test_efforts_of_a_law_of_a_user_are_no_setpoints(tmp_path, parts):
    """Joint, actuator and the key that makes a motor of it, with which the law damps."""
    given = {"controllers": {"one": {"kind": "mine"}}} if parts else {"controller": {"kind": "mine"}}
    path = link_scene(tmp_path, {}, phases=[{"name": "all", "until": "end", **given}], duration_s=0.1)
    expected = "a servo drives robot/j; write 'actuators: {robot/servo: {kind: torque}}'"
    with pytest.raises(ControllerError, match=expected.replace("{", r"\{")):
        ffsm_mj.run(path, controllers={"mine": Damping})
    run = ffsm_mj.run(path, {"actuators": {"servo": {"kind": "torque"}}}, controllers={"mine": Damping})
    assert run[RATE][-1] == pytest.approx(-0.3 * np.exp(-0.1 / INERTIA), rel=1e-3)
    assert passes(run)


CLAMPED = SERVO.replace("/>", ' forcerange="-2.5 2.5"/>')


def clamped(limit_of_joint):
    """The servo with a limit of its own, or of its joint."""
    if limit_of_joint:
        return link(joint='actuatorfrcrange="-2.5 2.5"')
    return link(CLAMPED)


@pytest.mark.parametrize("limit_of_joint", [False, True])
def test_the_step_ends_where_a_force_leaves_its_limit(tmp_path, limit_of_joint):
    """At 2.5 N m up to t = .233631924368 s, then the law: order four through the kink, which is not of the time grid."""
    errors = []
    for step_s in (2e-3, 1e-3):
        run = run_link(tmp_path, HOLD, model=clamped(limit_of_joint), **steps(step_s))
        errors.append(max(abs(run[ANGLE][-1] - 0.892752953622), abs(run[RATE][-1] + 0.848279952140)))
        assert passes(run)
    assert errors[0] < 7e-10
    assert errors[1] < errors[0] / 10.0 + 1e-12
    assert_replayed(run)


def test_tendons_are_measured(tmp_path):
    """Length, rate and force of the servo's tendon, -2 of the joint; its setpoint is the length at the start, -0.4 rad."""
    sensors = "".join(f'<{kind} name="{kind}" tendon="t"/>' for kind in ("tendonpos", "tendonvel", "tendonactuatorfrc"))
    tendon = '<tendon><fixed name="t"><joint joint="j" coef="-2"/></fixed></tendon>'
    model = link('<position name="servo" tendon="t" kp="2" kv="0.15"/>')
    model = model.replace("</mujoco>", f"{tendon}<sensor>{sensors}</sensor></mujoco>")
    run = run_link(tmp_path, {"kind": "off"}, model=model, duration_s=0.1)
    length, rate = run["sensor.robot_tendonpos_rad"], run["sensor.robot_tendonvel_rad_s"]
    np.testing.assert_allclose(length, -2.0 * run[ANGLE], rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(rate, -2.0 * run[RATE], rtol=0.0, atol=1e-15)
    force = run["sensor.robot_tendonactuatorfrc_N_m"][1:]  # the first sample is taken before anything is powered
    np.testing.assert_allclose(force, 2.0 * (-0.4 - length[1:]) - 0.15 * rate[1:], rtol=0.0, atol=1e-14)
    assert passes(run)
    assert_replayed(run)


@pytest.mark.parametrize(
    ("kp", "line"),
    [
        (
            KP,
            "  servos: 1, fastest rate 4.472 1/s with springs, dampers and activations; steps are explicit",
        ),  # sqrt(kp / I)
        (
            1e6,
            "  servos: 1, fastest rate 1581 1/s with springs, dampers and activations; steps are implicit and divided where "
            "their error needs it",
        ),
    ],
)
def test_check_says_how_fast_servos_are_and_which_steps_they_need(tmp_path, kp, line):
    actuator = f'<position name="servo" joint="j" kp="{kp}" kv="{KV}"/>'
    assert line in prepare(link_scene(tmp_path, HOLD, actuators=actuator)).describe()


@pytest.mark.parametrize(
    "keys", [{"controller": {**HOLD, "joints": ["j"]}}, {"controllers": {"one": {**HOLD, "joints": ["j"]}}}]
)
def test_a_servo_that_no_law_commands_is_not_called_free(tmp_path, keys):
    """It keeps its setpoint; of a motor in its place the note stays."""
    second = '<body name="two"><joint name="k" axis="0 1 0"/><geom size="0.1" mass="1"/></body>'
    notes = []
    for other in ('<position name="other" joint="k" kp="1"/>', '<motor name="other" joint="k"/>'):
        phases = [{"name": "all", "until": "end", **keys}]
        path = link_scene(tmp_path, {}, model=link(SERVO + other, link_body=second), phases=phases)
        notes.append([line for line in prepare(path).describe() if line.startswith("note: no") and "robot/other" in line])
    assert [len(each) for each in notes] == [0, 1]
