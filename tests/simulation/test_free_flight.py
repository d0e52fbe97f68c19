"""Control ticks of free flight are those of the loop, bit by bit: the same rows, events and counts without them."""

from __future__ import annotations

import numpy as np
import pytest

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.log.recorder import Recorder
from ffsm_mj.scenario.shipped import scenario_names
from ffsm_mj.simulation.steps import FreeFlight
from tests.contact_models.persistent.test_steady import held
from tests.mechanisms.models import four_bar, mechanism, parallelogram

OSDRE = {"kind": "osdre", "joints": ["joint_1", "joint_2", "joint_3"], "Q": [1.0, 1.0, 0.5, 0.5], "R": [1.0, 1.0, 1.0]}
UNTIL_CONTACT = {
    "duration_s": 8.2,
    "contacts.rules": [{"between": ["gripper", "box"], "restitution": 0.0}],
    "phases": [
        {"name": "approach", "until": "contact_begins", "controller": OSDRE},
        {"name": "after", "until": "end", "controller": {"kind": "off"}},
    ],
}
RUNS = {
    "an impact, a pause and another law": ("baseline", {"duration_s": 8.4, "phases.1.for_s": 0.2}),
    "five steps a tick": ("baseline", {"time_step_s": 0.0002, "duration_s": 1.734}),
    "late ticks": ("baseline", {"actuation.control_jitter_s": 0.0004, "duration_s": 0.5}),
    "late commands": ("baseline", {"actuators.motor_1.delay_s": 0.0013, "duration_s": 0.5}),
    "another model for the law": ("baseline", {"controller_model.robot.base.mass_kg": 50.0, "duration_s": 1.0}),
    "another model for the law that carries": (
        "capture-planar",
        {"duration_s": 8.4, "phases.1.for_s": 0.2, "controller_model.robot.base.mass_kg": 50.0},
    ),
    "a phase that ends at an event between ticks": ("push", UNTIL_CONTACT),
    "chosen sub-steps": ("baseline", {"accuracy": 1e-9, "duration_s": 0.5}),
    "damping that the output does not feel, allocation": ("spatial", {"duration_s": 4.0}),
    "valves": ("free-flying-hardware", {"duration_s": 2.0}),
    "an estimator and sensors": ("capture-camera", {"duration_s": 2.0}),
    "a grasp of an object": ("capture-planar", {"duration_s": 8.4, "phases.1.for_s": 0.2}),
    "springs": ("capture-flexible", {"duration_s": 1.0}),
    "contact that lasts": ("push", {"duration_s": 1.5}),
    "contact on several points": ("squeeze", {}),
    "a box that rests": ("resting", {}),
    "a box that slides": ("probe-and-cone", {}),
}


def told(prepared, taken):
    """Everything that a run says but wall times."""
    run = prepared.run()
    told = run.summary()
    events = {kind: records for kind, records in run.log.records.items() if kind != "outcomes"}
    counts = {key: value for key, value in told.items() if not key.startswith(("wall", "law_wall", "real_time"))}
    return np.array(run.log.rows), events, counts, len(taken)


@pytest.fixture
def both(monkeypatch):
    """A function that makes a run with and without free flight."""
    take, taken = FreeFlight.take, []

    def noted(self, *parts):
        ticks, law_s = take(self, *parts)
        taken.extend(range(ticks))
        return ticks, law_s

    def run(name, overrides):
        prepared = prepare(name, overrides)
        runs = []
        for method in (noted, lambda *_: (0, 0.0)):
            taken.clear()
            monkeypatch.setattr(FreeFlight, "take", method)
            runs.append(told(prepared, taken))
        return runs

    return run


def assert_same(runs):
    (rows, events, counts, taken), (other_rows, other_events, other_counts, none) = runs
    np.testing.assert_array_equal(rows, other_rows)
    assert events == other_events
    assert counts == other_counts
    assert none == 0
    return taken


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("case", RUNS)
def test_a_run_is_the_same_without_free_flight(both, case):
    ticks = assert_same(both(*RUNS[case]))
    assert (ticks > 0) == (case not in ("late ticks", "late commands", "chosen sub-steps"))


def test_an_event_that_cannot_be_written_leaves_the_rows_written_once(monkeypatch):
    """A sink fails at a phase that begins in free flight: the rows before it are not passed on again."""
    passed, event, pass_on = [], Recorder.event, Recorder.pass_on

    def failing(self, *records):
        if any(getattr(record, "name", "") == "second" for record in records):
            self.pass_on()
            raise OSError("no space left")
        event(self, *records)

    def counted(self):
        passed.append(self.line)
        pass_on(self)

    monkeypatch.setattr(Recorder, "event", failing)
    monkeypatch.setattr(Recorder, "pass_on", counted)
    off = {"kind": "off"}
    phases = [{"name": "first", "for_s": 0.5, "controller": off}, {"name": "second", "until": "end", "controller": off}]
    run = prepare("baseline", {"duration_s": 1.0, "phases": phases}).run()
    assert run.outcome == "internal_error"
    assert sum(passed) == len(run.log.rows) == 500
    assert len(run.log.records["internal_errors"]) == 1


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize(("pad", "slip"), [("plates", 0.05), ("balls", 0.05), ("plates", 2e-4)])
def test_sliding_is_the_same_without_free_flight(both, tmp_path, pad, slip):
    """Bit by bit, too: the clock of the log decides which of them takes a tick. A slow slip stops within the run."""
    path = held(tmp_path, pad=pad, mu=0.1, squeeze=1.0, slip=slip)
    (rows, events, _, taken), (other_rows, other_events, _, none) = both(str(path), {})
    np.testing.assert_array_equal(rows, other_rows)
    assert events == other_events
    assert (taken > 30, none) == (True, 0)


@pytest.mark.parametrize(
    ("mjcf", "joints", "rates", "outcome"),
    [
        (four_bar(), {"crank": 1.0}, {"crank": 2.0}, "completed"),
        # Near the change point other combinations of the rows are chosen, by the loop too.
        (parallelogram(3), {"bar0": 0.79}, {"bar0": -4.5}, "singular_mechanism"),
    ],
)
def test_mechanisms_move_the_same_without_free_flight(both, tmp_path, mjcf, joints, rates, outcome):
    """Rows drift, and are projected by the loop: the core goes on after it."""
    path = mechanism(tmp_path, mjcf, joints, rates, duration_s=1.0, time_step_s=4e-3, control_period_s=4e-3)
    runs = both(str(path), {})
    assert runs[0][2]["outcome"] == outcome
    assert assert_same(runs) > 10


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("name", sorted(scenario_names(), key=lambda name: name != "squeeze"))
def test_every_scenario_is_the_same_without_free_flight(both, name):
    assert_same(both(name, {"duration_s": 30.0} if name == "capture-orbit" else {}))  # of 600 s
