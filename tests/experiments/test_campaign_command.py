"""What ``ffsm campaign run`` says at its end, and its exit codes."""

from __future__ import annotations

import json
import shlex
import sqlite3
from pathlib import Path

import pytest

from ffsm_mj.cli.main import main
from ffsm_mj.experiments.campaign import Campaign
from ffsm_mj.experiments.executors import importable, loop
from ffsm_mj.experiments.metrics import ScriptClasses
from ffsm_mj.experiments.worker import _near
from tests.experiments.files import rock_hits
from tests.experiments.laws import Fuse

IMPULSE = "impacts.0.impulse_N_s"


def test_a_kept_run_that_differs_from_its_row_is_exit_3(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The rows of two runs are changed before their logs are written: one that is kept, one that is not."""
    path, out = rock_hits(tmp_path, metrics=[IMPULSE], keep={"worst": {IMPULSE: 2}}), tmp_path / "out"
    campaign = Campaign.load(path, out)
    campaign.run(loop().open())
    assert main(["campaign", "resume", str(out), "--workers", "1"]) == 0
    assert f"logs kept: {out / 'reruns'} (2 runs, which agree with their rows)\n" in capsys.readouterr().out
    worst, *_, least = sorted(campaign.rows(), key=lambda row: -row.metrics[IMPULSE])
    with sqlite3.connect(out / "rows.sqlite") as table:
        for row, factor in ((worst, 2.0), (least, 0.5)):
            metrics = json.dumps({**row.metrics, IMPULSE: factor * row.metrics[IMPULSE]})
            table.execute("UPDATE rows SET metrics = ? WHERE i = ?", (metrics, row.index))
    (out / "reruns" / f"{worst.index:06d}" / "summary.json").unlink()
    assert main(["campaign", "resume", str(out), "--workers", "1"]) == 3
    printed = capsys.readouterr().out
    assert f"reruns/{worst.index:06d}: run {worst.index} differs from its row: {IMPULSE} " in printed
    assert f"logs kept: {out / 'reruns'} (1 of 1 run differ from their rows)\n" in printed
    assert main(["campaign", "resume", str(out), "--workers", "1"]) == 0  # all logs are there
    assert "logs kept" not in capsys.readouterr().out


def test_the_number_of_runs_is_said_before_they_begin(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """All of them, then those that are left; nothing where none is."""
    path, out = rock_hits(tmp_path, metrics=[IMPULSE]), tmp_path / "out"
    name, runs = Campaign.load(path, tmp_path / "other").config.campaign, Campaign.open(tmp_path / "other").status().runs
    for lost, said in (
        (runs, f"{name}: {runs} runs to do"),
        (1, f"{name}: 1 run of {runs} to do"),
        (0, f"{name}: {runs} of"),
    ):
        if lost < runs:
            with sqlite3.connect(out / "rows.sqlite") as table:
                table.execute("DELETE FROM rows WHERE i < ?", (lost,))
        assert main(["campaign", "run", str(path), "--out", str(out), "--workers", "1"]) == 0
        assert capsys.readouterr().out.startswith(said)


def test_the_command_that_goes_on_after_a_stop_is_whole(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every run is late; the printed words are a command that completes the campaign."""
    path, out = rock_hits(tmp_path, metrics=[IMPULSE]), tmp_path / "out"
    given = ["campaign", "run", str(path), "--out", str(out), "--workers", "1"]
    assert main([*given, "-s", "limits.max_failed=0", "-s", "limits.timeout_s=1e-6"]) == 3
    words = shlex.split(capsys.readouterr().err.splitlines()[-1].partition("to continue anyway: ffsm ")[2])
    assert words[:5] == given[:5]
    assert main(words) == 0
    assert Campaign.open(out).status().left == 0


def test_a_metric_with_the_name_of_a_law_does_not_hide_that_the_law_is_of_a_script() -> None:
    class Mine(Fuse):
        """Defined here: no other process can import it."""

    own = ScriptClasses({"fuse": Mine}, {}, {"fuse": rock_hits})
    assert [name for name, each in own.every if not importable(each)] == ["fuse"]


@pytest.mark.parametrize("name", ["checks.energy", "excess.energy", "drift"])
def test_residuals_of_another_processor_may_differ(name: str) -> None:
    """They are rounding errors, and so is their excess over a tolerance."""
    assert _near(name, 1.5, 1.2)
    assert not _near("tip.min_error_m", 1.5, 1.2)
