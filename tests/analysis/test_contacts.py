"""Contacts that last: from rows and records, in whatever order they are told; against the momentum that they moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.intervals import ContactIntervals
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.contact_models.persistent.record import ContactBegins, ContactChanges, ContactEnds, ContactSlips
from ffsm_mj.contact_models.persistent.rule_columns import signals_of
from ffsm_mj.records.signals import Layout, Signal
from ffsm_mj.report.record_tables import contact_table
from ffsm_mj.report.run_report import run_report
from ffsm_mj.verification.truncation import ExplainedChecks
from tests.scenes import two_balls


def pushed_twice(folder, **scenario):
    """A motor of 6 N presses a ball of 2 kg, plastic, on one of 3 kg, lets go, catches up, and presses to the end."""
    force = {"kind": "pd", "joints": ["robot/x"], "kp": 6.0, "kd": 0.0}
    return two_balls(
        folder,
        restitution=0.0,
        gap=0.01,
        **{
            "duration_s": 0.4,
            "phases": [
                {"name": "push", "until": "contact_begins", "controller": {**force, "target": [1.0]}},
                {"name": "press", "for_s": 0.1, "controller": {**force, "target": [2.0]}},
                {"name": "back", "for_s": 0.05, "controller": {**force, "target": [-1.0]}},
                {"name": "again", "until": "end", "controller": {**force, "target": [4.0]}},
            ],
            **scenario,
        },
    )


def test_a_contact_moves_the_momentum_that_it_says_and_its_peak_is_that_of_the_samples(tmp_path):
    """Only contacts push the target: the impulse is 3 kg times its change of velocity, but for 1e-9 of RK4."""
    run = ffsm_mj.run(pushed_twice(tmp_path), out=tmp_path / "out", rerun=False)
    first, second = run.contacts
    assert (first.rule, first.pairs) == ("ball-target/target", ("ball-target/target",))
    assert first.start_s == run.impacts[0].time_s
    assert first.end_s == run.records["contact_endings"][0].time_s
    assert second.end_s is None
    for contact, ended in ((first, run.records["contact_endings"][0].qvel_after["target/x"][0]), (second, None)):
        begun = next(b for b in run.records["contact_beginnings"] if b.time_s == contact.start_s).qvel_after["target/x"][0]
        last = run["state.v_target_x_m_s"][-1] if ended is None else ended
        assert contact.impulse_N_s == pytest.approx(3.0 * (last - begun), abs=1e-9)
        inside = (run.time >= contact.start_s) & (run.time <= (contact.end_s or np.inf))
        highest = run["contact.ball_target_target_force_N"][inside].max()
        assert contact.peak_force_N >= highest > 1.0
        assert contact.peak_force_N == pytest.approx(highest, rel=1e-3)  # the entry's own force is of the instant before
        assert contact.start_s <= contact.peak_force_s <= (contact.end_s or np.inf)
    log = ffsm_mj.load_run(tmp_path / "out")
    assert log.contacts == run.contacts
    assert run.summary()["contacts"] == log.summary()["contacts"]
    assert list(run.summary()["contacts"][0]) == [
        *("rule", "pairs", "start_s", "end_s", "impulse_N_s", "peak_force_N", "peak_force_s"),
        *("sliding_s", "slip_m", "peak_friction_use"),
    ]
    table = log.table("contacts")
    assert table.columns["pairs"].tolist() == ["ball-target/target"] * 2
    np.testing.assert_array_equal(table.columns["end_s"], [first.end_s, np.nan])
    told = run_report(run, ExplainedChecks(all_checks(run)))
    assert contact_table(run.contacts) in told
    assert f"{first.impulse_N_s:.6f}" in told
    assert "2 persistent contacts" in repr(run)
    assert "to the end: ball-target/target" in run._repr_html_()


LAYOUT = Layout(
    (
        Signal("state", "time_s", "s", ""),
        Signal("contact", "a_b_force_N", "N", ""),
        Signal("contact", "a_b_impulse_N_s", "N s", ""),
    )
)
STATE = {"step": 0, "mode": "m", "points": 1, "qpos": (), "qvel_before": {}, "qvel_after": {}}


def record(kind, event, time_s, before, after, impulse, pair="a-b"):
    return kind(
        event=event,
        time_s=time_s,
        pair=pair,
        rule="a-b",
        closed_pairs=(),
        geoms=("a", "b"),
        point_m=(0.0, 0.0, 0.0),
        normal=(1.0, 0.0, 0.0),
        force_before_N=before,
        force_after_N=after,
        impulse_N_s=impulse,
        **STATE,
    )


def test_two_contacts_between_two_samples_are_told_apart_however_rows_and_records_come():
    """Only the second one reaches a sample after 0.1 s; the change between two samples is the peak of the first."""
    rows = np.array([[0.0, 5.0, 0.5], [0.1, 2.0, 0.6], [0.2, 4.0, 0.9]])
    records = [
        record(ContactBegins, 0, 0.05, 0.0, 1.0, 0.5),
        record(ContactChanges, 1, 0.12, 2.5, 3.0, 0.7),
        record(ContactEnds, 2, 0.15, 0.0, 0.0, 0.75),
        record(ContactBegins, 3, 0.16, 0.0, 2.0, 0.75),
    ]
    first, live = ContactIntervals(LAYOUT), ContactIntervals(LAYOUT)
    for each in records:
        first.event(each)
    for row in rows:
        first.rows(row[None])
    live.rows(rows[:1])
    live.event(records[0])
    live.rows(rows[1:2])
    for each in records[1:]:
        live.event(each)
    live.rows(rows[2:])
    assert first.intervals() == live.intervals()
    one, other = first.intervals()
    assert (one.start_s, one.end_s, one.peak_force_N, one.peak_force_s) == (0.05, 0.15, 3.0, 0.12)
    assert one.impulse_N_s == pytest.approx(0.25, abs=1e-15)
    assert (other.start_s, other.end_s, other.peak_force_N, other.peak_force_s) == (0.16, None, 4.0, 0.2)
    assert other.impulse_N_s == pytest.approx(0.15, abs=1e-15)


def test_pairs_of_a_rule_share_an_interval_from_the_first_that_closes_to_the_last_that_opens():
    records = [
        record(ContactBegins, 0, 0.05, 0.0, 1.0, 0.5, "one"),
        record(ContactBegins, 1, 0.06, 0.0, 1.0, 0.52, "two"),
        record(ContactEnds, 2, 0.08, 0.0, 0.0, 0.6, "one"),
        record(ContactBegins, 3, 0.1, 0.0, 6.0, 0.7, "one"),
        record(ContactEnds, 4, 0.11, 0.0, 0.0, 0.8, "two"),
        record(ContactEnds, 5, 0.13, 0.0, 0.0, 0.9, "one"),
        record(ContactBegins, 6, 0.2, 0.0, 1.0, 0.9, "two"),
    ]
    contacts = ContactIntervals(LAYOUT)
    for each in records:
        contacts.event(each)
    one, other = contacts.intervals()
    assert (one.start_s, one.end_s, one.pairs, one.peak_force_N) == (0.05, 0.13, ("one", "two"), 6.0)
    assert one.impulse_N_s == pytest.approx(0.4, abs=1e-15)
    assert (other.start_s, other.end_s, other.pairs) == (0.2, None, ("two",))


def test_of_a_contact_whose_beginning_is_lost_nothing_is_made_up():
    contacts = ContactIntervals(LAYOUT)
    contacts.event(record(ContactEnds, 2, 0.15, 0.0, 0.0, 0.75))
    assert contacts.intervals() == ()


def test_of_a_run_that_goes_on_the_first_row_tells_how_many_pairs_are_closed():
    """Two pairs of the rule are closed at 1 s, one of which never has a record; a third one comes and goes."""
    layout = Layout((*LAYOUT.signals, *(s for s in signals_of("a-b", friction=False) if s.key not in LAYOUT.index)))
    rows = np.zeros((3, len(layout.signals)))
    rows[:, :3] = [[1.0, 5.0, 0.5], [1.1, 2.0, 0.6], [1.2, 4.0, 0.9]]
    rows[:, layout.index["contact.a_b_pairs"]] = 2.0, 2.0, 1.0
    records = [
        record(ContactBegins, 3, 1.02, 0.0, 1.0, 0.5, "two"),
        record(ContactEnds, 4, 1.05, 0.0, 0.0, 0.55, "two"),
        record(ContactEnds, 5, 1.15, 0.0, 0.0, 0.7, "one"),
        record(ContactEnds, 6, 1.18, 0.0, 0.0, 0.8, "three"),
    ]
    for told, pairs, end_s, impulse in ((records[:3], ("two", "one", "a-b"), None, 0.4), (records, (), 1.18, 0.3)):
        first, live = (ContactIntervals(layout, goes_on=True) for _ in range(2))
        for each in told:
            first.event(each)
        first.rows(rows)
        live.rows(rows[:1])
        for each in told:
            live.event(each)
        live.rows(rows[1:])
        assert first.intervals() == live.intervals()
        (one,) = first.intervals()
        assert (one.pairs, one.start_s, one.end_s) == (pairs or ("two", "one", "three"), 1.0, end_s)
        assert (one.peak_force_N, one.peak_force_s) == (5.0, 1.0)
        assert one.impulse_N_s == pytest.approx(impulse, abs=1e-15)


def test_a_contact_that_ends_at_the_instant_where_a_run_goes_on_has_no_length():
    layout = Layout((LAYOUT.signals[0], *signals_of("a-b", friction=False)))
    rows = np.zeros((1, len(layout.signals)))
    rows[0, [0, layout.index["contact.a_b_pairs"]]] = 4.5, 1.0
    contacts = ContactIntervals(layout, goes_on=True)
    contacts.event(record(ContactEnds, 2, np.nextafter(4.5, 5.0), 0.0, 0.0, 0.75))
    contacts.rows(rows)
    assert contacts.intervals() == ()


SLIPPED = Layout((*LAYOUT.signals, Signal("contact", "a_b_friction_use", "", ""), Signal("contact", "a_b_slip_m", "m", "")))


@pytest.mark.parametrize("blocks", [1, 2, 5])
def test_slip_of_two_contacts_is_that_from_the_row_before_to_the_row_after_each(blocks):
    """The first slides from 0.05 to 0.15 s; the second sticks, slides from 0.32 s on, and ends at 0.38 s."""
    rows = np.array(
        [
            [0.0, 0.0, 0.0, 0.0, 0.0],
            [0.1, 2.0, 0.1, 1.0, 0.5],
            [0.2, 0.0, 0.2, 0.0, 0.8],
            [0.3, 4.0, 0.4, 0.25, 0.8],
            [0.4, 0.0, 0.5, 0.0, 1.0],
        ]
    )
    records = [
        replace(record(ContactBegins, 0, 0.05, 0.0, 2.0, 0.0), friction="sliding"),
        record(ContactEnds, 1, 0.15, 2.0, 0.0, 0.2),
        replace(record(ContactBegins, 2, 0.25, 0.0, 4.0, 0.2), friction="sticking"),
        replace(record(ContactSlips, 3, 0.32, 4.0, 4.0, 0.3), friction="sliding"),
        record(ContactEnds, 4, 0.38, 4.0, 0.0, 0.5),
    ]
    contacts = ContactIntervals(SLIPPED)
    for each in records:
        contacts.event(each)
    for block in np.array_split(rows, blocks):
        contacts.rows(block)
    first, second = contacts.intervals()
    assert (first.sliding_s, first.slip_m, first.peak_friction_use) == pytest.approx((0.1, 0.8, 1.0))
    assert (second.sliding_s, second.slip_m, second.peak_friction_use) == pytest.approx((0.06, 0.2, 0.25))
