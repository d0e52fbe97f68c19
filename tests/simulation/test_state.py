"""Explicit state: out at any decision, through bytes, into a fresh process, and on to the end, bit for bit."""

import json
import subprocess
import sys
from dataclasses import replace
from hashlib import sha256
from random import Random

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.assembly.simulator import SimulatorError, SimulatorState
from ffsm_mj.errors import InputError
from ffsm_mj.log.mcap.reader import stored_states
from ffsm_mj.scenario.shipped import scenario_names
from ffsm_mj.state import StateError, from_bytes, to_bytes
from tests.contact.unions.scenes import fixed, geoms, on
from tests.contact.unions.test_slides import CUBE
from tests.simulation.restored import is_rest_of, overrides, rest, told

SCENARIOS = sorted(scenario_names())
TICKS = 10
"""Random control ticks of each scenario."""


def saved(scenario, given, wanted):
    """A run, and its states at some of its decisions: numbers of events and times of ticks, s."""
    simulator = ffsm_mj.Simulator(scenario, given)
    simulator.reset()
    states, number, ticks = [], 0, sorted(each for each in wanted if isinstance(each, float))
    while not simulator.ended:
        step = simulator.step(until="event")
        if simulator.ended:
            break
        number += bool(step.events)
        is_due = ticks and simulator.time_s >= ticks[0] and not step.events
        if is_due:
            del ticks[0]
        if is_due or (step.events and (number in wanted or "events" in wanted)):
            states.append(simulator.get_state().to_bytes())
    return told(simulator.close()), states


def check_in_another_process(folder, scenario, given, wanted):
    """The rest of a run from each state, in one process that knows nothing else of it."""
    whole, states = saved(scenario, given, wanted)
    assert states
    (folder / "job.json").write_text(json.dumps({"scenario": scenario, "overrides": given}))
    for i, state in enumerate(states):
        (folder / f"{i:03}.state").write_bytes(state)
    subprocess.run([sys.executable, "-m", "tests.simulation.restored", str(folder)], check=True, timeout=1200)
    for file in sorted(folder.glob("*.state")):
        part = json.loads(file.with_suffix(".json").read_text()) | {"rows": np.load(file.with_suffix(".npy"))}
        assert is_rest_of(whole, part), from_bytes(file.read_bytes())["time_s"]


@pytest.mark.long(one_of=25)
@pytest.mark.parametrize("scenario", sorted(SCENARIOS, key=lambda name: name != "berth"))
def test_in_another_process(scenario, tmp_path):
    """Two points of each scenario: its second event, and a random tick."""
    given = overrides(scenario)
    duration_s = prepare(scenario, given).scenario.duration_s
    check_in_another_process(tmp_path, scenario, given, (2, Random(scenario).uniform(0.1, 0.9) * duration_s))


@pytest.mark.long(one_of=100)
@pytest.mark.parametrize("scenario", sorted(SCENARIOS, key=lambda name: name != "no-actuation"))
def test_at_every_event_and_at_random_ticks(scenario, tmp_path):
    random, duration_s = Random(scenario), prepare(scenario).scenario.duration_s
    check_in_another_process(tmp_path, scenario, {}, ("events", *(random.uniform(0.0, duration_s) for _ in range(TICKS))))


@pytest.fixture(scope="module")
def tap():
    """A run with contact that lasts, and its state in it."""
    given = {"duration_s": 0.4}
    whole, states = saved("tap", given, (0.25,))
    return given, whole, SimulatorState.from_bytes(states[0])


def changed(state, path, change):
    """A state with a value of one of its parts changed."""
    parts = json.loads(to_bytes(state).partition(b"\n")[2])
    place = parts
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = change(place[path[-1]])
    return SimulatorState.from_bytes(sealed(json.dumps(parts).encode()))


def sealed(text):
    """A state with the digest of its text."""
    return b"ffsm-state 1 " + sha256(text).hexdigest()[:32].encode() + b"\n" + text


SHORT = {"$array": ["<f8", [1], "AAAAAAAAAAA="]}


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize(
    ("path", "change"),
    [
        (("parts", "plant", "data"), lambda _: SHORT),
        (("parts", "plant", "data"), lambda _: None),
        (("parts", "plant", "integrator", "sources"), lambda _: {}),
        (("parts", "plant", "integrator", "sources", "contact", "closed", "pressing"), lambda _: [99]),
        (("parts", "plant", "integrator", "sources", "contact", "logged"), lambda _: ["nothing"]),
        (("parts", "plant", "balance", "numbers"), lambda _: SHORT),
        (("parts", "plant", "actuation", "valves"), lambda _: None),
        (("parts", "controller", "laws"), lambda _: 3),
        (("parts", "controller", "phase_index"), lambda _: 17),
        (("parts", "progress", "steps"), lambda _: "many"),
        (("parts", "progress"), lambda _: {"steps": 1}),
        (("parts", "evaluation", "pending"), lambda _: [{"kind": "nothing", "fields": {}}]),
        (("parts", "watch", "open"), lambda _: [1, 2]),
    ],
)
def test_a_state_that_does_not_fit_is_refused(tap, path, change):
    """By one error, whatever is wrong; the simulator begins again afterwards."""
    given, whole, state = tap
    simulator = ffsm_mj.Simulator("tap", given)
    with pytest.raises(StateError):
        simulator.set_state(changed(state, path, change))
    simulator.set_state(state)
    while not simulator.ended:
        simulator.step()
    assert is_rest_of(whole, told(simulator.close()))


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"ffsm-state 2 0\n{}",
        b"ffsm-state 1\n{}",
        to_bytes({"a": 1.0}).replace(b"1.0", b"2.0"),
        sealed(b""),
        sealed(b"{"),
        sealed(b'{"$array": ["O", [1], ""]}'),
        sealed(b'{"$array": ["<f8", [1000000000], ""]}'),
        sealed(b'{"$array": ["<f8", [1e400], ""]}'),
        sealed(b'{"$float": "1"}'),
        sealed(b'{"$code": "1"}'),
        sealed(b"[" * 100_000),
    ],
)
def test_bytes_of_no_state(data):
    with pytest.raises(StateError):
        from_bytes(data)


def test_every_kind_of_value_comes_back():
    """Numbers that JSON lacks, arrays of all kinds and shapes, containers in containers."""
    value = {
        "a": [1, 2.5, -0.0, np.inf, True, None, "text", b"bytes", (1, (2, 3)), {3, 1, 2}, frozenset((frozenset((1, 2)),))],
        "b": {(0, "x"): np.arange(6).reshape(2, 3), 1: np.zeros((0, 4))},
        "c": np.array([np.nan, -np.inf]),
        "d": np.array(True),
        "$e": np.asfortranarray(np.arange(4.0).reshape(2, 2)),
    }
    again = from_bytes(to_bytes(value))
    assert to_bytes(again) == to_bytes(value)
    assert again["a"][:10] == value["a"][:10]
    assert str(again["a"][2]) == "-0.0"
    for name, part in ((1, again["b"][1]), ("c", again["c"]), ("$e", again["$e"])):
        np.testing.assert_array_equal(part, value["b"][1] if name == 1 else value[name])
    assert again["b"][0, "x"].dtype == np.int64
    with pytest.raises(StateError, match=r"state\.a: object is no number"):
        to_bytes({"a": object()})


def test_what_is_no_state():
    endless = []
    endless.append(endless)
    for value in (lambda: 1, iter(()), 10**5000, endless, np.array([None])):
        with pytest.raises(StateError):
            to_bytes({"a": value})


@pytest.mark.long
def test_contact_points_that_change():
    """The last points of a patch open one after the other: those of before have no part in a state."""
    simulator = ffsm_mj.Simulator("squeeze")
    simulator.reset()
    simulator.step(until=1.6)
    states = []
    while not simulator.ended:
        if simulator.step(until="event").events and not simulator.ended:
            states.append(simulator.get_state().to_bytes())
    whole = told(simulator.close())
    assert len(states) >= 3
    for state in states:
        assert is_rest_of(whole, rest("squeeze", {}, state))


def test_a_state_that_is_refused_changes_nothing(tap):
    """The run under way goes on from where it is, be the fault in the last part that is set."""
    given, whole, state = tap
    simulator = ffsm_mj.Simulator("tap", given, record=False)
    simulator.reset()
    simulator.step(until=0.1)
    for path in (("parts", "controller"), ("parts", "due"), ("parts", "watch")):
        with pytest.raises(StateError):
            simulator.set_state(changed(state, path, lambda _: {"nothing": 1}))
        assert simulator.time_s == pytest.approx(0.1)
    simulator.step(until=0.2)
    assert is_rest_of(whole, rest("tap", given, simulator.get_state().to_bytes()))
    logging = ffsm_mj.Simulator("tap", given)
    logging.reset()
    with pytest.raises(StateError):
        logging.set_state(changed(state, ("parts", "controller"), lambda _: {"nothing": 1}))
    with pytest.raises(SimulatorError, match="there is no run"):
        logging.step()


def test_states_of_a_log_whose_scenario_was_edited(tmp_path):
    """They are not used: the run is made again, and does not arrive at its logged state."""
    ffsm_mj.run("tap", {"duration_s": 0.6, "log.states": "events"}, out=tmp_path / "run", rerun=False)
    scenario = tmp_path / "run" / "scenario.yaml"
    text = scenario.read_text()
    assert "restitution: 0.4" in text
    scenario.write_text(text.replace("restitution: 0.4", "restitution: 0.3"))
    with pytest.raises(InputError, match="cannot be made again"):
        ffsm_mj.resume(tmp_path / "run", 0.4)


def test_a_log_with_states(tmp_path, capsys):
    """Going on from one needs nothing of the run before it; its rows are those of a run without states."""
    from ffsm_mj.cli.main import main

    given = {"duration_s": 0.6}
    plain = ffsm_mj.run("tap", given)
    whole = ffsm_mj.run("tap", given | {"log.states": "events"}, out=tmp_path / "run", rerun=False)
    assert np.array_equal(plain.log.rows[:], whole.log.rows[:], equal_nan=True)
    states = [from_bytes(each)["progress"]["time_s"] for each in stored_states(tmp_path / "run" / "run.mcap")]
    assert states == sorted({each.time_s for each in whole.log.events if hasattr(each, "step")}) or len(states) > 5
    capsys.readouterr()
    assert main(["analyze", str(tmp_path / "run")]) == 0
    out = capsys.readouterr().out
    assert "columns agree with states" in out
    assert "not read" not in out
    again = ffsm_mj.resume(tmp_path / "run", 0.4)
    assert np.array_equal(whole.log.rows[-len(again.log.rows) :], again.log.rows, equal_nan=True)


def test_states_of_a_log_are_used(tmp_path, monkeypatch):
    """The run before is not made again from its beginning, unless no state fits."""
    from ffsm_mj.simulation.loop import Simulation

    whole = ffsm_mj.run("tap", {"duration_s": 0.6, "log.states": "events"}, out=tmp_path / "run", rerun=False)
    begun, original = [], Simulation.set_state

    def noted(self, state, start=None):
        begun.append(original(self, state, start) or self.progress.time_s)

    monkeypatch.setattr(Simulation, "set_state", noted)
    ffsm_mj.resume(tmp_path / "run", 0.4)
    assert begun[0] > 0.3
    assert len(begun) == 2

    def refused(self, state, start=None):
        if start is None:
            raise StateError("not this one")
        original(self, state, start)

    monkeypatch.setattr(Simulation, "set_state", refused)
    again = ffsm_mj.resume(tmp_path / "run", 0.4)
    assert np.array_equal(whole.log.rows[-len(again.log.rows) :], again.log.rows, equal_nan=True)
    with pytest.raises(InputError, match=r"log\.states"):
        prepare("tap", {"log.states": "all"})


def test_a_body_at_rest_on_pieces(tmp_path):
    """On a face that is not convex, over a seam. Whole states agree: rows show a normal that differs in one bit later."""
    corner = geoms([((-1.0, -0.5, -0.1), (0.0, 0.5, 0.0)), ((0.0, -0.5, -0.1), (1.0, 0.0, 0.0))])
    turned = [np.cos(0.2), 0, 0, np.sin(0.2)]
    path = on(tmp_path, CUBE, fixed(corner), joints=[-0.1, -0.1, 0.1, *turned], mu=0.2, duration_s=0.1)
    whole, part = (ffsm_mj.Simulator(path, record=False) for _ in range(2))
    whole.reset()
    whole.step(until=0.05)
    part.set_state(SimulatorState.from_bytes(whole.get_state().to_bytes()))
    for _ in range(3):
        whole.step()
        part.step()
        assert part.get_state().to_bytes() == whole.get_state().to_bytes()


def test_states_share_nothing_with_the_simulation(tap):
    """A state stays what it was while its simulator goes on, and serves several times."""
    given, whole, _ = tap
    simulator = ffsm_mj.Simulator("tap", given, record=False)
    simulator.reset()
    simulator.step(until=0.1)
    state = simulator.get_state()
    before = state.to_bytes()
    simulator.step(until=0.3)
    simulator.set_state(state)
    simulator.step(until=0.2)
    assert state.to_bytes() == before
    assert is_rest_of(whole, rest("tap", given, before))
    assert replace(state).to_bytes() == before
