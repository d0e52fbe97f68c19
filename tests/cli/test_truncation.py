"""The time after the end of a run whose checks fail: a budget, Ctrl-C and kill end the analysis of the truncation alone."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.cli.main import main
from ffsm_mj.replay.truncation import AnalysisLimits, analyze_truncation
from tests.simulation.test_accuracy import whirling
from tests.terminal import ffsm, on_terminal

LONG_S = 25.0
"""Simulated time of a run whose analysis takes several times as long as the run, seconds at least."""


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return whirling(tmp_path_factory.mktemp("scene"), duration_s=LONG_S)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A short run whose checks fail by truncation, without a verdict."""
    folder = tmp_path_factory.mktemp("recorded")
    return ffsm_mj.run(whirling(folder), out=folder / "run", rerun=False)


def not_analysed(folder):
    """Whether the summary of a run is whole, and says that there is no verdict."""
    summary = json.loads((folder / "summary.json").read_text())
    checks = summary["checks"]
    failing = checks["failing"]
    return (
        checks["passed"] is False
        and checks["fail_by_truncation"] is None
        and bool(failing)
        and all(each["fails_by_truncation"] is None and each["truncation"] == "not analysed" for each in failing)
        and summary["conservation"]["energy_residual_J"] > 0.0
        and "versions" in summary
    )


@pytest.mark.long
def test_ctrl_c_ends_only_the_analysis(tmp_path, monkeypatch, scene):
    """The folder, the checks and the summary are there; a run without a verdict counts as failed."""
    monkeypatch.chdir(tmp_path)
    shown = on_terminal(ffsm("run", str(scene), "--no-rerun", "--truncation", "600"), keys={"truncation of": b"\x03"})
    assert shown.code == 1
    assert "at most 600 s" in shown.written
    assert shown.cursor
    text = "\n".join(shown.screen)
    folder = (tmp_path / "logs" / "latest").resolve()
    assert "truncation: not analysed (interrupted)" in text
    assert "energy" in text
    assert f"files in logs/{folder.name}: mjcf, run.mcap, scenario.yaml, summary.json" in text
    assert "FAILED: energy of total" in text
    assert not_analysed(folder)
    shown = on_terminal(ffsm("analyze", "--truncation", "600"), keys={"truncation of": b"\x03\x03\x03"})
    assert shown.code == 1
    assert any("truncation: not analysed (interrupted)" in line for line in shown.screen)
    assert any("columns agree with states" in line for line in shown.screen)


@pytest.mark.long
def test_a_kill_in_the_analysis_leaves_a_whole_run(tmp_path, monkeypatch, scene):
    monkeypatch.chdir(tmp_path)
    process = subprocess.Popen(
        ffsm("run", str(scene), "--no-rerun", "--truncation", "600"), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    latest, end_s = Path("logs/latest"), time.monotonic() + 100.0
    while not latest.exists() and process.poll() is None and time.monotonic() < end_s:
        time.sleep(0.05)
    time.sleep(0.3)
    assert process.poll() is None  # the analysis takes seconds
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert not_analysed(latest)
    assert (latest / "run.mcap").is_file()


@pytest.mark.parametrize(
    ("budget", "why"), [("0.01", "it would take more than 0.01 s"), ("off", "--truncation off")], ids=["short", "off"]
)
def test_without_a_verdict_a_run_counts_as_failed(tmp_path, capsys, recorded, budget, why):
    folder, out = str(recorded.path.parent), tmp_path / "again"
    assert main(["run", folder, "--out", str(out), "--no-rerun", "--truncation", budget]) == 1
    said = capsys.readouterr()
    assert f"truncation: not analysed ({why})" in said.out
    assert said.err.startswith("FAILED: energy of total")
    assert not_analysed(out)
    assert main(["analyze", folder, "--truncation", budget]) == 1
    assert f"truncation: not analysed ({why})" in capsys.readouterr().out
    assert main(["analyze", folder, "--truncation", budget, "--json"]) == 1
    data = json.loads(capsys.readouterr().out)
    assert {check["fails_by_truncation"] for check in data["checks"] if not check["passes"]} == {None}
    assert data["summary"]["checks"]["failing"][0]["truncation"] == "not analysed"
    assert (
        main(["run", folder, "--out", str(tmp_path / "b"), "--no-rerun", "--truncation", budget, "--allow-failed-checks"])
        == 0
    )


def test_an_error_in_the_analysis_loses_no_report(tmp_path, monkeypatch, capsys, recorded):
    def broken(*_):
        raise ZeroDivisionError("a step of none")

    monkeypatch.setattr("ffsm_mj.replay.truncation._Refining._refine", broken)
    out = tmp_path / "again"
    assert main(["run", str(recorded.path.parent), "--out", str(out), "--no-rerun"]) == 1
    said = capsys.readouterr().out
    assert "truncation: not analysed (ZeroDivisionError: a step of none" in said
    assert f"files in {out}" in said
    assert not_analysed(out)


@pytest.mark.parametrize("value", ["0", "-1", "nan", "on"])
def test_a_wrong_budget_is_refused(capsys, value):
    assert main(["analyze", "--truncation", value]) == 2
    assert f"{value} is not a positive number" in capsys.readouterr().err


def test_nothing_is_simulated_again_unless_asked(monkeypatch, recorded):
    """Neither checks nor summary nor a representation replays a run."""
    run = ffsm_mj.load_run(recorded.path)
    with monkeypatch.context() as patched:
        patched.setattr("ffsm_mj.replay.analyze_truncation", None)
        assert {check.fails_by_truncation for check in run.checks() if not check.passes} == {None}
        assert ffsm_mj.summary(run)["checks"]["fail_by_truncation"] is None
        assert "checks of rows and records FAILED (truncation: not analysed)" in repr(run)
        assert "truncation: not analysed" in run._repr_html_()
    explained = ffsm_mj.explain(run, limits=AnalysisLimits(1000.0))
    assert all(check.passes or check.fails_by_truncation for check in explained.checks)
    assert explained.obstacle == ""
    assert ffsm_mj.summary(run, explained.checks)["checks"]["fail_by_truncation"] is True
    hurried = ffsm_mj.explain(run, limits=AnalysisLimits(1e-9))
    assert hurried.checks == all_checks(run)
    assert hurried.obstacle == "it would take more than 1e-09 s"


def test_a_folder_that_cannot_be_written_is_analysed(capsys, tmp_path):
    run = ffsm_mj.run(whirling(tmp_path), out=tmp_path / "run", rerun=False)
    folder = run.path.parent
    folder.chmod(0o555)
    try:
        assert main(["analyze", str(folder), "--truncation", "1000"]) == 5
    finally:
        folder.chmod(0o755)
    assert "truncation: " in capsys.readouterr().out


def test_limits_count_steps(recorded):
    """A budget in steps ends at the same step wherever the run is analysed."""
    made = []
    analyze_truncation(recorded.log, recorded.checks(), AnalysisLimits(stopped=lambda: bool(made.append(0))))
    assert analyze_truncation(recorded.log, recorded.checks(), AnalysisLimits(steps=len(made))).refined is not None
    ended = analyze_truncation(recorded.log, recorded.checks(), AnalysisLimits(steps=len(made) - 1))
    assert ended.refined is None
    assert ended.obstacle == f"it would take more than {len(made) - 1} steps"
