"""Phases that end at a measurement."""

from __future__ import annotations

import numpy as np
import pytest

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import InputError
from tests.sensing.scenes import Listener, arm, pushing, run


def phases(until):
    return [
        {"name": "approach", "until": until, "controller": {"kind": "listen"}},
        {"name": "after", "until": "end", "controller": {"kind": "off"}},
    ]


def test_a_jump_of_the_rates_is_felt(tmp_path):
    """The gyro at 100 Hz, untold of the impact at 0.195 s: its next sample, at 0.2 s, ends the phase."""
    made = run(pushing(tmp_path, phases=phases({"sensor": "gyro", "below": 0.34}), impact_feedback=False))
    (change,) = [each for each in made.log.records["phases"] if each.name == "after"]
    assert change.start_s == pytest.approx(0.2, abs=1e-9)
    assert change.reason == "gyro"


def test_an_impact_between_samples_is_felt_by_a_load_cell(tmp_path):
    """The box bounces off at 0.195 s: no force at any sample, but the mean of the interval to 0.2 s has the impulse."""
    made = run(
        pushing(
            tmp_path,
            robot=arm('<force name="cell" site="wrist" interval="0.01"/>'),
            phases=phases({"sensor": "cell", "above": 20.0}),
            contacts={"rules": [{"between": ["robot", "b"], "restitution": 1.0}]},
            impact_feedback=False,
        )
    )
    values = np.column_stack([made[f"sensor.robot_cell_{axis}_N"] for axis in "xyz"])
    assert np.linalg.norm(values, axis=1).max() < 5.0
    (change,) = [each for each in made.log.records["phases"] if each.name == "after"]
    assert change.start_s == pytest.approx(0.2, abs=1e-9)


def test_check_says_how_late_samples_are_and_how_many_are_lost(tmp_path):
    sensors = {"gyro": {"delay_s": 0.1, "delay_jitter_s": 0.05, "dropout": 0.25}, "acc": {"dropout": 1.0}}
    lines = prepare(pushing(tmp_path, sensors=sensors), controllers={"listen": Listener}).describe()
    assert "    robot/gyro: gyro, every 0.01 s, 0.1 to 0.15 s late, 0.25 of all lost" in lines
    assert "    robot/acc: accelerometer, every 0.0033 s, 1 of all lost, nothing arrives within the run" in lines


@pytest.mark.parametrize(
    ("until", "words"),
    [
        ({"sensor": "giro", "above": 1.0}, r"phases.0.until.sensor: unknown sensor 'giro' .did you mean 'robot/gyro'"),
        ({"sensor": "gyro"}, r"phases.0.until: needs 'above' or 'below', one of the two"),
        ({"sensor": "gyro", "over": 1.0}, r"phases.0.until.over: unknown key"),
        (3, r"phases.0.until: "),
    ],
)
def test_a_wrong_end_is_refused_with_its_place(tmp_path, until, words):
    with pytest.raises(InputError, match=words):
        run(pushing(tmp_path, phases=phases(until)))


@pytest.mark.parametrize(
    ("config", "words"),
    [
        (
            {"estimator": {"kind": "direct", "rate_filter_s": -1}},
            r"estimator.rate_filter_s: should be greater",
        ),
        ({"estimator": {"kind": "drect"}}, r"estimator.kind: unknown kind 'drect'.*direct"),
        ({"impact_feedback": {"min_impulse_N_s": 1, "over": 1}}, r"impact_feedback.over: unknown key.*min_impulse_N_s"),
        ({"told_of_impacts": False}, r"told_of_impacts: unknown key.*'impact_feedback'"),
        (
            {"impact_feedback": {"min_impulse_N_s": 1, "above_N_s": 1}},
            r"above_N_s: unknown key: the bound is min_impulse_N_s",
        ),
        ({"impact_feedback": "no"}, r"impact_feedback: should be a valid boolean"),
        ({"sensors": {"gyro": {"noise": 1, "noise_density": 1}}}, r"sensors.gyro: has both 'noise' and 'noise_density'"),
        ({"sensors": {"gyro": {"bias": "a"}}}, r"sensors.gyro.bias: should be a valid number"),
        ({"sensors": {"giro": {}}}, r"sensors.giro: unknown sensor 'giro' .did you mean 'robot/gyro'"),
        ({"seed": -1}, r"seed: should be greater than or equal to 0"),
    ],
)
def test_wrong_keys_are_refused_with_their_place_on_one_line(tmp_path, config, words):
    with pytest.raises(InputError, match=words) as refused:
        run(pushing(tmp_path, **config))
    assert len(str(refused.value).splitlines()) == 1
