"""Estimators of others: a class of a script, a plug-in that is broken, and what goes wrong while they work."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.controller_protocol import Signal, StrictModel
from ffsm_mj.errors import InputError
from ffsm_mj.experiments.campaign import Campaign
from ffsm_mj.experiments.executors import loop
from ffsm_mj.replay import replay_log
from tests.controllers.test_plugins import ffsm, install
from tests.experiments.files import campaign_file
from tests.replays import assert_replayed
from tests.scenes import two_balls
from tests.sensing.scenes import column

SERVO = {"kind": "pd", "joints": ["robot/x"], "kp": 5.0, "kd": 1.0, "target": [0.2]}


class Frozen:
    """Believes for ever what it was told at the start."""

    telemetry_signals = (Signal("estimate", "frozen_calls", "", "number of calls"),)

    def __init__(self, config, context):
        self.calls = 0

    def start(self, data):
        self.qpos, self.qvel = data.qpos.copy(), data.qvel.copy()

    def update(self, time_s, measured, events, data):
        self.calls += 1
        data.qpos[:], data.qvel[:] = self.qpos, self.qvel

    def telemetry(self):
        return (self.calls,)


class Shifted(Frozen):
    """The same, with a position that the scenario states."""

    class Config(StrictModel):
        """Where it believes that the ball is."""

        kind: Literal["shifted"]
        at_m: float

    def __init__(self, config, context):
        super().__init__(config, context)
        self.at_m = config.at_m

    def update(self, time_s, measured, events, data):
        super().update(time_s, measured, events, data)
        data.qpos[0] = self.at_m


class NotFinite(Frozen):
    def update(self, time_s, measured, events, data):
        data.qpos[0] = np.nan if time_s > 0.0045 else 0.0


class Raises(Frozen):
    def update(self, time_s, measured, events, data):
        if time_s > 0.0045:
            raise RuntimeError("lost the target")


class RaisesAtStart(Frozen):
    def start(self, data):
        raise RuntimeError("no map")


class TooLong(Frozen):
    def telemetry(self):
        return (1.0, 2.0)


class NoNumbers(Frozen):
    def telemetry(self):
        return ("many",)


def scenario(folder, **changes):
    phases = [{"name": "push", "until": "end", "controller": SERVO}]
    return two_balls(folder, **{"gap": 0.9, "duration_s": 0.01, "phases": phases, "estimator": {"kind": "mine"}, **changes})


def test_a_class_of_a_script_is_flown_and_told(tmp_path, capfd):
    """The servo acts on the first state for ever: the same force all the time."""
    out = tmp_path / "run"
    path = scenario(tmp_path)
    run = ffsm_mj.run(path, estimators={"mine": Frozen}, out=out, rerun=False)
    assert run.outcome == "completed"
    assert len(set(run["actuators.robot_push_x_command_N"])) == 1
    assert np.array_equal(run["estimate.frozen_calls"][:-1], np.arange(1.0, len(run.time)))
    assert_replayed(run)
    assert "\nscript_laws: [mine]\n" in (out / "scenario.yaml").read_text()
    again = pickle.loads(pickle.dumps(prepare(out, estimators={"mine": Frozen}))).run()
    assert np.array_equal(again.log.rows, run.log.rows, equal_nan=True)

    from ffsm_mj.cli.main import main

    capfd.readouterr()
    assert main(["run", str(out), "--no-rerun", "--out", str(tmp_path / "again")]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert "estimator.kind: the estimator of kind 'mine' was passed by a script" in line
    assert "ffsm_mj.run(..., estimators={'mine': ...})" in line


def test_a_class_with_settings_has_them_checked(tmp_path):
    run = ffsm_mj.run(scenario(tmp_path, estimator={"kind": "shifted", "at_m": 0.3}), estimators={"shifted": Shifted})
    assert set(run["estimate.q_robot_x_m"]) == {0.3}
    recipe = prepare(tmp_path / "scene.yaml", estimators={"shifted": Shifted})
    assert "\nestimator: {kind: shifted, at_m: 0.3}\n" in recipe.scenario_yaml
    with pytest.raises(InputError, match=r"estimator\.at_m: is missing"):
        prepare(scenario(tmp_path, estimator={"kind": "shifted"}), estimators={"shifted": Shifted})
    with pytest.raises(InputError, match=r"estimator: needs a 'kind'; allowed: direct, mekf, mine, truth"):
        prepare(scenario(tmp_path, estimator={"kid": "mine"}), estimators={"mine": Frozen})
    with pytest.raises(InputError, match="estimators: 'direct' is the name of an existing kind"):
        prepare(scenario(tmp_path), estimators={"direct": Frozen})
    with pytest.raises(InputError, match="estimators: 'mine' is no class with the methods start, update, telemetry"):
        prepare(scenario(tmp_path), estimators={"mine": object})


@pytest.mark.parametrize(
    ("estimator", "words"),
    [
        (NotFinite, "estimator 'mine' gives an estimate that is not finite"),
        (Raises, "estimator 'mine': RuntimeError: lost the target"),
        (RaisesAtStart, "estimator 'mine': RuntimeError: no map"),
        (TooLong, "estimator 'mine': telemetry gives 2 values for 1 signals"),
        (NoNumbers, "estimator 'mine': ValueError: could not convert string to float"),
    ],
)
def test_what_fails_in_flight_ends_the_run_with_one_line_and_a_log(tmp_path, estimator, words):
    run = ffsm_mj.run(scenario(tmp_path), estimators={"mine": estimator}, out=tmp_path / "run", rerun=False, check=False)
    assert run.outcome == "controller_failed"
    assert words in run.message
    assert "\n" not in run.message
    loaded = ffsm_mj.load_run(tmp_path / "run")
    assert loaded.outcome == "controller_failed"
    assert replay_log(loaded.log).agrees


def test_what_an_estimator_raises_is_raised(tmp_path):
    """The exception itself, not the one that says whose it is."""
    with pytest.raises(RuntimeError, match="lost the target") as caught:
        ffsm_mj.run(scenario(tmp_path), estimators={"mine": Raises})
    assert caught.traceback[-1].path == Path(__file__)


@pytest.mark.parametrize(
    ("signals", "words"),
    [
        ((Signal("controller", "calls", "", "calls"),), "'controller.calls' is no name in the group estimate"),
        (("calls",), "telemetry_signals is no sequence of Signal"),
        ((Signal("estimate", "q_robot_x_m", "m", "mine"),), "estimate.q_robot_x_m"),
    ],
)
def test_telemetry_that_cannot_be_columns_is_a_fault_of_the_estimator(tmp_path, signals, words):
    estimator = type("Own", (Frozen,), {"telemetry_signals": signals})
    with pytest.raises(InputError) as told:
        prepare(scenario(tmp_path), estimators={"mine": estimator})
    (line,) = told.value.lines
    assert words in line
    assert "scene.yaml" in line


@pytest.mark.long
def test_a_plugin_that_is_broken_is_named(tmp_path):
    environment = install(tmp_path / "bad", "bad", "import nothing_like_this\n", "broken = bad:Law", group="estimators")
    done = ffsm(environment, "check", str(scenario(tmp_path, estimator={"kind": "broken"})))
    assert done.returncode == 2
    (line,) = done.stderr.strip().splitlines()
    assert "the plugin for kind 'broken' cannot be used (ModuleNotFoundError: No module named 'nothing_like_this')" in line
    assert "usable: truth, direct, mekf" in line


def test_a_campaign_takes_estimators_of_a_script(tmp_path, capsys):
    """A servo, 5 N/m and 1 N s/m, to 0.2 m, of a ball believed at 0.3 m with 1 m/s: -1.5 N."""

    class Mine(Shifted):
        class Config(StrictModel):
            """Where it believes that the ball is."""

            kind: Literal["mine"]
            at_m: float

    scenario(tmp_path, estimator={"kind": "mine", "at_m": 0.1})
    options = {"estimators": {"mine": Mine}, "metrics": ["steps"]}
    table = ffsm_mj.sweep(tmp_path / "scene.yaml", {"estimator.at_m": [0.1, 0.3]}, out=tmp_path / "out", **options)
    assert table.column("outcome").to_pylist() == ["completed"] * 2
    assert "mine cannot be imported" in capsys.readouterr().err
    campaign = Campaign.open(tmp_path / "out", estimators={"mine": Mine})
    assert column(campaign.rerun(1).run, "actuators.robot_push_x_command_N")[0] == pytest.approx(-1.5)
    with pytest.raises(InputError, match="'mine'"):
        Campaign.open(tmp_path / "out")


def test_another_estimator_is_another_campaign(tmp_path):
    scenario(tmp_path)
    path = campaign_file(tmp_path, {"seed": {"choice": [1, 2]}}, {"kind": "grid"})
    campaign = Campaign.load(path, tmp_path / "out", estimators={"mine": Frozen})
    assert pickle.loads(pickle.dumps(campaign._job(exclusive=True))).classes.estimators == {"mine": Frozen}
    campaign.run(loop().open())
    with pytest.raises(InputError, match="holds a campaign with other settings: estimators"):
        Campaign.load(path, tmp_path / "out", estimators={"mine": Raises}).run(loop().open())
