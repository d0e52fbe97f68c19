"""Servos with activations against closed forms, to order four of the step; what a log and a state have of them."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.dynamics.actuators import Activations
from ffsm_mj.model import composition
from ffsm_mj.replay import replay_log
from tests.replays import assert_replayed
from tests.scenario.test_scenario import faults
from tests.servos.scenes import START, link_scene, playing, steps
from tests.servos.test_servos import ANGLE, RATE, passes

ACTIVATION = "actuators.robot_servo_activation"
MOTOR = 'joint="j" motorconst=".05" resistance="2" gear="20"'
# Actuator, setpoint, activation at the start, duration, angle and rate at the end, activation there, error at 4 ms.
CASES = {
    "filter": (
        '<position name="servo" joint="j" kp="8" kv=".6" timeconst=".03"/>',
        (0.7, 0.1, 1.0),
        (0.875030111258, -0.956488314342, 0.7 - 0.6 * np.exp(-1.0 / 0.03)),
        1e-8,
    ),
    "integrator": (
        '<intvelocity name="servo" joint="j" kp="8" kv=".6" actrange="-9 9"/>',
        (0.5, 0.1, 1.0),
        (0.614333122781, 0.832791296913, 0.6),
        3e-9,
    ),
    "integrator to the end of its range, at .101 s": (
        '<intvelocity name="servo" joint="j" kp="8" kv=".6" actrange="-1 .0505"/>',
        (0.5, 0.0, 1.0),
        (0.053607439982, 0.332079510166, 0.0505),
        3e-9,
    ),
    "controller with an integral": (
        '<pid name="servo" joint="j" kp="8" kv=".6" ki="20" input="pos"/>',
        (0.7, 0.0, 1.0),
        # With z' = u - q a linear system of three states.
        (0.781065079411, -3.354159394000, -0.157141001873),
        1.2e-8,
    ),
    "controller with a limited integral, from .0603 to .3855 s": (
        '<pid name="servo" joint="j" kp="8" kv=".6" ki="20" imax=".0303" input="pos"/>',
        (0.7, 0.0, 0.6),
        (1.036884012630, 0.870327262254, -0.010264784917),
        1e-8,
    ),
    "controller with a setpoint of limited rate, which arrives at 7/15 s": (
        '<pid name="servo" joint="j" kp="8" kv=".6" slewmax="1.5" input="pos"/>',
        (0.7, 0.0, 1.0),
        (1.021936114498, 0.169166725649, 0.7),
        5e-9,
    ),
    "motor without inductance": (
        f'<dcmotor name="servo" {MOTOR}/>',
        (12.0, None, 0.2),
        (0.423399705423, 2.420750368222),
        1e-10,
    ),
    "motor with inductance": (
        f'<dcmotor name="servo" {MOTOR} inductance=".008"/>',
        (12.0, 0.0, 0.2),
        (0.413924798425, 2.384272537060, 4.832146490939),
        1e-10,
    ),
    "muscle, from rest": (
        '<muscle name="servo" joint="j" lengthrange="-3 3" timeconst=".01 .04"/>',
        (0.8, 0.05, 0.02),
        (None, None, 0.665660105663906),
        1e-4,
    ),
}


def run_of(folder, actuator, setpoint, activation, duration_s, **scenario):
    initial = START | ({"activations": {"servo": activation}} if activation is not None else {})
    law = playing(folder, setpoint)
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


def test_an_activation_begins_at_rest_unless_it_is_given(tmp_path):
    at_rest = {"joints": {"j": 0.2}}
    for name in ("filter", "integrator"):
        run = ffsm_mj.run(link_scene(tmp_path, {"kind": "off"}, actuators=CASES[name][0], initial=at_rest, duration_s=0.1))
        assert np.abs(run[RATE]).max() == 0.0
        assert set(run[ACTIVATION]) == {0.2}
    path = link_scene(tmp_path, {"kind": "off"}, initial=at_rest | {"activations": {"servo": 0.1}})
    assert any("initial.activations.servo: servo has no activations" in line for line in faults(path=path))


smooth, end = composition.smooth_controllers, Activations.end


def smooth_and_early(model):
    """Forces from the activations of the next step, as MuJoCo's motors have them."""
    smooth(model)
    model.actuator_actearly[:] = 1


def end_as_mujoco(self, duration_s):
    """Activations at the end of a step as by MuJoCo's RK4: the exponential factor times the mean of the rates of stages."""
    end(self, duration_s)
    act, taus, filters = self._data.act, self._taus, self._filters
    act[filters] = self._start[filters] + taus * -np.expm1(-duration_s / taus) * self._sum[filters]


@pytest.mark.parametrize(
    ("what", "place", "mistake", "least"),
    [
        # Of MuJoCo's own steps the rate is off by 4e-3 to 1.4e-2 at 4 ms; divided ones are shorter.
        ("motor with inductance", (composition, "smooth_controllers"), smooth_and_early, 1e-3),
        ("filter", (Activations, "end"), end_as_mujoco, 5e-4),
    ],
)
def test_activations_as_mujoco_has_them_are_found(tmp_path, monkeypatch, what, place, mistake, least):
    """The run is wrong by order one, and the replay of its log does not agree."""
    actuator, given, expected, at_4_ms = CASES[what]
    with monkeypatch.context() as wrong:
        wrong.setattr(*place, mistake)
        run = run_of(tmp_path, actuator, *given, **steps(4e-3))
    errors = [abs(run[key][-1] - value) for key, value in zip((ANGLE, RATE), expected, strict=False)]
    assert max(errors) > least > 1e4 * at_4_ms
    again = replay_log(run.log)
    assert not again.agrees
