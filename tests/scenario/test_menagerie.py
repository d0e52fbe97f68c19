"""Robots of MuJoCo Menagerie by name: run folder and log keep the files."""

from __future__ import annotations

import json
import sys
from unittest.mock import Mock
from urllib.error import URLError

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.cli.main import main
from ffsm_mj.errors import InputError
from ffsm_mj.replay import replay_log
from tests.model.fake_menagerie import DownloadError, Menagerie
from tests.scenes import ARM, ball, scene


@pytest.fixture
def shelf(tmp_path, monkeypatch):
    """The package, with one robot."""
    folder = tmp_path / "cache" / "otto"
    folder.mkdir(parents=True)
    (folder / "arm.xml").write_text(ARM)
    (folder / "ball.xml").write_text(ball())
    package = Menagerie(folder)
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", package)
    return package


def written(folder, robot, **changes):
    """A scenario of such a robot."""
    path = scene(folder, ARM, {})
    path.write_text(json.dumps(json.loads(path.read_text()) | {"robot": robot, "duration_s": 0.05} | changes))
    return path


def test_a_run_needs_no_second_download(tmp_path, shelf, monkeypatch):
    initial = {"joints": {"ball/free": [3, 0, 0, 1, 0, 0, 0]}}
    path = written(tmp_path, {"menagerie": "otto"}, objects={"ball": {"menagerie": "otto/ball"}}, initial=initial)
    run = ffsm_mj.run(path, out=tmp_path / "out")
    kept = sorted(name for name in run.log.header.files if name.endswith(".xml"))
    assert kept == ["mjcf/ball/ball.xml", "mjcf/robot/arm.xml"]
    assert shelf.downloads > 0
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", None)  # importing it fails
    assert np.array_equal(ffsm_mj.run(tmp_path / "out").log.rows, run.log.rows)
    assert replay_log(run.log).agrees


@pytest.mark.usefixtures("shelf")
def test_a_download_is_announced_with_size_and_time(tmp_path, capsys):
    """Before it begins and when it is done, and never again."""
    path = written(tmp_path, {"menagerie": "otto"})
    megabytes = (len(ARM) + len(ball())) / 1e6
    for said in ([f"download of otto: {megabytes:.1f} MB, once", "download of otto: done in 0.0 s"], []):
        ffsm_mj.Scenario.load(path)
        assert capsys.readouterr().err.splitlines() == said


@pytest.mark.usefixtures("shelf")
def test_in_python(tmp_path):
    phases = [{"name": "coast", "until": "end", "controller": {"kind": "off"}}]
    made = ffsm_mj.Scenario(name="x", duration_s=0.1, robot=ffsm_mj.Robot(menagerie="otto"), phases=phases)
    assert made.robot.model == str(tmp_path / "cache" / "otto" / "arm.xml")


@pytest.mark.parametrize(
    ("robot", "expected"),
    [
        ({"menagerie": "oto"}, "robot: oto: MuJoCo Menagerie: Unknown robot 'oto'. Did you mean 'otto'?"),
        ({"menagerie": "otto/leg"}, "robot: otto/leg: MuJoCo Menagerie: 'otto' has no entry point 'leg'; available: arm"),
        (
            {"menagerie": "otto", "mjcf": "robot.xml"},
            "robot: 'menagerie' is the name of a robot of MuJoCo Menagerie, in place of",
        ),
        ({"menagerie": 3}, "robot: 'menagerie' is the name of a robot of MuJoCo Menagerie"),
    ],
)
@pytest.mark.usefixtures("shelf")
def test_faults_are_named(tmp_path, robot, expected):
    with pytest.raises(InputError) as error:
        prepare(written(tmp_path, robot))
    assert expected in "\n".join(error.value.lines)


def test_the_package_is_named_where_it_is_missing(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", None)
    with pytest.raises(InputError, match="need the package mujoco-menagerie; install it: "):
        prepare(written(tmp_path, {"menagerie": "otto"}))


@pytest.mark.parametrize("error", [URLError("[Errno -3] Temporary failure in name resolution"), DownloadError("HTTP 503")])
def test_a_download_that_fails_says_what_to_do(tmp_path, shelf, monkeypatch, capsys, error):
    """As other bad input, by exit code 2."""
    monkeypatch.setattr(shelf, "get", Mock(side_effect=error))
    assert main(["new", "mission", "--menagerie", "otto", "--out", str(tmp_path / "new")]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert said.startswith("otto: MuJoCo Menagerie: the download failed (")
    assert said.endswith("); repeat it with a connection to the network, or give a model file that is there")
