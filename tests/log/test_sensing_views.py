"""Sensors and estimates in a recording: curves are columns of the log, wireframes are where the estimate is."""

from __future__ import annotations

import numpy as np
import pytest

from ffsm_mj.log.rerun.sink import write_recording
from ffsm_mj.log.scenario import compile_log
from ffsm_mj.records.sensing_columns import estimated_columns, measured_columns
from tests.log.test_recording import read
from tests.sensing.scenes import column, pushing, run

SENSORS = {"place": {"kind": "framepos", "of": "imu", "noise": 0.1, "interval_s": 0.05, "delay_s": 0.02}}
"""The noise of the position is the error of the estimate: the wireframe stands beside the base."""


@pytest.fixture(scope="module")
def estimated(tmp_path_factory):
    """A run with the estimator ``direct``."""
    scene = pushing(tmp_path_factory.mktemp("run"), sensors=SENSORS, estimator={"kind": "direct"}, duration_s=0.2)
    return run(scene)


def test_a_recording_shows_samples_and_the_estimate(estimated, tmp_path):
    """Positions are float32: 1e-7 of some metres."""
    write_recording(estimated.log, tmp_path / "run.rrd")
    data = read(tmp_path / "run.rrd")
    times = column(estimated, "state.time_s")

    def frames(entity, component):
        """Rows of the frames of an entity, and its values in them."""
        found = data[entity, component]
        return [int(np.argmin(abs(times - time))) for time, _ in found], np.array([value for _, value in found])

    rows, curves = frames("/plots/sensors/place", "Scalars:scalars")
    shown = np.column_stack([column(estimated, f"sensor.place_{of}{axis}_m") for of in ("", "true_") for axis in "xyz"])
    assert np.array_equal(curves, shown[rows], equal_nan=True)
    assert np.isfinite(curves[-1]).all()
    rows, places = frames("/world/estimate/robot/base", "Transform3D:translation")
    estimate = np.column_stack([column(estimated, f"estimate.q_robot_base_{axis}_m") for axis in "xyz"])
    assert np.allclose(places[:, 0], estimate[rows], atol=1e-6)
    truth = np.column_stack([column(estimated, f"state.q_robot_base_{axis}_m") for axis in "xyz"])
    assert np.abs(estimate - truth).max() > 0.03


def test_every_sensor_and_every_coordinate_has_its_columns(estimated):
    system, layout = compile_log(estimated.log), estimated.log.header.layout
    measured = {columns.sensor: columns for columns in measured_columns(layout, system.sensors)}
    assert set(measured) == set(system.sensors)
    assert measured["robot/encoder"].components == ("",)
    assert measured["robot/attitude"].components == tuple("wxyz")
    shown = [key for columns in measured.values() for key in (*columns.measured, *columns.true)]
    assert len(set(shown)) == len(shown) == 2 * int(system.mj.nsensordata)
    quantities = estimated_columns(layout, system.trees)
    assert sum(len(each.estimate) for each in quantities) == system.mj.nq + system.mj.nv
    assert sum(len(each.errors) for each in quantities) == 2 * system.mj.nv
    assert not any(each.sigmas for each in quantities)  # direct states none
