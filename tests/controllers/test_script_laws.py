"""Control laws from a script: no package, no code in a file, told by the log."""

from __future__ import annotations

import pickle
import re
import warnings
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.controller_protocol import Signal, StrictModel
from ffsm_mj.errors import InputError
from ffsm_mj.experiments.impact_map.reach import target_of


class Damp:
    """Viscous damping of one joint, no settings."""

    telemetry_signals = (Signal("controller", "damp_torque_N_m", "N m", "torque that damps"),)
    gain = 5.0

    def __init__(self, config, context):
        self.config = config
        self.motor = context.system.index("actuator", "motor_2")
        self.torque = 0.0

    def start(self, observation):
        self.start_s = observation.time_s

    def control(self, observation, command):
        self.torque = -self.gain * observation.data.qvel[4]
        command.drive([self.motor], self.torque)

    def telemetry(self):
        return (self.torque,)


class GainConfig(StrictModel):
    kind: Literal["tuned"]
    gain: float


class Tuned(Damp):
    """The same with a gain."""

    Config = GainConfig

    def __init__(self, config, context):
        super().__init__(config, context)
        self.gain = config.gain


def settle(**controller):
    return {"duration_s": 1.0, "phases": [{"name": "settle", "until": "end", "controller": controller}]}


def test_a_law_without_settings_runs_and_is_told(tmp_path, capfd):
    """From a class in a script to a log that analyze understands; the command line says why it cannot run it again."""
    out = tmp_path / "run"
    run = ffsm_mj.run("coasting", settle(kind="mine"), controllers={"mine": Damp}, out=out, rerun=False)
    assert run.outcome == "completed"
    assert np.any(run["controller.damp_torque_N_m"])
    assert run.summary()["controller"]["phases"][0]["kind"] == "mine"
    assert all(check.passes for check in all_checks(ffsm_mj.load_run(out)))
    assert "\nscript_laws: [mine]\n" in (out / "scenario.yaml").read_text()
    again = ffsm_mj.run(out, controllers={"mine": Damp})
    np.testing.assert_array_equal(again.log.rows, run.log.rows)

    from ffsm_mj.cli.main import main

    capfd.readouterr()
    assert main(["run", str(out), "--no-rerun", "--out", str(tmp_path / "again")]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith(str(out / "scenario.yaml"))
    assert "phases.0.controller.kind: the control law of kind 'mine' was passed by a script" in line
    assert main(["analyze", str(out)]) == 0


def documented(number):
    """What a script of the page leaves, run as it stands."""
    page = (Path(__file__).parents[2] / "docs" / "own-controller.md").read_text()
    scripts = re.findall(r"```py\n(.*?)```", page, flags=re.DOTALL)
    assert len(scripts) == 4
    names = {}
    exec(compile(scripts[number], "own-controller.md", "exec", dont_inherit=True), names)
    assert names["run"].outcome == "completed", names["run"].message
    return names


def test_the_documented_script_runs():
    """The damped joint slows down."""
    rate = documented(0)["run"].qvel[:, 4]
    assert abs(rate[-1]) < 0.5 * abs(rate[0])


def test_the_documented_law_of_the_task_runs(capsys):
    """The distance falls as (1 + w t) exp(-w t); torques held for 1 ms make an error of first order, 4e-4 m in 5 s."""
    run = documented(1)["run"]
    distance = run.tip_error()
    for time_s, exact in ((2.0, 3.836438), (5.0, 1.925855)):
        assert distance[np.searchsorted(run.time, time_s - 1e-9)] == pytest.approx(exact, abs=8e-4)
    assert float(capsys.readouterr().out) == distance[-1]


def test_the_documented_law_around_another_runs():
    """After a quarter of a second it commands a quarter of what its inner law would."""
    run = documented(2)["run"]
    motors = [f"actuators.robot_motor_{i}_command_N_m" for i in (1, 2, 3)]
    quarter = np.array([run[key][250] for key in motors])
    initial = {"joints": {}, "rates": {}}
    for joint, kind in (("base_x", "q"), ("base_y", "q"), ("base_yaw", "q"), *((f"joint_{i}", "q") for i in (1, 2, 3))):
        unit = "m" if joint in ("base_x", "base_y") else "rad"
        initial["joints"][joint] = float(run[f"state.{kind}_robot_{joint}_{unit}"][250])
        initial["rates"][joint] = float(run[f"state.v_robot_{joint}_{unit}_s"][250])
    initial["joints"] |= {"object/x": 3.5, "object/y": -0.5}
    inner = {"kind": "task_ct", "position": {"kp_1_s2": 0.16, "kd_1_s": 0.8}}
    phase = {"name": "reach", "until": "end", "controller": inner}
    whole = ffsm_mj.run("baseline", {"duration_s": 0.001, "initial": initial, "phases": [phase]})
    np.testing.assert_allclose(quarter, [0.25 * whole[key][0] for key in motors], rtol=1e-9)


def test_settings_are_checked_and_used():
    """Twice the gain, twice the first torque; a wrong key is told with its place and what is allowed."""
    first = []
    for gain in (2.0, 4.0):
        run = ffsm_mj.run("coasting", settle(kind="tuned", gain=gain), controllers={"tuned": Tuned})
        first.append(run["controller.damp_torque_N_m"][0])
    assert first[1] == pytest.approx(2.0 * first[0], rel=1e-15)
    assert first[0] != 0.0
    with pytest.raises(InputError, match=r"phases\.0\.controller\.gian: unknown key.*gain"):
        prepare("coasting", settle(kind="tuned", gian=2.0), controllers={"tuned": Tuned})
    with pytest.raises(InputError, match=r"phases\.0\.controller\.gain: is missing"):
        prepare("coasting", settle(kind="tuned"), controllers={"tuned": Tuned})
    with pytest.raises(InputError, match=r"controller\.kind: unknown kind 'mime'.*mine"):
        prepare("coasting", settle(kind="mime"), controllers={"mine": Damp})


def test_a_recipe_with_a_law_of_a_script_can_be_pickled():
    recipe = prepare("coasting", settle(kind="mine"), controllers={"mine": Damp})
    again = pickle.loads(pickle.dumps(recipe))
    np.testing.assert_array_equal(again.run().log.rows, recipe.run().log.rows)


@pytest.mark.parametrize(
    ("laws", "fault"),
    [
        ({"pd": Damp}, "controllers: 'pd' is the name of an existing kind"),
        ({"mine": "Damp"}, "controllers: 'mine' is no class with the methods"),
        ({"mine": object}, "controllers: 'mine' is no class with the methods start, control, telemetry"),
        ({"mine": Tuned}, r"controllers: the Config of 'mine' needs the field kind: Literal\['mine'\]"),
        ({"mine": type("Bare", (Damp,), {"telemetry_signals": None})}, "controllers: 'mine' has no telemetry_signals"),
        ({"mine": type("Loose", (Damp,), {"Config": dict})}, "controllers: the Config of 'mine' is no .*StrictModel"),
    ],
)
def test_what_is_no_law_is_refused(laws, fault):
    with pytest.raises(InputError, match=fault):
        prepare("coasting", controllers=laws)


def test_a_law_of_a_script_that_fails_ends_the_run_with_its_line(tmp_path):
    class Broken(Damp):
        def control(self, observation, command):
            raise ZeroDivisionError("nothing to divide by")

    run = ffsm_mj.run(
        "coasting", settle(kind="mine"), controllers={"mine": Broken}, out=tmp_path / "run", rerun=False, check=False
    )
    assert run.outcome == "controller_failed"
    assert "mine" in run.message
    assert "nothing to divide by" in run.message


def test_a_law_commands_actuators_by_name():
    """With the prefix of the model or without, one or several: the same rows as by ids."""

    class Named(Damp):
        def control(self, observation, command):
            self.torque = -self.gain * observation.data.qvel[4]
            command.drive("motor_2", self.torque)

    class Several(Damp):
        def control(self, observation, command):
            self.torque = -self.gain * observation.data.qvel[4]
            command.drive(["robot/motor_2"], np.array([self.torque]))

    rows = [
        ffsm_mj.run("coasting", settle(kind="mine"), controllers={"mine": law}).log.rows.tobytes()
        for law in (Damp, Named, Several)
    ]
    assert rows[0] == rows[1] == rows[2]


def test_what_a_law_commands_wrongly_is_told_with_its_file_and_line():
    """A name that no actuator has, at the line that drives it; an effort that is not finite, at the method that gave it."""

    class Unknown(Damp):
        def control(self, observation, command):
            command.drive("motr_2", 1.0)

    class NotFinite(Damp):
        def control(self, observation, command):
            command.drive("motor_2", np.nan)

    for law, words, above in (
        (Unknown, r"unknown actuator 'motr_2' \(did you mean 'robot/motor_2'\?\)", 1),
        (NotFinite, "non-finite", 0),
    ):
        run = ffsm_mj.run("coasting", settle(kind="mine"), controllers={"mine": law}, check=False)
        line = law.control.__code__.co_firstlineno + above
        assert re.search(rf"{words}.* \({Path(__file__).name}:{line}\)$", run.message)


@pytest.mark.filterwarnings("default::ffsm_mj.errors.ScenarioNote")
def test_notes_of_a_scenario_are_warnings_at_the_line_that_runs_it():
    """Of a run and of a simulator; none where the package itself runs the scenario."""
    notes = ffsm_mj.Scenario.load("coasting").check()
    short = {"duration_s": 0.01}
    with pytest.warns(ffsm_mj.ScenarioNote) as told:
        ffsm_mj.run("coasting", short)
    assert [str(one.message) for one in told] == [f"coasting: {note}" for note in notes]
    assert {Path(one.filename).name for one in told} == {Path(__file__).name}
    with pytest.warns(ffsm_mj.ScenarioNote, match="coasting: "):
        ffsm_mj.Simulator("coasting", short)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        target_of("baseline", {"duration_s": 9.0})


@pytest.mark.parametrize("method", ["__init__", "start", "control", "telemetry", "summary"])
def test_an_error_of_a_law_is_raised_again_with_its_traceback(tmp_path, method):
    """Wherever the law raises; the log of a run that had begun is kept and complete."""

    def wrong(*_):
        raise ZeroDivisionError("in the law")

    law = type("Wrong", (Damp,), {method: wrong})
    arguments = {"controllers": {"wrong": law}, "out": tmp_path / "a"}
    with pytest.raises(ZeroDivisionError, match="in the law") as caught:
        ffsm_mj.run("coasting", settle(kind="wrong"), **arguments)
    assert caught.traceback[-1].name == "wrong"
    if method == "__init__":
        assert not (tmp_path / "a").exists()
    else:
        assert ffsm_mj.load_run(caught.value.run_folder).outcome == "controller_failed"
        ended, log = caught.value.__notes__
        assert ended.startswith("the run has ended: controller_failed: ")
        assert log == f"log of the run: {tmp_path / 'a' / 'run.mcap'}"


class Asks(Damp):
    """Asks for a sensor that no model has."""

    def control(self, observation, command):
        observation.measured["gyroo"]


def test_a_wrong_name_of_a_sensor_is_a_mistake_of_the_law():
    """The message names the line of the law, not ours, and lists the sensors; of the run in memory there is no folder."""
    sensors = {f"site_{i}": {"kind": "framepos", "of": "robot/tip"} for i in range(22)}
    sensors["gyro"] = {"kind": "frameangvel", "of": "robot/tip"}
    changes = settle(kind="asks") | {"sensors": sensors}
    run = ffsm_mj.run("coasting", changes, controllers={"asks": Asks}, check=False)
    line = Asks.control.__code__.co_firstlineno + 1
    assert "unknown sensor 'gyroo' (did you mean 'gyro'?); the sensors are gyro, site_0, " in run.message
    assert run.message.endswith(f" and 13 more (test_script_laws.py:{line})")
    with pytest.raises(KeyError, match="unknown sensor 'gyroo'") as caught:
        ffsm_mj.run("coasting", changes, controllers={"asks": Asks})
    assert caught.value.run_folder is None


def test_a_folder_that_holds_a_run_is_refused_before_the_scenario_is_read(tmp_path):
    """In the words of Python."""
    ffsm_mj.run("coasting", {"duration_s": 0.01}, out=tmp_path / "a")
    with pytest.raises(InputError, match=r"choose another out=\.\.\., or force=True to replace a run"):
        ffsm_mj.run("no such scenario", out=tmp_path / "a")
