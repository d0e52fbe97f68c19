"""Sites that a scenario adds to the robot: positions, equality in log and rerun, faults."""

from __future__ import annotations

import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.cli.main import main
from ffsm_mj.errors import InputError
from ffsm_mj.log.scenario import compile_log
from ffsm_mj.yaml import plain_value, write_yaml
from tests.scenes import ARM, ball, scene


def reaching(folder, **sites):
    """The arm, with a task for a site that the scenario adds."""
    path = scene(
        folder,
        ARM,
        {"target": ball("target")},
        duration_s=0.05,
        initial={"joints": {"target/free": [9, 0, 0, 1, 0, 0, 0], "shoulder": 0.4}, "rates": {"elbow": 0.5}},
        task={"tip": "tip", "target_m": [1.0, 0.5, 0.0]},
    )
    path.write_text(json.dumps(json.loads(path.read_text()) | {"robot": {"mjcf": "robot.xml", "sites": sites}}))
    return path


def test_a_site_is_at_the_given_position(tmp_path):
    path = reaching(tmp_path, tip={"body": "lower", "pos_m": [0.5, 0.0, 0.1]})
    system = prepare(path).system
    site = system.mj.site("robot/tip")
    assert system.mj.body(site.bodyid[0]).name == "robot/lower"
    np.testing.assert_array_equal(site.pos, [0.5, 0.0, 0.1])
    data = mujoco.MjData(system.mj)
    mujoco.mj_forward(system.mj, data)
    np.testing.assert_allclose(data.site("robot/tip").xpos, [1.25, 0.0, 0.1], atol=1e-15)  # base 0.25, upper 0.5, lower 0.5


def test_log_and_rerun_have_the_site_too(tmp_path, capfd):
    out = tmp_path / "run"
    run = ffsm_mj.run(reaching(tmp_path, tip={"body": "finger"}), out=out, rerun=False)
    assert (out / "mjcf" / "robot" / "robot.xml").read_text() == ARM
    assert main(["analyze", str(out)]) == 0
    assert "columns agree with states" in capfd.readouterr().out
    np.testing.assert_array_equal(ffsm_mj.run(out).log.rows, run.log.rows)


@pytest.mark.parametrize(
    ("site", "said"),
    [
        (
            {"body": "lowr"},
            r"robot\.sites\.tip\.body: unknown body 'lowr' \(did you mean 'lower'\?\); allowed: base, finger, ",
        ),
        ({"body": "world"}, r"robot\.sites\.tip\.body: unknown body 'world'; allowed"),
        ({"body": "base", "pos_m": [0, 0]}, r"robot\.sites\.tip\.pos_m"),
    ],
)
def test_faults_of_a_site_are_reported_with_their_place(tmp_path, site, said):
    with pytest.raises(InputError, match=r"scene\.yaml:1:\d+: " + said):
        prepare(reaching(tmp_path, tip=site))


def test_a_site_of_the_model_is_not_replaced(tmp_path):
    path = reaching(tmp_path, tip={"body": "lower"})
    (tmp_path / "robot.xml").write_text(ARM.replace('<geom name="tip"', '<site name="tip"/><geom name="tip"'))
    with pytest.raises(InputError, match=r"robot\.sites\.tip: the model already has a site of this name; choose another"):
        prepare(path)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"body": "nobody"}, "the log: unknown body 'nobody'"),
        ({"body": "lower", "pos_m": [float("nan"), 0, 0]}, "not a scenario of this version"),
        ({"body": "lower", "pos_m": 5}, "not a scenario of this version"),
        ({"body": 7}, "not a scenario of this version"),
        ("lower", "not a scenario of this version"),
    ],
)
def test_a_log_with_invalid_entries_is_refused_in_one_line(tmp_path, wrong, said):
    """Invalid sites in a log give one line when its models are compiled."""
    run = ffsm_mj.run(reaching(tmp_path, tip={"body": "lower"}))
    data = plain_value(run.log.header.scenario_yaml)
    data["robot"]["sites"]["tip"] = wrong
    header = replace(run.log.header, scenario=write_yaml(data))
    with pytest.raises(InputError, match=said):
        compile_log(replace(run.log, header=header))
