"""The golden comparison sees what it is to see: a column, an event and a metric that have changed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import ffsm_mj
from tests.changed_logs import with_records
from tests.golden.compare import log_differences


@pytest.fixture(scope="module")
def log():
    return ffsm_mj.run("tap", {"duration_s": 0.4}).log


def changed(log, key, time_s, share):
    rows, column = np.array(log.rows), log.header.layout.index[key]
    row = int(np.searchsorted(rows[:, log.header.layout.time], time_s))
    rows[row, column] += share * (1.0 + np.nanmax(np.abs(rows[:, column])))
    return replace(log, rows=rows)


def test_a_log_is_its_own_equal(log):
    assert log_differences(log, log) == []


@pytest.mark.parametrize(("after", "share", "seen"), [(-0.05, 5e-11, True), (0.05, 5e-11, False), (0.05, 5e-9, True)])
def test_rows_may_differ_more_after_the_first_event(log, after, share, seen):
    key = "energy.total_J"
    told = log_differences(log, changed(log, key, min(log.instants_s) + after, share))
    assert [each.split()[0] for each in told] == ([key] if seen else [])


def test_events_that_have_changed_are_named(log):
    first, *others = log.impacts
    late = with_records(log, {"impacts": (replace(first, time_s=first.time_s + 1e-8), *others)})
    assert log_differences(log, late) == ["impacts 1 time_s by 1.0e-08"]
    assert log_differences(log, with_records(log, {"impacts": ()})) == [f"{len(log.impacts)} impacts, now 0"]
