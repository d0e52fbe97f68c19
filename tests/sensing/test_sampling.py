"""Samples: true values at their own times inside steps, impulses through force sensors, and nothing of the plant changed."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import InputError
from ffsm_mj.log.scenario import compile_log
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.replay import replay_log
from tests.sensing.scenes import Listener, arm, column, pushing, run


@pytest.fixture(scope="module")
def pushed(tmp_path_factory):
    return run(pushing(tmp_path_factory.mktemp("pushed")))


def true_keys(run: ffsm_mj.Run) -> list[str]:
    return [key for key in run.log.header.layout.keys if key.startswith("sensor.") and "_true" in key]


def test_a_run_with_sensors_is_bit_for_bit_the_run_without(tmp_path, pushed):
    """They interrupt no step and push no event, although a third of the samples is inside of steps and one in a contact."""
    without = run(pushing(tmp_path), overrides={"robot.strip": ["sensors"]})
    keys = without.log.header.layout.keys
    places = [pushed.log.header.layout.index[key] for key in keys]
    assert not [key for key in keys if key.startswith("sensor.")]
    assert np.array_equal(without.log.rows, pushed.log.rows[:, places], equal_nan=True)


def test_a_replay_recomputes_every_sample_and_notices_a_changed_one(pushed):
    assert replay_log(pushed.log).agrees
    key = "sensor.robot_encoder_rad"
    rows = pushed.log.rows.copy()
    rows[20, pushed.log.header.layout.index[key]] += 1e-6  # a thousandth of its noise
    again = replay_log(replace(pushed.log, rows=rows))
    assert not again.agrees
    assert key in str(again.worst["columns"])


def test_a_sample_does_not_depend_on_what_else_is_due(tmp_path):
    """Bit for bit the same values with all sensors at 10 ms as with each at a multiple of its own, in contact too."""
    names = ("encoder", "gyro", "acc", "force", "torque", "pad", "attitude")
    pressing = {
        "law": {"efforts": (0.0, 0.0, 6.0)},
        "initial": {"joints": {"b/free": [1.28, 0, 0, 1, 0, 0, 0]}},
        "duration_s": 0.1,
    }
    together, apart = (
        run(
            pushing(
                tmp_path,
                sensors={name: {"interval_s": 0.01 * every} for name, every in zip(names, each, strict=True)},
                **pressing,
            )
        )
        for each in ((1,) * 7, (1, 2, 3, 1, 2, 3, 2))
    )
    for name in names:
        keys = [key for key in true_keys(apart) if key.startswith(f"sensor.robot_{name}_")]
        at_one_time = column(together, f"sensor.robot_{name}_sampled_s") == column(apart, f"sensor.robot_{name}_sampled_s")
        assert keys
        assert at_one_time.sum() >= 3
        for key in keys:
            assert np.array_equal(column(together, key)[at_one_time], column(apart, key)[at_one_time])
    assert column(together, "sensor.robot_pad_true_N").max() > 0.1


def test_samples_inside_steps_have_the_order_of_the_steps(tmp_path, pushed):
    """Forces, sampled at multiples of 3.3 ms: steps of 10 and 5 ms against 2 ms.

    The error grows with the fourth power of the step: from 5 to 10 ms by 16, or 31 or more with the error of 2 ms in both.
    """
    errors = []
    for step_s in (0.01, 0.005):
        coarse = run(pushing(tmp_path, time_step_s=step_s))
        apart = {key: np.nanmax(np.abs(column(coarse, key) - column(pushed, key))) for key in true_keys(pushed)}
        errors.append(apart["sensor.robot_force_true_x_N"])
        assert max(apart.values()) < 1e-9
    assert 1e-12 < errors[1] < errors[0] < 1e-9
    assert 12.0 < errors[0] / errors[1] < 40.0


def test_an_impulse_through_the_wrist_is_what_the_hand_does_not_keep(pushed):
    """Momentum of the hand, body by body from the record: its change is the contact impulse less that of the wrist."""
    (hit,) = [event for event in pushed.log.events if isinstance(event, ImpactRecord)]
    system = compile_log(pushed.log)
    model, data = system.mj, mujoco.MjData(system.mj)
    hand, momenta = model.body("robot/hand").id, []
    for rates in (hit.qvel_before, hit.qvel_after):
        data.qpos[:] = hit.qpos
        data.qvel[:] = np.concatenate([rates[name] for name in system.joints])
        mujoco.mj_forward(model, data)
        mujoco.mj_subtreeVel(model, data)
        momenta.append(model.body_mass[hand] * data.subtree_linvel[hand])
    # The sensor is on the hand: force on the hand by the link, in the frame of the site.
    kept = momenta[1] - momenta[0] + hit.impulse_N_s * np.array(hit.normal)
    expected = data.site_xmat[model.site("robot/wrist").id].reshape(3, 3).T @ kept
    keys = [f"sensor.robot_force_impulse_{axis}_N_s" for axis in "xyz"]
    told = np.array([column(pushed, key) for key in keys]).T
    shown = told[np.abs(told).max(axis=1) > 0.0]
    assert np.abs(hit.impulse_N_s) > 1.0
    # Sums of ten products of this size in rounding.
    assert np.allclose(np.abs(shown[0]), np.abs(expected), atol=1e-13)


def test_delays_ages_and_what_is_not_there_yet(tmp_path):
    """The camera at 10 Hz, 100 ms late: nothing for 0.1 s, then samples of an age of 0.1 to 0.19 s."""
    run(pushing(tmp_path))
    for observation in [each for each in Listener.shown if each.at_tick]:
        seen = observation.measured["robot/camera"]
        if observation.time_s < 0.1 - 1e-9:
            assert not seen.valid
            assert np.isnan(seen.value).all()
            continue
        late = 0.1 + (observation.time_s + 1e-9) % 0.1
        assert seen.valid
        assert seen.age_s == pytest.approx(late, abs=1e-8)
        assert seen.time_s == pytest.approx(observation.time_s - late, abs=1e-8)


def test_a_touch_sensor_has_the_force_that_accelerates_what_it_touches(tmp_path):
    """The hand pushes the box: its momentum grows by the integral of the touch, by Simpson's rule over two ticks.

    The force changes over some 0.1 s: the rule errs by (0.01 / 0.1)^4 / 90 of it, 2e-6.
    """
    pushed = run(
        pushing(
            tmp_path,
            robot=arm('<touch name="pad" site="pad"/>'),
            law={"efforts": (0.0, 0.0, 6.0)},
            initial={"joints": {"b/free": [1.28, 0, 0, 1, 0, 0, 0]}},
            duration_s=0.1,
        )
    )
    touch, momentum = column(pushed, "sensor.robot_pad_true_N"), column(pushed, "momentum.objects_P_x_N_s")
    assert touch[1:].min() > 0.1
    assert touch[0] == 0.0  # nothing pushes before the first command
    gained = 0.01 / 3.0 * (touch[1:-2] + 4.0 * touch[2:-1] + touch[3:])
    assert np.allclose(gained, momentum[3:] - momentum[1:-2], rtol=1e-5)


def test_a_check_lists_sensors_and_the_estimator(tmp_path):
    lines = prepare(pushing(tmp_path, estimator={"kind": "direct"}), controllers={"listen": Listener}).describe()
    start = lines.index("  sensors (estimator direct)")
    assert lines[start + 1] == "    robot/encoder: jointpos, every 0.01 s"
    assert "    robot/camera: framepos, every 0.1 s, 0.1 s late" in lines[start:]


def test_names_that_are_one_in_the_log_are_refused_with_the_file(tmp_path):
    robot = arm('<gyro name="a-b" site="imu"/><gyro name="a_b" site="imu"/>')
    with pytest.raises(InputError, match=r"/robot\.xml: 'robot/a-b' and 'robot/a_b' are both logged as sensor\.robot_a_b"):
        run(pushing(tmp_path, robot=robot))
