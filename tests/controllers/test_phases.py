"""The phase machine: when phases begin and end, who is in charge, what is reported."""

from __future__ import annotations

from dataclasses import FrozenInstanceError
from typing import ClassVar

import numpy as np
import pytest

import ffsm_mj
from ffsm_controllers.endings import Ending, EventTrigger, TimeTrigger
from ffsm_controllers.phases import Phase, PhaseMachine
from ffsm_mj.controller_protocol import Command, Observation
from ffsm_mj.errors import InputError
from ffsm_mj.records.signals import Signal
from tests.scenes import ball, scene, two_balls


class Recorder:
    """Remembers its calls and reports one number."""

    telemetry_signals: ClassVar = (Signal("controller", "count", "", "calls"),)

    def __init__(self):
        self.started, self.times = [], []

    def start(self, observation):
        self.started.append(observation.time_s)

    def control(self, observation, command):
        self.times.append(observation.time_s)

    def telemetry(self):
        return (float(len(self.times)),)


class Silent(Recorder):
    telemetry_signals: ClassVar = ()

    def telemetry(self):
        return ()


class Hit:
    pass


def test_a_timed_phase_ends_at_the_first_tick_at_or_after_its_time():
    first, second, third = Recorder(), Silent(), Recorder()
    machine = PhaseMachine(
        [
            Phase("a", "x", first, (Ending("impact", EventTrigger(Hit)),)),
            Phase("b", "y", second, (Ending("time", TimeTrigger(0.25)),)),
            Phase("c", "z", third),
        ]
    )
    hit = Hit()
    calls = [(0.0, ()), (0.1, ()), (0.137, (hit,)), (0.2, ()), (0.3, ()), (0.35, (hit,)), (0.4, ()), (0.5, ())]
    for time, impacts in calls:
        machine.control(Observation(time, None, impacts), Command.off(0))
    assert first.times == [0.0, 0.1]
    # Not at 0.387 (no tick), not at the impact of 0.35: the next tick is 0.4.
    assert second.times == [0.137, 0.2, 0.3, 0.35]
    assert third.times == [0.4, 0.5]
    begun = machine.drain_phases()
    assert [(p.name, p.start_s, p.reason) for p in begun] == [
        ("a", 0.0, "start"),
        ("b", 0.137, "impact"),
        ("c", 0.4, "time"),
    ]
    assert machine.drain_phases() == []


@pytest.mark.parametrize(
    ("for_s", "start_s", "reason"),
    [
        (0.2501, 0.251, "time"),  # the first tick at or after it; the touch is at 0.3 s
        (0.4, 0.3, "impact"),
        (30.0, 0.3, "impact"),
    ],
)
def test_the_first_of_impact_and_time_ends_a_phase_and_the_next_one_says_which(tmp_path, for_s, start_s, reason):
    path = two_balls(
        tmp_path,
        gap=0.3,
        speed=1.0,
        phases=[
            {"name": "approach", "until": "impact", "for_s": for_s, "controller": {"kind": "off"}},
            {"name": "after", "until": "end", "controller": {"kind": "off"}},
        ],
    )
    phase = ffsm_mj.run(path).phases[1]
    assert (phase.name, phase.reason) == ("after", reason)
    assert phase.start_s == pytest.approx(start_s, abs=1e-9)


def spring(folder, kd, for_s=None, **scenario):
    """A ball of 2 kg on a spring of 8 N/m, 1 m from where it belongs, and what says that it is there."""
    settled = {"error_m": 0.05, "speed_m_s": 0.2, "for_s": 0.5}
    spring = {"kind": "pd", "joints": ["robot/x"], "kp": 8.0, "kd": kd, "target": [0.0]}
    ends = {"until": "settled", "settled": settled} | ({"for_s": for_s} if for_s else {})
    return scene(
        folder,
        ball("ball", mass=2.0, joints="xy"),
        {},
        **{
            "duration_s": 15.0,
            "control_period_s": 0.01,
            "time_step_s": 0.01,
            "initial": {"joints": {"x": 1.0}},
            "task": {"tip": "centre", "axes": ["x", "y"], "target_m": [0.0, 0.0]},
            "phases": [
                {"name": "go", **ends, "controller": spring},
                {"name": "rest", "until": "end", "controller": {"kind": "off"}},
            ],
            **scenario,
        },
    )


@pytest.mark.parametrize("kd", [8.0, 1.6])
def test_a_phase_ends_once_the_tip_has_been_near_and_slow_for_its_time(tmp_path, kd):
    """At the first tick that has nothing but such ticks in the half second before it; with 1.6 N s/m it swings."""
    run = ffsm_mj.run(spring(tmp_path, kd))
    within = (run.tip_error() <= 0.05) & (np.linalg.norm(run.tip_velocity[:, :2], axis=1) <= 0.2)
    if kd < 8.0:
        assert np.count_nonzero(np.diff(within.astype(int)) == 1) > 1  # it is there and leaves again
    done = next(i for i in range(50, len(within)) if within[i - 50 : i + 1].all())
    phase = run.phases[1]
    assert (phase.name, phase.reason) == ("rest", "settled")
    assert phase.start_s == pytest.approx(run.time[done], abs=1e-9)


def test_the_time_of_a_phase_that_does_not_settle_is_up(tmp_path):
    phase = ffsm_mj.run(spring(tmp_path, 0.0, for_s=3.0)).phases[1]
    assert (phase.start_s, phase.reason) == (pytest.approx(3.0), "time")


def test_a_phase_settles_only_where_there_is_a_task(tmp_path):
    with pytest.raises(InputError, match=r"phases\.0\.until: nothing settles: the scenario has no task"):
        ffsm_mj.run(spring(tmp_path, 8.0, task=None))


def test_telemetry_of_other_phases_is_nan():
    machine = PhaseMachine([Phase("a", "x", Recorder(), (Ending("time", TimeTrigger(1.0)),)), Phase("b", "y", Silent())])
    machine.control(Observation(0.0, None), Command.off(0))
    np.testing.assert_array_equal(machine.telemetry, [1.0])
    machine.control(Observation(1.0, None), Command.off(0))
    np.testing.assert_array_equal(machine.telemetry, [np.nan])


def test_pd_closed_form(tmp_path):
    """A 2 kg ball on kp, kd: critically damped, x(t) = (1 + w t) e^(-w t) from rest; sampled at 1 ms, error O(period)."""
    w = 2.0
    path = two_balls(
        tmp_path,
        contacts={"rules": []},
        initial={"joints": {"robot/x": 1.0, "target/x": 9.0}},
        phases=[
            {
                "name": "p",
                "until": "end",
                "controller": {"kind": "pd", "joints": ["robot/x"], "kp": 2 * w * w, "kd": 4 * w, "target": [0.0]},
            }
        ],
    )
    errors = []
    for period in (0.004, 0.002):
        run = ffsm_mj.run(path, {"control_period_s": period})
        errors.append(np.abs(run["state.q_robot_x_m"] - (1 + w * run.time) * np.exp(-w * run.time)).max())
    assert errors[0] < 0.01
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.05)  # a held command lags by half a period: first order


def test_hold_keeps_the_configuration_at_the_start_of_the_phase(tmp_path):
    path = two_balls(
        tmp_path,
        phases=[
            {"name": "coast", "until": "impact", "controller": {"kind": "off"}},
            {"name": "hold", "until": "end", "controller": {"kind": "pd", "joints": ["robot/x"], "kp": 800.0, "kd": 160.0}},
        ],
    )
    run = ffsm_mj.run(path)
    assert run["state.q_robot_x_m"][-1] == pytest.approx(0.3, abs=1e-4)


def test_a_command_is_written_into_not_replaced():
    """Its arrays are bound to the plant: another one would be ignored."""
    with pytest.raises(FrozenInstanceError):
        Command.off(2).effort = np.ones(2)
