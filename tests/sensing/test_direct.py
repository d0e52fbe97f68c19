"""The estimator without a filter, and what every estimator passes on to control laws."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.errors import InputError
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.report.plots import figure_names, figures
from tests.sensing.scenes import Listener, arm, column, pushing, run

ENCODERS = "".join(f'<jointpos name="q{i}" joint="j{i}"/><jointvel name="v{i}" joint="j{i}"/>' for i in (1, 2))
BASE = """<framepos name="base_position" objtype="site" objname="imu"/><framequat name="base_attitude" objtype="site"
  objname="imu"/><velocimeter name="base_velocity" site="imu"/><gyro name="base_rate" site="imu"/>"""
HOLD = [{"name": "hold", "until": "end", "controller": {"kind": "hold", "joints": ["j1", "j2"], "bandwidth_rad_s": 3.0}}]
TUMBLING = {
    "joints": {"b/free": [1.6, 0.03, 0.02, 1, 0, 0, 0], "j1": 0.05},
    "rates": {"j1": 0.3, "base": [0.1, 0, 0, 0.1, 0.2, 0.3], "b/free": [-0.3, 0.05, 0.1, 0.3, 0.5, -0.4]},
}
DIRECT = {"kind": "direct"}


def camera(*kinds, **config):
    """Sensors at the wrist that look at the box."""
    return {kind: {"kind": kind, "of": "b/b", "relative_to": "wrist", **config} for kind in kinds}


def watching(folder, sensors, estimator):
    """The arm moves without contact beside a tumbling box, and all its own joints are measured."""
    free = {"phases": HOLD, "contacts": {"rules": []}, "initial": TUMBLING}
    return pushing(folder, robot=arm(ENCODERS + BASE), sensors=sensors, estimator=estimator, **free)


def worst(made, part):
    """Largest error of the estimate over some columns."""
    keys = [key for key in made.log.header.layout.keys if key.startswith("estimate.error_") and part in key]
    assert keys
    return max(np.nanmax(np.abs(column(made, key))) for key in keys)


def test_ideal_sensors_give_the_run_of_the_true_state(tmp_path):
    """Joints and base measured at every tick: the same motion up to rounding, 1e-16 through gains of 60."""
    robot = arm(ENCODERS + BASE)
    options = {"robot": robot, "phases": HOLD, "contacts": {"rules": []}, "duration_s": 0.5}
    (tmp_path / "true").mkdir()
    (tmp_path / "estimated").mkdir()
    true = run(pushing(tmp_path / "true", **options))
    estimated = run(pushing(tmp_path / "estimated", **options, estimator=DIRECT))
    keys = [key for key in true.log.header.layout.keys if key.startswith("state.") or key.endswith("_applied_N_m")]
    apart = [np.abs(column(true, key) - column(estimated, key)).max() for key in keys]
    assert max(apart) < 1e-12


@pytest.mark.parametrize("delay_s", [0.0, 0.12])
def test_a_late_camera_on_a_moving_arm_finds_a_tumbling_box(tmp_path, delay_s):
    """20 Hz, 120 ms late, in the frame of a hand that moves: Euler's equations carry pose and twist to now.

    RK4 in sub-steps of 0.05 rad over 0.1 rad: 2 (0.05)^5 / 120 is 5e-9 of a turn; ours is smaller, as the body is no needle.
    """
    sensors = camera("framepos", "framequat", "framelinvel", "frameangvel", interval_s=0.05, delay_s=delay_s)
    seen = run(watching(tmp_path, sensors, DIRECT))
    assert worst(seen, "b_free") < 5e-9


def test_rates_from_differences(tmp_path):
    """Position and attitude alone at 20 Hz: the mean rate over an interval lags by 25 ms, accelerating with 0.1."""
    sensors = camera("framepos", "framequat", interval_s=0.05)
    found = run(watching(tmp_path, sensors, {"kind": "direct", "rate_filter_s": 0.0}))
    assert 1e-5 < worst(found, "v_b_free_w") < 0.01
    assert worst(found, "q_b_free_x") < 1e-9  # it moves uniformly


def test_what_control_laws_are_told(tmp_path):
    """No contacts, of an impact its time and pair alone; untold: not called there, and nothing in events."""
    robot = arm(ENCODERS + BASE)
    run(pushing(tmp_path, robot=robot, estimator=DIRECT))
    hits = [event for seen in Listener.shown for event in seen.events if isinstance(event, ImpactRecord)]
    (hit,) = hits
    assert not any(seen.contacts for seen in Listener.shown)
    assert hit.pair
    assert 0.19 < hit.time_s < 0.2
    assert np.isnan(hit.impulse_N_s)
    assert hit.qpos == ()
    called = len(Listener.shown)
    for told, calls, events in (
        (False, called - 1, 0),
        ({"min_impulse_N_s": 9.0}, called - 1, 0),
        ({"min_impulse_N_s": 0.1}, called, 1),
    ):
        run(pushing(tmp_path, robot=robot, estimator=DIRECT, impact_feedback=told))
        impacts = [event for seen in Listener.shown for event in seen.events if isinstance(event, ImpactRecord)]
        assert (len(Listener.shown), len(impacts)) == (calls, events)


def test_an_estimator_without_sensors_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"scene.yaml:.*estimator: no sensor measures a joint or a floating body"):
        run(pushing(tmp_path, robot=arm('<touch name="pad" site="pad"/>'), estimator=DIRECT))


def test_an_added_sensor_names_what_there_is(tmp_path):
    with pytest.raises(InputError, match=r"sensors.eye.of: unknown site or body 'c/c'; allowed: .*b/b"):
        run(pushing(tmp_path, sensors={"eye": {"kind": "framepos", "of": "c/c"}}))


def test_figures_of_sensors_and_estimates(tmp_path):
    """A run without them has none of these."""
    seen = run(
        pushing(tmp_path, robot=arm(ENCODERS + BASE), phases=HOLD, duration_s=0.05, estimator=DIRECT), out=tmp_path / "run"
    )
    seen = ffsm_mj.load_run(tmp_path / "run")  # a log knows less than a run in memory
    drawn = figures(seen, ["sensors", "estimates"])
    assert {name: len(figure.axes) for name, figure in drawn.items()} == {"sensors": 8, "estimates": 4}
    without = run(pushing(tmp_path, robot=arm(""), duration_s=0.05))
    assert not {"sensors", "estimates"} & set(figure_names(without))
