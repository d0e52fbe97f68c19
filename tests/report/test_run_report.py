"""The report of a run fits a terminal of 24 lines and 80 columns, with what fails first."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.experiments.metrics import metric_values
from ffsm_mj.replay import replay_log
from ffsm_mj.report import momentum_report, terminal
from ffsm_mj.report.check_report import step_hint
from ffsm_mj.report.impact_velocities import velocity_table
from ffsm_mj.report.record_tables import impact_table
from ffsm_mj.report.run_report import MOST_LINES, run_report
from ffsm_mj.report.verification_report import check_table, verification
from ffsm_mj.verification.checks import DEFAULT_TOLERANCE
from ffsm_mj.verification.truncation import ExplainedChecks
from tests.changed_logs import with_records
from tests.contact_models.grasp.scenes import grasping
from tests.contact_models.joint_friction.scenes import run as friction_run
from tests.contact_models.joint_friction.scenes import slider
from tests.contact_models.persistent.test_limits import gripper as pressed_jaws
from tests.scenes import ball, scene, two_balls


@pytest.fixture(scope="module")
def hit(tmp_path_factory):
    return ffsm_mj.run(two_balls(tmp_path_factory.mktemp("hit"), duration_s=0.5))


@pytest.fixture(autouse=True)
def _narrow(monkeypatch):
    monkeypatch.setattr(terminal, "terminal_width", lambda: 80)


def changed(run, **records):
    return ffsm_mj.Run(with_records(run.log, records))


def reported(run, notes, lines=MOST_LINES):
    return terminal.wrapped(run_report(run, ExplainedChecks(all_checks(run)), notes, lines))


def bounces(run, pair, times):
    return tuple(replace(run.impacts[0], event=i, pair=pair, rule=pair, time_s=time) for i, time in enumerate(times))


def test_a_run_that_passes_is_a_few_lines(hit):
    lines = reported(hit, ["a note"]).splitlines()
    assert lines[-1].startswith("all 15 checks pass; worst: ") or lines[-2].startswith("all 15 checks pass; worst: ")
    assert len(lines) <= 9
    assert not any("note" in line for line in lines)  # it was shown before the run


def test_run_analyze_and_a_representation_count_checks_alike_or_say_what_is_more(hit, tmp_path):
    """Forces of persistent contact and joint limits are checked by a replay only; a representation compiles no models."""
    for run, forces in ((hit, False), (pressed_jaws(tmp_path, 1.5), True)):
        again = replay_log(run.log)
        analyzed = verification(run, again, ExplainedChecks(again.checks()), DEFAULT_TOLERANCE)
        said, count = run_report(run, ExplainedChecks(all_checks(run))), len(all_checks(run))
        assert f"all {count} checks pass; worst: " in said
        assert said.endswith("; one more by replay (ffsm analyze): contact complementarity") == forces
        assert f"all {count + forces} checks pass over" in analyzed
        assert f"all {len(run.checks())} checks of rows and records pass; worst: " in repr(run)


def test_velocities_of_bodies_before_and_after_an_impact(hit, tmp_path):
    """v+ of an elastic impact of 2 kg at 1 m/s on 3 kg at rest: -1/5 and 4/5 m/s; of a series the first and the largest."""
    lines = velocity_table(hit).splitlines()[2:]
    assert [line.split() for line in lines] == [
        ["1", "robot/ball", "before", "1.000000", *["0.000000"] * 5],
        ["after", "-0.200000", *["0.000000"] * 5],
        ["1", "target/target", "before", *["0.000000"] * 6],
        ["after", "0.800000", *["0.000000"] * 5],
    ]
    (record,) = hit.impacts
    series = [replace(record, event=i, impulse_N_s=2.0 if i == 7 else 1.0) for i in range(30)]
    shown = velocity_table(changed(hit, impacts=tuple(series))).splitlines()[2:]
    assert [line.split()[0] for line in shown if "before" in line] == ["1", "1", "8", "8"]
    still = scene(tmp_path, ball("ball", mass=1.0, joints="x"), {}, duration_s=0.01)
    assert velocity_table(ffsm_mj.run(still)) == ""  # no impact
    for wrong in ({"qpos": record.qpos[:1]}, {"qvel_before": {}}, {"geoms": ("none", "target/target")}):
        assert velocity_table(changed(hit, impacts=(replace(record, **wrong),))) == ""


def test_checks_that_fail_come_first_and_notes_below_them(hit):
    (record,) = hit.impacts
    run = changed(hit, impacts=(replace(record, energy_change_J=record.energy_change_J + 1e-3),))
    lines = reported(run, ["the base has no mass"]).splitlines()
    failed = next(i for i, line in enumerate(lines) if line.endswith("FAILED"))
    assert "impact energy" in lines[failed]
    assert lines[failed + 1] == "  note: the base has no mass"
    assert failed < next(i for i, line in enumerate(lines) if "approach" in line)
    table = check_table(all_checks(run)).splitlines()
    assert table[1].endswith("FAILED")
    assert all(line.endswith("passes") for line in table[2:])


def test_a_series_of_bounces_is_one_row(hit):
    """40 on one pair and 25 on another, interleaved: counted, with the times of the first and last."""
    records = sorted(
        [
            *bounces(hit, "ball-floor", [0.01 * i for i in range(40)]),
            *bounces(hit, "ball-wall", [0.4 - 0.01 * i for i in range(25)]),
        ],
        key=lambda record: record.time_s,
    )
    number, first, head, _, floor, wall = impact_table(records).splitlines()
    assert number == "40 impacts, with 65 contacts"
    assert first == "  first and largest: 0.000000 s  ball-floor, 2.4 N s at 1 m/s"
    assert head.split()[:4] == ["impacts", "rule", "from", "to"]
    assert floor.split()[:4] == ["40", "ball-floor", "0.000000", "0.390000"]
    assert wall.split()[:4] == ["25", "ball-wall", "0.160000", "0.400000"]
    total = sum(record.impulse_N_s for record in records if record.pair == "ball-wall")
    assert float(wall.split()[-1]) == pytest.approx(total, abs=1e-6)  # the last digit shown


def test_many_pairs_are_cut_until_the_report_fits(hit):
    """30 pairs with long names, 40 unhandled contacts and 9 notes."""
    names = [f"gripper/left/finger_pad_{i}-debris/panel_{i}_of_the_array" for i in range(30)]
    impacts = tuple(record for name in names for record in bounces(hit, name, [0.1, 0.2]))
    broken = tuple(replace(record, energy_change_J=1.0) for record in impacts)
    for records in (impacts, broken):
        report = reported(changed(hit, impacts=records), ["note " * 30] * 9)
        lines = report.splitlines()
        assert len(lines) <= MOST_LINES
        assert max(map(len, lines)) <= 80
        assert "more" in report


def test_the_table_of_checks_is_whole_at_80_columns(hit):
    """Every check has one row with its result at the end; the longest names there are."""
    checks = [
        replace(check, name="contact complementarity", subsystem="objects", component=f"impact {100 + i}", unit="N m s")
        for i, check in enumerate(all_checks(hit))
    ]
    lines = check_table(checks).splitlines()
    assert sum(line.endswith("passes") for line in lines) == len(checks)
    assert max(map(len, lines)) <= 80
    assert lines[-1] == "  left out on a narrow terminal: in"


def test_a_report_without_room_counts_its_records(hit):
    """Six lines: the outcome, the failing checks with the first note, and the largest impact in place of tables."""
    impacts = tuple(replace(record, energy_change_J=1.0) for record in bounces(hit, hit.impacts[0].rule, [0.1, 0.2]))
    lines = reported(changed(hit, impacts=impacts), ["first", "second"], 6).splitlines()
    assert len(lines) <= 6
    assert any(line.endswith("FAILED") for line in lines)
    assert "  note: first" in lines
    assert lines[-2] == "2 impacts"
    assert lines[-1].startswith("  first and largest: 0.100000 s  ")


def test_records_of_models_are_counted_before_tables_are_given_up(tmp_path):
    """A mast between two stops rattles while a ball bounces: at one row per part, limits are one line, impacts a table."""
    mast = """<mujoco><compiler angle="radian"/><option gravity="0 0 0"/><worldbody><body name="hub"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="5" diaginertia="1 1 1"/><geom name="hub" size="0.1" mass="0"/>
      <body name="mast"><joint name="mast" axis="0 0 1" range="-0.1 0.1"/>
        <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></body></worldbody></mujoco>"""
    rates = {"mast": 3.0, "target/free": [-1, 0, 0, 0, 0, 0]}
    path = scene(
        tmp_path,
        mast,
        {"target": ball("target")},
        initial={"joints": {"target/free": [0.3, 0, 0, 1, 0, 0, 0]}, "rates": rates},
        joint_limits={"mast": {"restitution": 0.9}},
        contacts={},
    )
    run = ffsm_mj.run(path)
    assert len(run.records["limit_impacts"]) > 5
    for room in (24, 12):
        report = reported(run, [], room)
        assert report.count("\n") < room
        assert "robot-target" in report
    assert f"{len(run.records['limit_impacts'])} limit impacts (listed by analyze)" in report


def test_the_heat_of_joint_friction_is_told(tmp_path):
    """A slider loses its relative energy, 10/7 kg at 1.2 m/s: 36/35 J."""
    made = friction_run(tmp_path, slider(3.0), 0.02, initial={"rates": {"s": 1.2}})
    told = "dry friction of joints and tendons: 1.029 J of heat"
    assert told in run_report(made, ExplainedChecks(all_checks(made)))
    assert "dry friction" not in run_report(ffsm_mj.run(two_balls(tmp_path)), ExplainedChecks(()))


@pytest.mark.parametrize("accuracy", [None, 1e-6, 1e-9])
def test_the_finest_accuracy_is_proposed_where_it_is_not_asked_for(tmp_path, accuracy):
    made = ffsm_mj.run(two_balls(tmp_path), {} if accuracy is None else {"accuracy": accuracy})
    assert ("accuracy: 1e-9" in step_hint(made)) == (accuracy != 1e-9)
    assert "time_step_s" in step_hint(made)


@pytest.fixture(scope="module")
def caught(tmp_path_factory):
    return ffsm_mj.run(grasping(tmp_path_factory.mktemp("caught")))


@pytest.mark.parametrize("contacts", [1, 2, 63, 400])
@pytest.mark.parametrize("room", [24, 19, 8, 1])
@pytest.mark.parametrize("width", [60, 80])
def test_first_and_largest_impact_captures_and_releases_are_always_shown(caught, monkeypatch, contacts, room, width):
    """With time and impulse, however many records there are and however little room; contacts share impacts at random."""
    monkeypatch.setattr(terminal, "terminal_width", lambda: width)
    rng = np.random.default_rng(contacts)
    (hit,), (capture,), (release,) = (caught.records[name] for name in ("impacts", "grasp_impulses", "releases"))
    events = np.sort(rng.integers(0, contacts, contacts))
    impulses = rng.permutation(np.arange(1.0, contacts + 1.0))
    impacts = tuple(
        replace(hit, event=int(event), time_s=0.001 * int(event), impulse_N_s=float(impulse))
        for event, impulse in zip(events, impulses, strict=True)
    )
    run = changed(caught, impacts=impacts)
    text = " ".join(reported(run, [], room).split())
    first = max(impulses[events == events[0]])
    for event, impulse in ((events[0], first), (events[np.argmax(impulses)], impulses.max())):
        assert f"{0.001 * int(event):.6f}" in text
        assert f"{impulse:.5g} N s at" in text or f"{impulse:.6f}" in text
    for record, words in ((capture, f"{math.hypot(*capture.impulse_N_s):.5g} N s"), (release, "release of 'grasp'")):
        assert f"{record.time_s:.6f} s" in text
        assert words in text


def test_an_impact_is_the_same_thing_everywhere(caught):
    """Contacts at one instant are one impact: in the report, the verification, the card of a run and the metric."""
    (hit,) = caught.impacts
    impacts = tuple(replace(hit, event=k // 3, time_s=0.1 * (k // 3)) for k in range(63))
    run = changed(caught, impacts=impacts)
    checks = ExplainedChecks(all_checks(run))
    assert "21 impacts, with 63 contacts\n" in run_report(run, checks)
    assert "21 impacts, with 63 contacts\n" in verification(run, replay_log(run.log), checks, DEFAULT_TOLERANCE)
    assert "; 21 impacts; " in repr(run)
    assert metric_values(run, ["impacts.count"])["impacts.count"] == 21


def test_that_nothing_hit_is_said_only_where_nothing_else_happened(tmp_path, caught):
    quiet = ffsm_mj.run(two_balls(tmp_path, duration_s=0.01))
    assert "no impacts" in run_report(quiet, ExplainedChecks(all_checks(quiet)))
    assert "no impacts" not in run_report(changed(caught, impacts=()), ExplainedChecks(()))


def test_the_line_on_momentum_names_what_took_most(hit, monkeypatch):
    """Of twelve thrusters and four wheels; the table of ``ffsm analyze`` has all."""
    took = {f"jet_{i}": {"kind": "external", "taken_N_m_s": [0.0, 0.0, float(i)]} for i in range(1, 8)}
    ends = {"initial_N_m_s": [0.0, 0.0, 1.0], "final_N_m_s": [0.0, 0.0, 1.0]}
    found = ends | {"stack_without_wheels_N_m_s": 0.0, "residual_N_m_s": 0.0, "actuators": took}
    monkeypatch.setattr(momentum_report, "angular_momentum", lambda _: found)
    assert "; taken by jet_7 7, jet_6 6, jet_5 5, jet_4 4 and 3 more; " in momentum_report.momentum_line(hit)
