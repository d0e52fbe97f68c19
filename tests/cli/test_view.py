"""``ffsm view`` of a scenario: which argument is what, and what the recording holds."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from ffsm_mj.cli.main import main
from tests.scenes import ball, scene

TASK = {"tip": "tip", "axes": ["x", "y"], "target_m": [0.3, 0.4]}
ARM = """<body name="arm" pos=".5 0 0"><joint name="elbow"/>
  <geom name="arm" type="capsule" fromto="0 0 0 .5 0 0" size=".02"/><site name="tip" pos=".5 0 0"/></body>"""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    return scene(
        tmp_path,
        ball("ball", mass=2.0, joints="x", extra=ARM),
        {"target": ball("target", mass=3.0, joints="x")},
        initial={"joints": {"target/x": 2.0}, "rates": {"robot/x": 1.0}},
        contacts={"rules": [{"between": ["ball", "target/target"], "restitution": 0.5}]},
        task=TASK,
        duration_s=0.05,
    )


@pytest.fixture
def opened(monkeypatch) -> list[dict[str, object]]:
    """Entities of the recordings that a viewer would have opened, on a machine with a display."""
    shown: list[dict[str, object]] = []

    def call(command: list[str]) -> int:
        shown.append({chunk.entity_path: chunk for chunk in RrdReader(command[-1]).stream()})
        return 0

    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(subprocess, "call", call)
    return shown


def test_a_scenario_shows_its_start(scenario, opened, capsys):
    assert main(["view", str(scenario)]) == 0
    (entities,) = opened
    assert {
        "/world/sites/robot/tip",
        "/world/targets/target_of_the_tip",
        "/world/reach/robot_tip",
        "/world/centres_of_mass/centre_of_mass_of_all",
        "/world/robot/ball/ball",
        "/contacts/robot/ball/ball",
        "/notes",
    } <= set(entities)
    assert [entity for entity in entities if entity.startswith("/contacts/pairs/")]
    assert not any(entity.startswith("/plots") for entity in entities)
    assert capsys.readouterr().err == ""


def test_an_existing_run_wins_over_a_scenario(scenario, tmp_path, opened, monkeypatch, capsys):
    """A run folder holds a scenario too, and may have the name of a shipped one."""
    monkeypatch.chdir(tmp_path)
    assert main(["run", str(scenario), "--out", "baseline", "--no-rerun"]) == 0
    assert main(["view", "baseline"]) == 0
    assert main(["view", "baseline/run.mcap"]) == 0
    assert main(["view", "baseline/scenario.yaml"]) == 0
    run, log, start = opened
    assert "/plots/energy" in run.keys() & log.keys()
    assert "/plots/energy" not in start
    capsys.readouterr()


@pytest.mark.parametrize("given", ["nowhere", "nowhere.yaml", "no/where"])
def test_the_message_says_what_was_tried(given, capsys):
    assert main(["view", given]) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"{given}: no run folder or log, no scenario file, and unknown shipped scenario")
    assert "; allowed: " in err


def test_without_a_display_a_recording_can_be_saved(scenario, tmp_path, monkeypatch, capsys):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert main(["view", str(scenario)]) == 3
    assert "--save scene.rrd" in capsys.readouterr().err
    saved = tmp_path / "scene.rrd"
    assert main(["view", str(scenario), "--save", str(saved), "-s", "initial.joints.target/x=1.5"]) == 0
    texts = [chunk for chunk in RrdReader(str(saved)).stream() if chunk.entity_path == "/notes"]
    assert len(texts) == 1
    assert capsys.readouterr().out == f"recording: {saved}\n"


def test_overrides_of_a_run_are_refused(scenario, tmp_path, capsys):
    assert main(["run", str(scenario), "--out", str(tmp_path / "out"), "--no-rerun"]) == 0
    capsys.readouterr()
    assert main(["view", str(tmp_path / "out"), "-s", "duration_s=1"]) == 2
    assert "-s has no effect" in capsys.readouterr().err


def test_an_invalid_scenario_is_refused_in_one_line(scenario, capsys):
    assert main(["view", str(scenario), "-s", "task.tip=nose", "--save", "never.rrd"]) == 2
    err = capsys.readouterr().err
    assert len(err.splitlines()) == 1
    assert "nose" in err
    assert not Path("never.rrd").exists()


def test_check_prints_poses_at_the_start(scenario, capsys):
    """Robot: 2 kg at 0 and the arm's mass at (0.75, 0, 0); the object's centre of mass is where its joint puts it."""
    assert main(["check", str(scenario)]) == 0
    out = capsys.readouterr().out
    rows = {line.split("  ")[2]: line for line in out.splitlines() if line.startswith("    ")}
    tip = np.array(rows["tip robot/tip"].split()[2:], dtype=float)
    np.testing.assert_allclose(tip, [1.0, 0, 0, 1, 0, 0, 0])
    assert rows["target of the tip"].split()[-3:] == ["0.3000", "0.4000", "0.0000"]
    assert rows["centre of mass of target"].split()[-3:] == ["2.0000", "0.0000", "0.0000"]
    assert "reach of robot/tip: at most 0.5000 m from joint robot/elbow at 0.5000 0.0000 0.0000" in out


@pytest.mark.parametrize(("angle", "warns"), [(90.0, True), (-7.0, True), (6.28, False)])
def test_check_warns_of_angles_beyond_one_turn(scenario, capsys, angle, warns):
    assert main(["check", str(scenario), "-s", f"initial.joints.elbow={angle}"]) == 0
    out = capsys.readouterr().out
    assert ("note: angles are in rad, and beyond one turn at the start: robot/elbow at" in out) == warns
    assert ("90 degrees are 1.5708 rad" in out) == (angle == 90.0)


def test_check_warns_of_a_target_beyond_the_reach(scenario, capsys):
    assert main(["check", str(scenario), "-s", "task.target_m=[3.0, 0.0]"]) == 0
    assert "note: the target is 2.5 m from joint robot/elbow, beyond the arm's reach of 0.5 m" in capsys.readouterr().out


@pytest.mark.parametrize(("x", "code"), [(0.2 - 2e-9, 2), (0.2 - 5e-10, 0)])
def test_overlap_at_the_start_is_refused_with_depth_and_pair(scenario, capsys, x, code):
    """Two balls of radius 0.1 m: beyond the tolerance of 1e-9 m."""
    assert main(["check", str(scenario), "-s", f"initial.joints.target/x={x}"]) == code
    out, err = capsys.readouterr()
    if code:
        assert "robot/ball and target/target overlap by 2e-09 m at the start" in err
    else:
        assert "valid" in out
