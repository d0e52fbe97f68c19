"""Controls: mistakes in servos that a run or the replay of its log must not pass."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from ffsm_mj.dynamics.actuators import Activations
from ffsm_mj.dynamics.springs import JointSprings
from ffsm_mj.model import composition
from ffsm_mj.replay import replay_log
from tests.servos.scenes import KV, run_link, steps
from tests.servos.test_activations import CASES, run_of
from tests.servos.test_servos import ANGLE, HOLD, RATE, passes

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


def test_damping_of_a_servo_as_heat_of_a_damper_fails_the_energy_check(tmp_path, monkeypatch):
    """Its damping is in the work of its force: entered once more, the energy is off by that heat."""

    def twice(model):
        other = copy.copy(model)
        other.dof_damping[6] = KV
        return JointSprings(other)

    assert passes(run_link(tmp_path, HOLD, duration_s=0.2))
    monkeypatch.setattr("ffsm_mj.balance.balance.JointSprings", twice)
    run = run_link(tmp_path, HOLD, duration_s=0.2)
    failing = [check.name for check in run.checks() if not check.passes]
    assert any("energy" in name for name in failing), failing
