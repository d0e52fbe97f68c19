"""Servos with activations against closed forms, to order four of the step; what a log and a state have of them."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.dynamics.actuators import Activations
from tests.replays import assert_replayed
from tests.scenario.test_scenario import faults
from tests.servos.scenes import START, link_scene, steps
from tests.servos.test_servos import ANGLE, RATE, passes
from tests.simulation.restored import goes_on, is_rest_of

ACTIVATION = "actuators.robot_servo_activation"
MOTOR = 'joint="j" motorconst=".05" resistance="2" gear="20"'
# Actuator, setpoint, activation at the start, duration, angle and rate at the end, activation there, error at 4 ms.
CASES = {
    "filter": (
        '<position name="servo" joint="j" kp="8" kv=".6" timeconst=".03"/>',
        (0.7, "_rad", 0.1, 1.0),
        (0.875030111258, -0.956488314342, 0.7 - 0.6 * np.exp(-1.0 / 0.03)),
        1e-8,
    ),
    "integrator": (
        '<intvelocity name="servo" joint="j" kp="8" kv=".6" actrange="-9 9"/>',
        (0.5, "_rad", 0.1, 1.0),
        (0.614333122781, 0.832791296913, 0.6),
        3e-9,
    ),
    "integrator to the end of its range, at .101 s": (
        '<intvelocity name="servo" joint="j" kp="8" kv=".6" actrange="-1 .0505"/>',
        (0.5, "_rad", 0.0, 1.0),
        (0.053607439982, 0.332079510166, 0.0505),
        3e-9,
    ),
    "controller with an integral": (
        '<pid name="servo" joint="j" kp="8" kv=".6" ki="20" input="pos"/>',
        (0.7, "", 0.0, 1.0),
        # With z' = u - q a linear system of three states.
        (0.781065079411, -3.354159394000, -0.157141001873),
        1.2e-8,
    ),
    "controller with a limited integral, from .0603 to .3855 s": (
        '<pid name="servo" joint="j" kp="8" kv=".6" ki="20" imax=".0303" input="pos"/>',
        (0.7, "", 0.0, 0.6),
        (1.036884012630, 0.870327262254, -0.010264784917),
        1e-8,
    ),
    "controller with a setpoint of limited rate, which arrives at 7/15 s": (
        '<pid name="servo" joint="j" kp="8" kv=".6" slewmax="1.5" input="pos"/>',
        (0.7, "", 0.0, 1.0),
        (1.021936114498, 0.169166725649, 0.7),
        5e-9,
    ),
    "motor without inductance": (
        f'<dcmotor name="servo" {MOTOR}/>',
        (12.0, "", None, 0.2),
        (0.423399705423, 2.420750368222),
        1e-10,
    ),
    "motor with inductance": (
        f'<dcmotor name="servo" {MOTOR} inductance=".008"/>',
        (12.0, "", 0.0, 0.2),
        (0.413924798425, 2.384272537060, 4.832146490939),
        1e-10,
    ),
    "muscle, from rest": (
        '<muscle name="servo" joint="j" lengthrange="-3 3" timeconst=".01 .04"/>',
        (0.8, "", 0.05, 0.02),
        (None, None, 0.665660105663906),
        1e-4,
    ),
}


def run_of(folder, actuator, setpoint, unit, activation, duration_s, **scenario):
    (folder / "setpoints.csv").write_text(f"time_s,actuators.robot_servo_applied{unit}\n0,{setpoint}\n9,{setpoint}\n")
    initial = START | ({"activations": {"servo": activation}} if activation is not None else {})
    law = {"kind": "playback", "file": "setpoints.csv"}
    path = link_scene(folder, law, actuators=actuator, initial=initial, duration_s=duration_s, **scenario)
    return ffsm_mj.run(path)


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize("what", CASES)
def test_an_activation_is_integrated_with_the_motion(tmp_path, what):
    """To order four, also where the integrator of MuJoCo is of order one, and through the end of a range."""
    actuator, given, expected, at_4_ms = CASES[what]
    errors = []
    for step_s in (4e-3, 2e-3, 1e-3):
        run = run_of(tmp_path, actuator, *given, **steps(step_s))
        assert passes(run), [check for check in run.checks() if not check.passes]
        columns = (ANGLE, RATE, ACTIVATION)[: len(expected)]
        errors.append(
            max(abs(run[key][-1] - value) for key, value in zip(columns, expected, strict=True) if value is not None)
        )
    assert errors[0] < at_4_ms
    assert errors[2] < max(errors[1] / 10.0, 2e-10)  # steps that the control has divided are near rounding
    assert_replayed(run)


def test_the_end_of_a_range_inside_a_step_spoils_the_order(tmp_path, monkeypatch):
    """The control: the step does not end where the integrator does."""
    begin = Activations.begin

    def begun(self, *arguments):
        begin(self, *arguments)
        self.kink_s = np.inf

    monkeypatch.setattr(Activations, "begin", begun)
    actuator, given, expected, at_4_ms = CASES["integrator to the end of its range, at .101 s"]
    run = run_of(tmp_path, actuator, *given, **steps(2e-3))
    assert max(abs(run[ANGLE][-1] - expected[0]), abs(run[RATE][-1] - expected[1])) > 10.0 * at_4_ms


@pytest.mark.parametrize(("what", "least"), [("filter", 1e-4), ("motor with inductance", 1e-3)])
def test_activations_of_the_next_step_or_by_steps_of_mujoco_are_wrong(tmp_path, what, least):
    """The control: MuJoCo's own steps at 4 ms, and forces from the activation of the next step, as its motors have them."""
    actuator, (setpoint, _, start, duration_s), expected, _ = CASES[what]
    model = prepare(link_scene(tmp_path, {"kind": "off"}, actuators=actuator)).system.mj
    model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, 4e-3
    for early in (0, 1):
        model.actuator_actearly[:] = early
        data = mujoco.MjData(model)
        j = model.joint("robot/j")
        data.qpos[j.qposadr], data.qvel[j.dofadr], data.qvel[5], data.ctrl[0], data.act[0] = 0.2, -0.3, 0.06, setpoint, start
        while data.time < duration_s - 1e-9:
            mujoco.mj_step(model, data)
        errors = data.qpos[j.qposadr] - expected[0], data.qvel[j.dofadr] - expected[1]
        assert np.abs(errors).max() > least


@pytest.mark.long(one_of=4)
@pytest.mark.parametrize("what", [what for what in CASES if what != "motor without inductance"])
def test_a_run_goes_on_from_its_activation(tmp_path, what):
    """From bytes, bit by bit, in every kind of activation."""
    (tmp_path / "setpoints.csv").write_text(f"time_s,actuators.robot_servo_applied{CASES[what][1][1]}\n0,.7\n9,.7\n")
    law = {"kind": "playback", "file": "setpoints.csv"}
    path = link_scene(tmp_path, law, actuators=CASES[what][0], duration_s=0.1)
    whole, continued = goes_on(path, at_s=0.05)
    assert is_rest_of(whole, continued)


def test_an_activation_begins_at_rest_unless_it_is_given(tmp_path):
    at_rest = {"joints": {"j": 0.2}}
    for name in ("filter", "integrator"):
        run = ffsm_mj.run(link_scene(tmp_path, {"kind": "off"}, actuators=CASES[name][0], initial=at_rest, duration_s=0.1))
        assert np.abs(run[RATE]).max() == 0.0
        assert set(run[ACTIVATION]) == {0.2}
    path = link_scene(tmp_path, {"kind": "off"}, initial=at_rest | {"activations": {"servo": 0.1}})
    assert any("initial.activations.servo: servo has no activations" in line for line in faults(path=path))
