"""Numbers of events: those of contacts and grasps share one count, that of the impacts is their own; each is verified."""

from __future__ import annotations

from dataclasses import replace

import pytest

import ffsm_mj
from ffsm_mj.replay import replay_log
from tests.changed_logs import with_records
from tests.contact_models.grasp.test_pressing import on_a_wall


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return ffsm_mj.run(on_a_wall(tmp_path_factory.mktemp("numbers")))


def later(records, first):
    """The same records, numbered one higher from one of them on."""
    return tuple(replace(each, event=each.event + 1) if i >= first else each for i, each in enumerate(records))


def numbered(run):
    return {plural: records for plural, records in run.log.records.items() if records and hasattr(records[0], "event")}


def test_there_are_events_of_many_kinds(run):
    assert {"impacts", "contact_beginnings", "grasp_impulses", "armings", "releases"} <= set(numbered(run))
    assert replay_log(run.log).agrees


@pytest.mark.long
@pytest.mark.parametrize("plural", ["impacts", "contact_beginnings", "grasp_impulses", "armings", "releases"])
def test_one_more_in_the_number_of_an_event_is_noticed(run, plural):
    records = run.log.records[plural]
    again = replay_log(with_records(run.log, {plural: later(records, len(records) - 1)}))
    assert not again.agrees
    assert not again.worst["impacts"].passes


def test_a_count_that_is_one_higher_everywhere_is_noticed(run):
    higher = {plural: later(records, 0) for plural, records in numbered(run).items()}
    assert not replay_log(with_records(run.log, higher)).agrees


def test_an_event_that_is_not_there_is_noticed_by_the_next_number(run):
    """An arming changes nothing of the motion."""
    assert not replay_log(with_records(run.log, {"armings": run.log.records["armings"][1:]})).agrees


def test_behind_a_hole_the_count_goes_on_with_the_number_of_the_log(run):
    """Rows over the capture and all that happens with it are lost."""
    (capture,) = run.log.records["grasp_impulses"]
    hole = (run.time > capture.time_s - 0.01) & (run.time < capture.time_s + 0.02)
    again = replay_log(replace(run.log, rows=run.log.rows[~hole]))
    assert again.agrees, again.worst
