"""SOURCE_DATE_EPOCH: a run at another time and speed gives the same log byte for byte."""

from __future__ import annotations

import json
import time

import pytest

import ffsm_mj
from ffsm_controllers.off import Off
from ffsm_mj.cli.main import main
from ffsm_mj.log import recorder
from tests.scenes import two_balls


@pytest.mark.long
@pytest.mark.parametrize("stated", ["1700000000", "0"])
def test_two_runs_give_the_same_bytes(tmp_path, monkeypatch, stated):
    """With an impact; the second run starts in another second and sleeps, so that flushes by wall time would differ."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", stated)
    path = two_balls(tmp_path, duration_s=2.5)
    first = ffsm_mj.run(path, out=tmp_path / "a")
    assert len(first.impacts) == 1
    slow, calls = Off.control, []

    def control(self, observation, command):
        calls.append(observation.time_s)
        if len(calls) in (400, 1300):
            time.sleep(0.7)
        slow(self, observation, command)

    monkeypatch.setattr(Off, "control", control)
    monkeypatch.setattr(recorder, "_FLUSH_PERIOD_S", 0.5)
    ffsm_mj.run(path, out=tmp_path / "b")
    assert len(calls) > 2000
    for name in ("run.mcap", "summary.json", "scenario.yaml"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name


def test_the_log_contains_the_given_time(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    assert main(["run", str(two_balls(tmp_path, duration_s=0.1)), "--no-rerun", "--out", str(tmp_path / "a")]) == 0
    assert "scene: completed; 0.1 s simulated\n" in capsys.readouterr().out
    run = ffsm_mj.load_run(tmp_path / "a")
    assert run.log.header.metadata["created_utc"] == "2023-11-14T22:13:20Z"
    summary = json.loads((tmp_path / "a" / "summary.json").read_text())
    assert [summary[key] for key in ("wall_s", "real_time_factor", "law_wall_s_per_tick")] == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("wrong", ["now", "-1", "1.5", "²", "9" * 30, "9" * 6000])
def test_an_invalid_time_is_refused_before_the_run(tmp_path, monkeypatch, capsys, wrong):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", wrong)
    assert main(["run", str(two_balls(tmp_path)), "--out", str(tmp_path / "a")]) == 2
    assert capsys.readouterr().err.startswith(f"SOURCE_DATE_EPOCH={wrong}: must be a whole number of seconds since 1970")
    assert not (tmp_path / "a").exists()
