"""Replays of logs with gaps: samples that were under way are not known, and are taken over from the log."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ffsm_mj.replay import replay_log
from tests.sensing.scenes import pushing, run

LATE = {"camera": {"noise": 0.01, "delay_jitter_s": 0.15}, "encoder": {"delay_s": 0.035}, "force": {"delay_s": 0.03}}


@pytest.fixture(scope="module")
def late(tmp_path_factory):
    return run(pushing(tmp_path_factory.mktemp("late"), sensors=LATE, duration_s=0.4))


@pytest.mark.long
@pytest.mark.parametrize(
    "kept",
    [lambda i: i[(i < 5) | (i >= 10)], lambda i: i[5:], lambda i: i[i != 12], lambda i: np.insert(i, 10, 9)],
    ids=["dropped", "dropped at the start", "one dropped", "twice"],
)
def test_no_sample_differs_after_a_gap_and_a_changed_one_shows(late, kept):
    """The impact is at 0.12 s: the mean of forces over an interval that a gap cuts is not known either."""
    log = replace(late.log, rows=late.log.rows[kept(np.arange(len(late.log.rows)))])
    again = replay_log(log)
    assert again.gaps
    assert again.agrees
    rows = log.rows.copy()
    for key in ("sensor.robot_camera_x_m", "sensor.robot_encoder_rad", "sensor.robot_force_mean_x_N"):
        changed = rows.copy()
        changed[-2, late.log.header.layout.index[key]] += 1e-6
        assert key in str(replay_log(replace(log, rows=changed)).worst["columns"])


def test_what_no_sample_can_change_any_more_is_compared(tmp_path):
    """Nothing arrives after the gap: the encoder's last sample arrives 35 ms after it at the latest."""
    never = run(pushing(tmp_path, sensors={"encoder": {"delay_s": 0.035, "dropout": 1.0}}, duration_s=0.2))
    log = replace(never.log, rows=np.delete(never.log.rows, range(5, 10), axis=0))
    assert replay_log(log).agrees
    rows = log.rows.copy()
    rows[-2, never.log.header.layout.index["sensor.robot_encoder_rad"]] = 0.1
    assert not replay_log(replace(log, rows=rows)).agrees
