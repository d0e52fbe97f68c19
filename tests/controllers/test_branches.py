"""Phases that branch: triggers, their order, phases entered again, graphs that are refused."""

from __future__ import annotations

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
from ffsm_mj.report.page.phase_graph import phase_graph
from tests.controllers.test_phases import Recorder
from tests.scenes import two_balls

OFF = {"kind": "off"}


class Hit:
    pass


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
