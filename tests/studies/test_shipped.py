"""The shipped studies, their schema, and the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from ffsm_mj.cli.main import main
from ffsm_mj.scenario.shipped import scenarios_dir
from ffsm_mj.studies.plan import load_study
from ffsm_mj.studies.schema import study_schema
from ffsm_mj.studies.shipped import STUDIES
from ffsm_mj.yaml.parser import read_node
from tests.studies.files import HALF, study_file


@pytest.mark.long
@pytest.mark.parametrize("name", STUDIES.names())
def test_a_shipped_study_is_valid(name: str) -> None:
    plan = load_study(name)
    assert [*plan.variants] == [*plan.config.variants]
    Draft202012Validator(study_schema()).validate(read_node(STUDIES.path(name)).plain())


def test_the_committed_schema_is_that_of_the_model() -> None:
    assert study_schema() == json.loads((scenarios_dir() / "ffsm-study.schema.json").read_text())


def test_the_shipped_study_runs_from_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two runs of two of its laws, up to shortly after the start."""
    out = str(tmp_path / "out")
    short = ["-s", "samples.n=2", "-s", "overrides.duration_s=0.05", "-s", "limits.workers=1"]
    keep = "variants={osdre: {}, rate: {controllers: {regulate: {kind: pd, joints: [joint_1], kp: 1.0, kd: 1.0}}}}"
    assert main(["study", "run", "laws-after-impact", "--out", out, *short, "-s", keep]) == 0
    printed = capsys.readouterr().out
    assert "osdre: 2 of 2 runs (2 completed), 0 failed" in printed
    assert "nothing is shown by 2 runs; 6 or more are needed" in printed
    assert main(["study", "status", out]) == 0
    assert capsys.readouterr().out.splitlines()[-1] in printed
    assert main(["study", "resume", out]) == 0


def test_a_study_is_checked_without_running_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine.py").write_text("raise SystemExit(1)\n\ndef held(run):\n    return 1.0\n")
    path = study_file(tmp_path, {"elastic": {}, "half": HALF}, metrics={"file": "mine.py"})
    assert main(["check", str(path)]) == 0
    printed = capsys.readouterr().out
    assert "half     contacts.rules.0.restitution = 0.5" in printed
    assert "own metrics: held" in printed
    assert main(["run", str(path)]) == 2
    assert "is a study, not a scenario; use 'ffsm study run" in capsys.readouterr().err
    assert main(["study", "run", str(path), "--out", str(tmp_path / "out")]) == 2
    assert "mine.py: cannot be executed (SystemExit: 1" in capsys.readouterr().err
