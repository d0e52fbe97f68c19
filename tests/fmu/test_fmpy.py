"""Under FMPy: rows of a simulator bit for bit, states to go back to, and what is refused."""

from __future__ import annotations

import shutil
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu

import ffsm_mj
from ffsm_mj.cli.main import main
from ffsm_mj.fmu.co_simulation import CoSimulationState
from ffsm_mj.state import StateError
from tests.contact_models.grasp.scenes import OFF, grasping
from tests.fmu.masters import Instance, unit
from tests.replays import proved
from tests.sensing.test_grasps import SENSORS
from tests.test_docs import python_blocks

TAP = {"duration_s": 2.0}
DRIVE, COMMAND = "robot/drive", "actuators.robot_drive_command_N"
HANDED_OVER = {f"{DRIVE}.external": True}


def law(place, rate):
    return 20.0 * (0.5 - place) - 2.0 * rate


@pytest.fixture(scope="module")
def tap(tmp_path_factory):
    """A paddle that taps a ball: impacts, and a contact that lasts."""
    return unit(tmp_path_factory.mktemp("tap"), "tap", TAP)


def stroke(instance):
    return instance["state.q_robot_stroke_m"], instance["state.v_robot_stroke_m_s"]


def test_rows_are_those_of_a_simulator_through_impacts_and_contacts(tap):
    """The law is in the master; its command is held over each control period, as the simulator holds it."""
    instance, rows, forces = Instance(tap, **HANDED_OVER), [], []
    simulator = ffsm_mj.Simulator("tap", TAP)
    simulator.reset()
    data, expected, told = simulator.assembly.data, [], []
    place, rate = (simulator.system.joints["robot/stroke"].qpos.start, simulator.system.joints["robot/stroke"].dofs.start)
    for _ in range(399):
        instance.set(**{COMMAND: law(*stroke(instance))})
        instance.step(0.005)
        rows.append(instance.numbers("state."))
        forces.append(instance["contact.paddle_force_x_N"])
        step = simulator.step({DRIVE: law(data.qpos[place], data.qvel[rate])})
        expected.append(np.concatenate((data.qpos, data.qvel)))
        told.append(sum(contact.force_N[0] for contact in step.observation.contacts if contact.pair == "paddle"))
    assert np.array_equal(rows, expected)
    assert np.array_equal(forces, told)
    assert max(np.abs(forces)) > 0.1
    run = simulator.close()
    assert instance["events.impacts"] == len(run.impacts) > 3
    assert instance["events.contact_beginnings"] == len(run.contacts) > 0
    assert run.qpos[-1] != pytest.approx(run.qpos[0])


def test_rows_of_a_grasp_with_sensors_are_those_of_a_run(tmp_path):
    """Steps of the master are of 7 control periods, and the parameter shortens the run to 91 of them."""
    scenario = grasping(
        tmp_path,
        sensors=SENSORS,
        phases=[
            {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": OFF},
            {"name": "hold", "until": "end", "controller": OFF},
        ],
        initial={
            "joints": {"target/free": [1.16, 0.03, 0.02, 1, 0, 0, 0]},
            "rates": {"target/free": [-0.3, 0, 0, 0.4, 0, 0]},
        },
    )
    run = ffsm_mj.run(scenario, {"duration_s": 0.637})
    assert len(run.grasps) == 1
    instance = Instance(unit(tmp_path, scenario), duration_s=0.637)
    for row in range(7, 638, 7):
        instance.step(0.007)
        for group in ("state.", "sensor."):
            names = [name for name in instance.places if name.startswith(group)]
            assert np.array_equal(instance.numbers(group), [run[name][row] for name in names], equal_nan=True)
    assert instance["events.grasp_impulses"] == 1
    assert (instance["phase.index"], instance["ended"], instance["outcome"]) == (1, True, "completed")


def test_a_scenario_that_goes_on_from_another_run_begins_there(tmp_path):
    """Its unit starts at the time of that state, carries the other run along, and goes on as the simulator does."""
    ffsm_mj.run("tap", TAP, out=tmp_path / "before", rerun=False)
    scenario = ffsm_mj.Scenario.load("tap", TAP)
    file = tmp_path / "later.yaml"
    before = tmp_path / "before"
    file.write_text(f"name: later\nextends: {before / 'scenario.yaml'}\ninitial: {{from: {before}, at_s: 1.2}}\n")
    later = unit(tmp_path, file)
    shutil.rmtree(before)
    instance = Instance(later, start_s=1.2)
    for _ in range(16):
        instance.step(0.05)
    assert instance["outcome"] == "completed"
    run = scenario.run()
    assert np.array_equal(instance.numbers("state.q_"), run.qpos[-1])
    with pytest.raises(FMICallException, match="fatal"):
        Instance(later, start_s=0.0)


def test_the_validator_has_no_complaint(tap):
    assert validate_fmu(str(tap)) == []


def test_variables_are_declared_as_columns_of_a_log(tap):
    """Names, units and meanings; bounds of inputs are those of the motors, starts of parameters those of the scenario."""
    run = ffsm_mj.run("tap", {"duration_s": 0.1})
    signals = {signal.key: signal for signal in run.log.header.layout.signals}
    declared = {one.name: one for one in fmpy.read_model_description(str(tap)).modelVariables}
    outputs = [one for one in declared.values() if one.causality == "output" and one.type == "Real"]
    assert len(outputs) > 20
    for one in outputs:
        assert one.name in signals, one.name
        assert (one.unit or "") == signals[one.name].unit
    assert (declared["contacts.rules.0.restitution"].start, declared["contacts.rules.0.restitution"].variability) == (
        "0.4",
        "fixed",
    )
    command = fmpy.read_model_description(str(tap)).modelVariables
    assert {one.name: one.unit for one in command if one.causality == "input"} == {COMMAND: "N"}


def test_a_step_back_is_as_if_it_had_not_been(tap):
    """To states before an impact, in the same and in another instance; the number of impacts goes back too."""
    straight, restless = Instance(tap, **HANDED_OVER), Instance(tap, name="restless", **HANDED_OVER)
    random, ends = np.random.default_rng(5), []
    for k in range(40):
        for instance in (straight, restless):
            instance.set(**{COMMAND: law(*stroke(instance))})
        straight.step(0.03)
        state, time_s = restless.slave.getFMUState(), restless.time_s
        if k == 20:
            data = restless.slave.serializeFMUState(state)
            restless = Instance(tap, name="third", **HANDED_OVER)
            state = restless.slave.deSerializeFMUstate(data)
            restless.slave.setFMUState(state)
            restless.time_s = time_s
        held = restless[COMMAND]
        for _ in range(int(random.integers(0, 4))):
            restless.set(**{COMMAND: float(random.uniform(-5.0, 5.0))})
            restless.step(0.005 * int(random.integers(1, 20)))
            restless.slave.setFMUState(state)
            restless.time_s = time_s
        assert restless[COMMAND] == held
        restless.step(0.03)
        restless.slave.freeFMUState(state)
        ends.append((straight["events.impacts"], restless["events.impacts"]))
        assert np.array_equal(straight.numbers("state."), restless.numbers("state."))
        assert np.array_equal(straight.numbers("contact."), restless.numbers("contact."))
    assert len({one for one, _ in ends}) > 2
    assert all(one == other for one, other in ends)


@pytest.mark.parametrize("data", [b"", b"[1, 2]\n", b"\xff", b"7\n{}"])
def test_bytes_that_are_no_state_are_refused(data):
    with pytest.raises(StateError, match="not a state of a unit"):
        CoSimulationState.from_bytes(data)


def test_what_is_refused_leaves_the_state_and_says_why(tap):
    instance = Instance(tap, **HANDED_OVER)
    instance.step(0.5)
    before = instance.numbers("state.")
    for time_s, step_s, words in (
        (0.5, 0.0125, "a step of 0.0125 s is no multiple of the control period of 0.005 s"),
        (0.5, 0.0, "a step of 0 s is no multiple"),
        (0.4, 0.1, "a step from t = 0.4 s, where the run is at t = 0.5 s: restore a state to go back"),
        (0.6, 0.1, "a step from t = 0.6 s, where the run is at t = 0.5 s"),
    ):
        with pytest.raises(FMICallException, match="discard"):
            instance.slave.doStep(time_s, step_s)
        assert instance.messages[-1].startswith(words)
    for value in (float("nan"), float("inf")):
        instance.set(**{COMMAND: value})
        with pytest.raises(FMICallException, match="discard"):
            instance.step(0.1)
        assert instance.messages[-1] == f"{COMMAND} is {value}, not a finite number"
    assert np.array_equal(instance.numbers("state."), before)
    instance.set(**{COMMAND: 1.0})
    instance.step(0.1)
    assert not np.array_equal(instance.numbers("state."), before)
    with pytest.raises(FMICallException, match="discard"):
        instance.step(10.0)
    assert instance.messages[-1] == "the run ended at t = 2 s, inside the step to 10.6 s: completed"
    assert (instance["ended"], instance["outcome"]) == (True, "completed")
    with pytest.raises(FMICallException, match="discard"):
        instance.slave.doStep(2.0, 0.1)
    assert instance.messages[-1] == "the run has ended: completed, at t = 2 s"


@pytest.mark.parametrize(
    ("start_s", "values", "words"),
    [
        (1.0, {}, "start time 1 s: the scenario begins at 0 s"),
        (0.0, {"contacts.rules.0.restitution": -3.0}, "should be greater than or equal to 0, got -3"),
        (0.0, {"overrides": "contacts.rules.0.restitutio=0.3"}, "unknown key"),
        (0.0, {"overrides": "objects.wall=null"}, "wall"),
    ],
)
def test_a_beginning_that_the_scenario_does_not_allow_is_refused_in_one_line(tap, start_s, values, words):
    messages = []
    with pytest.raises(FMICallException, match="fatal"):
        Instance(tap, start_s, messages=messages, **values)
    assert words in messages[-1]


def test_a_unit_whose_scenario_was_edited_is_refused(tap):
    folder = Path(fmpy.extract(str(tap)))
    scenario = folder / "resources" / "scenario" / "scenario.yaml"
    scenario.write_text(scenario.read_text().replace("restitution: 0.4", "restitution: 0.7"))
    with pytest.raises(Exception, match="Failed to instantiate"):
        Instance(tap, folder=str(folder))
    shutil.rmtree(folder)


def test_parameters_and_a_log(tap, tmp_path):
    """A parameter changes the run as the same override does; the log replays, and its checks pass."""
    folder = tmp_path / "log"
    instance = Instance(tap, record=str(folder), **{"contacts.rules.1.restitution": 0.5, "duration_s": 1.0})
    instance.step(1.0)
    assert instance["outcome"] == "completed"
    instance.slave.terminate()
    run = ffsm_mj.run("tap", {"duration_s": 1.0, "contacts.rules.1.restitution": 0.5})
    logged = ffsm_mj.load_run(folder)
    assert np.array_equal(logged.qpos, run.qpos)
    assert np.array_equal(logged.qvel, run.qvel)
    proved(logged)


def test_commands_of_a_co_simulation_are_played_back(tap, tmp_path):
    """FMPy's table of what its master set, and the unit's own log: both repeat the run, whose checks hold."""
    log, table = tmp_path / "log", [("time", COMMAND)]
    instance = Instance(tap, record=str(log), **HANDED_OVER)
    for _ in range(400):
        instance.set(**{COMMAND: law(*stroke(instance))})
        table.append((instance.time_s, instance[COMMAND]))
        instance.step(0.005)
    instance.slave.terminate()
    recorded = ffsm_mj.load_run(log)
    proved(recorded)
    kinds = np.dtype([(name, float) for name in table[0]])
    fmpy.write_csv(str(tmp_path / "commands.csv"), np.array(table[1:], dtype=kinds))
    for file in (tmp_path / "commands.csv", log):
        phases = [{"name": "play", "until": "end", "controller": {"kind": "playback", "file": str(file)}}]
        run = ffsm_mj.run("tap", TAP | {"phases": phases})
        assert np.array_equal(run.qpos, recorded.qpos)
        assert len(run.impacts) == len(recorded.impacts) > 3


def test_the_example_of_the_page_runs(tap, tmp_path, monkeypatch, capsys):
    shutil.copy(tap, tmp_path / "tap.fmu")
    monkeypatch.chdir(tmp_path)
    (code,) = (block for block in python_blocks("docs/co-simulation.md") if "FMU2Slave" in block)
    exec(code, {})
    assert capsys.readouterr().out == "[9] impacts\n"


def test_the_command_says_what_the_unit_has(tmp_path, capsys):
    file = tmp_path / "tap.fmu"
    assert main(["fmu", "tap", "--out", str(file)]) == 0
    assert f"{file}: FMI 2.0 co-simulation, 1 input, 37 outputs, " in capsys.readouterr().out.replace("\n", " ")
    assert validate_fmu(str(file)) == []
    assert main(["fmu", "tap", "--out", str(tmp_path / "tap.zip")]) == 2
    assert capsys.readouterr().err.endswith("tap.zip: the name of a unit ends in .fmu\n")
