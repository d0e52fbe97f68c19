"""A sweep takes what a script has."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.errors import InputError
from ffsm_mj.experiments.campaign import Campaign
from tests.experiments.files import rock_hits


@pytest.mark.long
def test_values_may_be_numpy_s(tmp_path: Path) -> None:
    rock_hits(tmp_path)
    values = {"contacts.rules.second.restitution": np.linspace(0.5, 1.0, 2)}
    overrides = {"duration_s": np.float64(0.01), "initial.joints.stone/free": list(np.eye(7)[3] + np.eye(7)[0])}
    table = ffsm_mj.sweep(tmp_path / "scene.yaml", values, metrics=["duration_s"], overrides=overrides, workers=1)
    assert table.column("contacts.rules.second.restitution").to_pylist() == [0.5, 1.0]
    assert table.column("duration_s").to_pylist() == [0.01, 0.01]


@pytest.mark.long
def test_values_may_be_lists(tmp_path: Path) -> None:
    """Each run takes a whole one; in the table it is its text."""
    rock_hits(tmp_path)
    speeds = [[1.0, 0.0, 0.0, 0.0, 0.0, 0.0], np.array([2.0, 0.0, 0.0, 0.0, 0.0, 0.0])]
    table = ffsm_mj.sweep(
        tmp_path / "scene.yaml", {"initial.rates.robot/free": speeds}, metrics=["impacts.0.impulse_N_s"], workers=1
    )
    assert table.column("initial.rates.robot/free").to_pylist() == [
        "[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]",
        "[2.0, 0.0, 0.0, 0.0, 0.0, 0.0]",
    ]
    slow, fast = table.column("impacts.0.impulse_N_s").to_pylist()
    assert fast == pytest.approx(2.0 * slow, rel=1e-9)


def test_overrides_of_all_runs_are_texts_or_values_by_key(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Both forms give the same, of a sweep and of the file of a campaign. Progress goes to standard error."""
    rock_hits(tmp_path)
    values, asked = {"contacts.rules.second.restitution": [0.5]}, {"metrics": ["duration_s"], "workers": 1}
    for form in (["duration_s=0.02"], {"duration_s": np.float64(0.02)}):
        report = ffsm_mj.progress("sweep")
        table = ffsm_mj.sweep(tmp_path / "scene.yaml", values, overrides=form, report=report, **asked)
        assert table.column("duration_s").to_pylist() == [0.02]
        assert "sweep: 1 of 1 (100%)" in capsys.readouterr().err
    for i, form in enumerate((["samples.n=4"], {"samples.n": np.int64(4)})):
        assert Campaign.load("baseline-dispersed", tmp_path / f"{i}", overrides=form).status().runs == 4
    with pytest.raises(InputError, match=r"'duration_s=1' is one text; write \['duration_s=1'\]"):
        ffsm_mj.run("coasting", "duration_s=1")


def test_less_than_one_worker_is_refused(tmp_path: Path) -> None:
    campaign = Campaign.load(rock_hits(tmp_path), tmp_path / "out")
    for workers in (0, -1):
        with pytest.raises(InputError, match=f"workers: {workers} is less than 1"):
            campaign.run(workers=workers)
