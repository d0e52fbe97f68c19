"""An estimator that is saved and restored goes on bit for bit, and every field of its state is needed for that."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from ffsm_controllers.estimators import estimators
from ffsm_mj.controller_protocol import ControllerContext, StateError
from tests.controllers.restored import declared, entry, fields_of, through_bytes, with_entry
from tests.sensing.filter_drive import PERIOD_S, Drive, filter_of, satellites, sensors_in
from tests.sensing.grasp_drive import CaughtDrive, arm_and_target, grasp_filter, sensors_of_arm

TICKS, CAUGHT, LET_GO = 40, 12, 28
SAVED = (3, 13, 17, 29, 33)
"""Ticks at which a state is saved: soon after the beginning, the closing and the opening of the grasp, and between."""


@dataclass
class Recorder:
    """An estimator with all that it was given, what it said, and its states at some calls.

    Attributes:
        made: The estimator.
        calls: Arguments of each call, with copies of the data before it.
        told: What it said after each call.
        states: States at some calls, by the number of the next one.
    """

    made: Any
    calls: list[Any] = field(default_factory=list)
    told: list[str] = field(default_factory=list)
    states: dict[int, Any] = field(default_factory=dict)

    def start(self, data):
        self.made.start(data)
        self.calls.clear()

    def update(self, time_s, measured, events, data):
        if len(self.calls) in SAVED:
            self.states[len(self.calls)] = through_bytes(self.made)
        before = data.qpos.copy(), data.qvel.copy(), data.ctrl.copy(), data.time
        self.calls.append((time_s, dict(measured), list(events), before))
        self.made.update(time_s, measured, events, data)
        self.told.append(said(self.made, data))

    def covariance(self, body):
        return self.made.covariance(body)


def said(made, data):
    return repr((data.qpos.tolist(), data.qvel.tolist(), np.asarray(made.telemetry(), dtype=float).tolist()))


def again(made, model, recorder, saved, state):
    """What an estimator says that begins at another time and is restored by a state."""
    data = mujoco.MjData(model)
    time_s, _, _, before = recorder.calls[saved]
    data.qpos[:], data.qvel[:], data.ctrl[:], data.time = before
    made.start(data)
    made.set_state(state)
    found = []
    for time_s, measured, events, before in recorder.calls[saved:]:
        data.qpos[:], data.qvel[:], data.ctrl[:], data.time = before
        made.update(time_s, measured, events, data)
        found.append(said(made, data))
    return found


def direct_of(system, sensors):
    built = estimators().classes["direct"]
    return built(built.Config(kind="direct"), ControllerContext(system, None, PERIOD_S, sensors=sensors))


def direct(folder):
    """Late samples, and rates from differences."""
    system = satellites(folder)
    sensors = sensors_in(system, delay_s=0.12)

    def make():
        return direct_of(system, sensors)

    recorder = Recorder(make())
    Drive(system, sensors, recorder, seed=1).run(TICKS)
    return system.mj, make, recorder


def mekf(folder):
    """Late samples and biases of gyros, of two bodies, one of which is hit, and set by others meanwhile."""
    system = satellites(folder)
    sensors = sensors_in(system, delay_s=0.12)

    def make():
        return filter_of(system, sensors, gyro_bias_rad_s=0.01, gate=0.999)

    recorder = Recorder(make())
    drive = Drive(system, sensors, recorder, seed=1)

    def set_by_others(time_s):
        if round(time_s / PERIOD_S) in (10, 16):
            drive.estimate.qpos[7:10] += 0.01

    hits = [SimpleNamespace(time_s=time_s, energy_before_J={}, geoms=("b/b",)) for time_s in (0.62, 1.61)]
    drive.run(TICKS, set_by_others, hits)
    return system.mj, make, recorder


def grasps(folder):
    """Late samples around the closing and the opening of a grasp; rates of joints from differences."""
    free, held = arm_and_target(folder)
    sensors = {name: each for name, each in sensors_of_arm(free, delay_s=0.12).items() if "/v" not in name}

    def make():
        return grasp_filter(free, sensors, {"grasp": held})

    recorder = Recorder(make())
    CaughtDrive(free, held, sensors, recorder, seed=1).through(CAUGHT, LET_GO, TICKS)
    return free.mj, make, recorder


CASES = {"direct": direct, "mekf": mekf, "grasps": grasps}


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    return {name: case(tmp_path_factory.mktemp(name)) for name, case in CASES.items()}


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize("saved", SAVED)
@pytest.mark.parametrize("name", CASES)
def test_goes_on_bit_for_bit(name, saved, cases):
    """An estimator made anew, and the first one, taken back from the end."""
    model, make, recorder = cases[name]
    assert again(make(), model, recorder, saved, recorder.states[saved]) == recorder.told[saved:]
    assert again(recorder.made, model, recorder, saved, recorder.states[saved]) == recorder.told[saved:]


def test_all_that_a_filter_does_is_in_some_state(cases):
    """So that what is under way of each kind is restored in the test above."""
    states = [state for name in ("mekf", "grasps") for state in cases[name][2].states.values()]
    kinds = {entry[2] for state in states for entry in state["history"]["entries"]}
    assert kinds == {"joint", "frame", "given", "grasp", "release", "impact"}


@pytest.mark.long
def test_every_field_of_every_state_is_needed(cases):
    noticed = set()
    for model, make, recorder in cases.values():
        for saved, state in recorder.states.items():
            made = make()
            data = mujoco.MjData(model)
            data.qpos[:], data.qvel[:], data.ctrl[:], data.time = recorder.calls[saved][3]
            made.start(data)
            fresh = through_bytes(made)
            for path, owners in list(fields_of(made, state)):
                changed = with_entry(state, path, entry(fresh, path))
                before = changed_telemetry(made, model, recorder, saved, changed)
                if before or again(made, model, recorder, saved, changed) != recorder.told[saved:]:
                    noticed |= owners
    assert declared("ffsm_controllers.estimators") - noticed == set()


def changed_telemetry(made, model, recorder, saved, state):
    """Whether the telemetry between two calls is another one with a state."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:], data.time = recorder.calls[saved][3]
    made.start(data)
    made.set_state(state)
    told = np.asarray(made.telemetry(), dtype=float)
    made.set_state(recorder.states[saved])
    return not np.array_equal(told, made.telemetry(), equal_nan=True)


def test_a_state_that_does_not_fit_is_an_error(cases):
    _, make, recorder = cases["mekf"]
    state = recorder.states[SAVED[0]]
    for path, value in ((("history", "knots", 0), (0.0, 1.0)), (("history", "entries", 0), (0.0,)), (("history",), {})):
        with pytest.raises(StateError, match="state of History"):
            make().set_state(with_entry(state, path, value))
