"""Variants from the command line."""

from __future__ import annotations

from pathlib import Path

import pytest

from ffsm_mj.cli.main import main
from ffsm_mj.experiments.planning import load_campaign
from tests.experiments.variant_files import HALF, variants_file


@pytest.mark.long
def test_the_shipped_study_runs_from_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two runs of two of its laws, up to shortly after the start."""
    out = str(tmp_path / "out")
    short = ["-s", "samples.n=2", "-s", "overrides.duration_s=0.05", "-s", "limits.workers=1"]
    keep = "variants={osdre: {}, rate: {controllers: {regulate: {kind: pd, joints: [joint_1], kp: 1.0, kd: 1.0}}}}"
    assert main(["campaign", "run", "laws-after-impact", "--out", out, *short, "-s", keep]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("laws-after-impact: 4 runs to do, of 2 variants\n")
    assert "osdre: 2 of 2 runs (2 completed)" in printed
    assert "nothing is shown by 2 runs; 6 or more are needed" in printed
    assert main(["campaign", "status", out]) == 0
    assert capsys.readouterr().out.splitlines()[-1] in printed
    assert main(["campaign", "resume", out]) == 0


def test_a_study_is_checked_without_running_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine.py").write_text("raise SystemExit(1)\n\ndef held(run):\n    return 1.0\n")
    fine = {"overrides": {"log": {"max_size_GB": 0.5}}}
    path = variants_file(tmp_path, {"elastic": {}, "half": HALF, "fine": fine}, metrics={"file": "mine.py"})
    assert main(["check", str(path)]) == 0
    printed = capsys.readouterr().out
    assert "half     contacts.rules.0.restitution = 0.5" in printed
    assert "fine     log = max_size_GB: 0.5" in printed
    assert "own metrics: held" in printed
    assert main(["run", str(path)]) == 2
    assert "is a campaign, not a scenario; use 'ffsm campaign run" in capsys.readouterr().err
    assert main(["campaign", "run", str(path), "--out", str(tmp_path / "out")]) == 2
    assert "mine.py: cannot be executed (SystemExit: 1" in capsys.readouterr().err


def test_unstable_gains_of_every_variant_are_noted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As ``check`` notes them for a scenario: a damper on a slide of 2 kg at 1 ms is stable below 2 x 2 kg / 1 ms."""
    laws = {name: {"kind": "pd", "joints": ["robot/x"], "kp": 0.0, "kd": kd} for name, kd in GAINS.items()}
    path = variants_file(tmp_path, {name: {"controllers": {"coast": law}} for name, law in laws.items()})
    (tmp_path / "out").mkdir()
    (tmp_path / "out/notes.txt").touch()  # not the folder of a campaign: refused before a run begins
    for command, code in (["check", str(path)], 0), (["campaign", "run", str(path), "--out", str(tmp_path / "out")], 2):
        assert main(command) == code
        noted = [line for line in capsys.readouterr().out.splitlines() if "kd is unstable at the control period" in line]
        assert [note.partition(" phase ")[0] for note in noted] == ["note: wild:", "note: wilder:"]


GAINS = {"calm": 3900.0, "wild": 4100.0, "wilder": 1e5}
"""N s/m."""


def test_the_law_of_a_variant_may_have_parts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """They replace the law of the phase, and their faults are found where the campaign has them."""
    slide = {"kind": "pd", "joints": ["robot/x"], "kp": 0.0, "kd": 1.0}
    path = variants_file(tmp_path, {"elastic": {}, "parts": {"controllers": {"coast": {"slide": slide}}}})
    assert main(["check", str(path)]) == 0
    assert "parts    phases.coast.controllers = slide of kind pd" in capsys.readouterr().out
    (phase,) = load_campaign(path).variants["parts"].base.scenario.phases
    assert phase.controller is None
    assert [law.kind for law in phase.controllers.values()] == ["pd"]
    parts = {"slide": slide | {"kdd": 1.0}}
    assert main(["check", str(variants_file(tmp_path, {"elastic": {}, "parts": {"controllers": {"coast": parts}}}))]) == 2
    assert "variants.parts.controllers.coast: phases.0.controllers.slide.kdd: unknown key" in capsys.readouterr().err


def test_old_names_suggest_the_new_ones(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", "run", "laws-after-impact"]) == 2
    assert capsys.readouterr().err == "ffsm: unknown command 'study'; use 'ffsm campaign'\n"
    assert main(["schema", "--study"]) == 2
    assert "unexpected argument '--study', now '--campaign'" in capsys.readouterr().err
    path = variants_file(tmp_path, {"elastic": {}, "half": HALF})
    path.write_text(path.read_text().replace('"campaign"', '"study"'))
    for command in ("check", "run"):
        assert main([*(["campaign"] if command == "run" else []), command, str(path)]) == 2
        error = capsys.readouterr().err
        assert error.startswith(f"{path}:2:")
        assert "study: a study is a campaign with variants: write 'campaign' in place of 'study'" in error


@pytest.mark.long
def test_variants_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A run belongs to a variant, a design to all of them."""
    path, out = variants_file(tmp_path, {"elastic": {}, "half": HALF}, keep={"failures": 1}), str(tmp_path / "out")
    few = ["--workers", "1", "-s", "samples.n=2"]
    assert main(["campaign", "run", str(path), "--out", out, *few]) == 0
    printed = capsys.readouterr().out
    assert "elastic: impacts.0.impulse_N_s 2." in printed
    assert "impacts.0.impulse_N_s: no difference is shown between half and elastic" in printed
    assert main(["campaign", "rerun", out, "1", "--variant", "half"]) == 0
    assert "out/variants/half/reruns/000001: run 1 agrees with its row bit for bit" in capsys.readouterr().out
    assert main(["campaign", "rerun", out, "1"]) == 2
    assert "unknown variant ''; allowed: elastic, half" in capsys.readouterr().err
    assert main(["campaign", "run", str(path), "--out", out, "-s", "samples.n=4"]) == 2
    assert f"'ffsm campaign extend {out} 4' enlarges it" in capsys.readouterr().err
    assert main(["campaign", "extend", out, "4", "--workers", "1"]) == 0
    assert "half: 4 of 4 runs" in capsys.readouterr().out
    one = variants_file(tmp_path, {})
    assert main(["campaign", "run", str(one), "--out", out]) == 2
    assert "holds a campaign with variants" in capsys.readouterr().err
