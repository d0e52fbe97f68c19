"""The phase machine: when phases begin and end, who is in charge, what is reported."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest

import ffsm_mj
from ffsm_controllers.endings import Ending, EventTrigger, TimeTrigger
from ffsm_controllers.phases import Phase, PhaseMachine
from ffsm_controllers.stop_condition import StopCondition
from ffsm_mj import Simulator
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.cli.main import main
from ffsm_mj.controller_protocol import Command, Observation
from ffsm_mj.errors import InputError
from ffsm_mj.records.signals import Signal
from ffsm_mj.report.page.phase_graph import phase_graph
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


OFF = {"kind": "off"}


class Caught:
    pass


def test_of_several_triggers_at_one_instant_the_first_one_listed_counts():
    """And a phase that is entered again starts its law and its time anew."""
    laws = [Recorder(), Recorder(), Recorder()]
    first = (
        Ending("impact", EventTrigger(Hit), 2),
        Ending("grasp", EventTrigger(Caught), 1),
        Ending("time", TimeTrigger(0.3)),
    )
    machine = PhaseMachine(
        [
            Phase("a", "x", laws[0], first),
            Phase("b", "y", laws[1], (Ending("time", TimeTrigger(0.2), 0),)),
            Phase("c", "z", laws[2], (Ending("time", TimeTrigger(0.1), 0),)),
        ]
    )
    calls = {0.1: (Caught(), Hit()), 0.3: (Caught(),)}
    for tick in range(10):
        machine.control(Observation(tick / 10, None, calls.get(tick / 10, ())), Command.off(0))
    begun = [(p.name, p.start_s, p.reason) for p in machine.drain_phases()]
    assert begun == [
        ("a", 0.0, "start"),
        ("c", 0.1, "impact"),
        ("a", 0.2, "time"),
        ("b", 0.3, "grasp"),
        ("a", 0.5, "time"),
        ("b", 0.8, "time"),
    ]
    assert laws[0].started == [0.0, 0.2, 0.5]
    assert set(machine.reports()) == {"a", "b", "c"}


def bouncing(folder, phases, **changes):
    """A ball that meets another one at 0.3 s."""
    return two_balls(folder, gap=0.3, speed=1.0, duration_s=1.0, phases=phases, **changes)


APPROACH = {"name": "approach", "for_s": 0.5, "on": {"impact": "pause", "time": "retreat"}, "controller": OFF}
PAUSE = {"name": "pause", "for_s": 0.1, "on": {"time": "approach"}, "controller": OFF}
RETREAT = {"name": "retreat", "until": "end", "controller": OFF}


def test_an_impact_leads_one_way_and_time_another(tmp_path, capsys):
    """The ball hits, pauses, is back in the approach, which now runs out of time; the report of the run names it once."""
    path = bouncing(tmp_path, [APPROACH, PAUSE, RETREAT])
    out = tmp_path / "run"
    assert main(["run", str(path), "--out", str(out), "--no-rerun"]) == 0
    run = ffsm_mj.load_run(out)
    found = [(phase.name, round(phase.start_s, 9), phase.reason) for phase in run.phases]
    assert found == [
        ("approach", 0.0, "start"),
        ("pause", 0.3, "impact"),
        ("approach", 0.4, "time"),
        ("retreat", 0.9, "time"),
    ]
    assert [each["name"] for each in run.summary()["phases"]] == ["approach", "pause", "approach", "retreat"]
    assert run["phase.index"][450] == 0.0
    assert main(["analyze", str(out)]) == 0
    again = ffsm_mj.run(out)
    assert np.array_equal(again.log.rows, run.log.rows, equal_nan=True)
    capsys.readouterr()


def test_a_state_in_a_phase_that_was_entered_again_goes_on(tmp_path):
    """Restored within the second approach, whose time goes on from its second start."""
    path = bouncing(tmp_path, [APPROACH, PAUSE, RETREAT])
    simulator = Simulator(path)
    simulator.reset()
    simulator.step(until=0.6)
    state = simulator.get_state()
    again = Simulator(path)
    again.set_state(state)
    again.step(until=1.0)
    assert [(phase.name, round(phase.start_s, 9)) for phase in again.close().phases] == [("approach", 0.4), ("retreat", 0.9)]


def test_without_the_impact_time_leads_on(tmp_path):
    """The other branch of the same scenario; a phase that the run did not need is no fault."""
    run = ffsm_mj.run(two_balls(tmp_path, gap=3.0, speed=1.0, duration_s=1.0, phases=[APPROACH, PAUSE, RETREAT]))
    assert [(phase.name, phase.start_s) for phase in run.phases] == [("approach", 0.0), ("retreat", pytest.approx(0.5))]


def test_check_and_page_draw_the_graph(tmp_path, capsys):
    path = bouncing(tmp_path, [APPROACH, PAUSE, RETREAT])
    assert main(["check", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    start = lines.index("  phases:")
    assert [line.strip() for line in lines[start + 1 : start + 8]] == [
        "approach (off)",
        "├─ impact → pause",
        "└─ time 0.5 s → retreat",
        "pause (off)",
        "└─ time 0.1 s → approach (again)",
        "retreat (off)",
        "└─ end of the run",
    ]
    drawn = phase_graph(ffsm_mj.run(path))
    assert drawn.count("<rect") == 3
    assert drawn.count("marker-end") == 3
    assert "approach (2 times)" in drawn
    assert phase_graph(ffsm_mj.run(bouncing(tmp_path, [{**RETREAT, "name": "all"}]))) == ""


def test_a_phase_stops_when_the_base_is_slow_for_a_time(tmp_path):
    """A ball of mass m damped by d falls below a tenth of its speed at ln(10) m/d; the phase ends 0.1 s after."""
    law = {"kind": "pd", "joints": ["robot/x"], "kp": 0.0, "kd": 4.0}
    phases = [
        {"name": "brake", "stop_when": "base_speed < 0.1 m/s for 0.1 s", "controller": law},
        {"name": "after", "until": "end", "controller": OFF},
    ]
    path = two_balls(
        tmp_path,
        duration_s=1.5,
        contacts={"rules": []},
        initial={"joints": {"target/x": 9.0}, "rates": {"robot/x": 1.0}},
        phases=phases,
    )
    run = ffsm_mj.run(path)
    mass = float(prepare(path).system.mj.body("robot/ball").mass[0])
    speed = np.abs(run["state.v_robot_x_m_s"])
    first = run.time[np.argmax(speed < 0.1)]
    assert first == pytest.approx(np.log(10.0) * mass / 4.0, abs=0.003)
    assert run.phases[1].start_s == pytest.approx(first + 0.1, abs=1e-9)
    assert run.phases[1].reason == "stop_when"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("base_rate < 1e-3 rad/s for 2 s", ""),
        ("tip_error > 0.5 m", ""),
        ("base_rate < 1e-3", "is no condition; write QUANTITY < NUMBER UNIT"),
        ("base_rat < 1e-3 rad/s", "unknown quantity 'base_rat'"),
        ("base_rate < 1e-3 deg/s", "base_rate is in rad/s, not in 'deg/s'"),
        ("base_rate < fast rad/s", "'fast' is no finite number"),
        ("base_rate < 1 rad/s for -2 s", "is negative"),
    ],
)
def test_conditions_are_sentences(text, message):
    if message:
        with pytest.raises(ValueError, match=message):
            StopCondition.parse(text)
    else:
        assert StopCondition.parse(text).for_s == (2.0 if "for" in text else 0.0)


STOP = {"name": "a", "stop_when": "base_rate < 0.1 rad/s", "on": {"stop_when": "b"}, "controller": OFF}
BACK = {"name": "b", "stop_when": "base_speed < 0.1 m/s", "on": {"stop_when": "a"}, "controller": OFF}


@pytest.mark.parametrize(
    ("phases", "message"),
    [
        ([{**APPROACH, "on": {"impact": "pase"}}, PAUSE], r"phases.0.on.impact: unknown phase 'pase' .did you mean 'pause'"),
        ([{**APPROACH, "on": {"impct": "pause"}}, PAUSE], r"phases.0.on.impct: unknown end of a phase 'impct'"),
        ([{**APPROACH, "for_s": None}, PAUSE, RETREAT], r"phases.0: 'on: time' needs 'for_s'"),
        ([{**APPROACH, "until": "impact"}, PAUSE, RETREAT], r"'impact' is in 'until' and in 'on'"),
        ([{**APPROACH, "on": {"impact": "retreat", "time": "retreat"}}, PAUSE, RETREAT], r"phases.1.name: no phase that is"),
        (
            [{**APPROACH, "on": {"gyro": {"above": 1.0, "phase": "pause"}}}, PAUSE],
            r"phases.0.on.gyro: unknown sensor 'gyro'",
        ),
        ([STOP, BACK], r"phases.0.on.stop_when: a -> b -> a is a loop of no time"),
        ([{**STOP, "stop_when": "tip_error < 1 m"}, BACK], r"phases.0.stop_when: tip_error needs a 'task'"),
    ],
)
def test_wrong_graphs_are_refused_with_their_place(tmp_path, phases, message):
    if "tip_error" in message:
        phases = [{**phases[0], "on": {"stop_when": "b"}}, {**BACK, "stop_when": "base_speed < 0.1 m/s for 1 s"}]
    with pytest.raises(InputError, match=message):
        ffsm_mj.run(bouncing(tmp_path, phases))


def test_loops_that_take_time_or_exclude_each_other_are_none(tmp_path):
    """One that lasts, and two bounds on one quantity that cannot both hold: hysteresis."""
    for back in ("base_speed < 0.1 m/s for 0.2 s", "base_rate > 0.2 rad/s"):
        prepare(bouncing(tmp_path, [STOP, {**BACK, "stop_when": back}]))
