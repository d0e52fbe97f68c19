"""``ffsm impact-map``: what it prints, the files it writes, and its exit codes."""

from __future__ import annotations

import csv

import pyarrow.parquet
import pytest

import ffsm_mj
from ffsm_mj.cli.main import main


def test_files_and_the_best_configuration(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    given = ["-s", "contacts.rules.0.restitution=0.5", "-s", "initial.joints.object/y=-0.45"]
    assert (
        main(["impact-map", "coasting", *given, "--samples", "8", "--starts", "0", "--minimize", "object_spin_rad_s"]) == 0
    )
    text = capsys.readouterr().out
    folder = tmp_path / "logs" / "coasting-impact-map"
    assert sorted(path.name for path in folder.iterdir()) == [
        "best.yaml",
        *(f"impact-map.{form}" for form in ("csv", "parquet", "png", "svg")),
    ]
    assert "8 of 8 drawn configurations reach it with the robot's centre of mass where it is in the run" in text
    assert "run logs/coasting-impact-map/best.yaml -s 'contacts.rules.0.restitution=0.5'\n" in text.replace(
        "-s contacts.rules.0.restitution=0.5", "-s 'contacts.rules.0.restitution=0.5'"
    )
    assert "initial.joints" not in text
    with (folder / "impact-map.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [row["origin"] for row in rows] == ["run"] + 8 * ["sample"]
    table = pyarrow.parquet.read_table(folder / "impact-map.parquet")
    assert table.schema.field("impulse_N_s").metadata[b"unit"] == b"N s"
    best = min((row for row in rows if row["status"] == "ok"), key=lambda row: float(row["object_spin_rad_s"]))
    run = ffsm_mj.run(folder / "best.yaml", {"stop_on_impact": True, "contacts.rules.0.restitution": 0.5})
    assert run.impacts[0].impulse_N_s == pytest.approx(float(best["impulse_N_s"]), rel=1e-9)


@pytest.mark.long
def test_a_scenario_that_goes_on_from_another_run(tmp_path, monkeypatch, capsys):
    """The best configuration begins anew, not at the instant of that run."""
    monkeypatch.chdir(tmp_path)
    ffsm_mj.run("coasting", {"duration_s": 4.95}, out="before", rerun=False)
    (tmp_path / "on.yaml").write_text("extends: coasting\nname: on\ninitial: {from: before, at_s: 4.9}\n")
    assert main(["impact-map", "on.yaml", "--samples", "3", "--starts", "0", "--out", "maps/a"]) == 0
    assert "differs from the map by" in capsys.readouterr().out
    assert ffsm_mj.run("maps/a/best.yaml", {"stop_on_impact": True}).impacts[0].time_s < 1e-9


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--impact", "2", "-s", "duration_s=5.5"], "the run has no impact 2"),
        (["--bounds", "joint_1"], "should be JOINT=LOW:HIGH"),
        (["--axes", "impulse_N_s", "x"], "--axes: unknown column 'x'"),
        (["--seed", "-1"], "--seed: -1"),
    ],
)
def test_bad_input_is_one_line(options, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["impact-map", "coasting", "--samples", "2", "--starts", "0", *options]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
