"""The estimate of the remaining time of counted work: a mean rate, counted down between reports."""

from __future__ import annotations

import pytest

from ffsm_mj.cli import progress
from ffsm_mj.cli.progress import Pace, lines_of_runs
from ffsm_mj.cli.progress_line import _clock


@pytest.fixture
def clock(monkeypatch):
    """A clock of the test: a list of one time, s."""
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


@pytest.mark.parametrize("before", [0, 500])
def test_the_estimate_of_runs_that_take_a_minute_counts_down(clock, before):
    """Two workers, 60 s a run, 24 runs to go: 720 s; what was done before the start does not count."""
    pace, total = Pace(), before + 24
    pace.add(before)
    shown = {}
    for second in range(1, 721):
        clock[0] += 1.0
        if second % 60 == 0:
            pace.add(before + second // 30)
        shown[second] = pace.left_s(total)
    assert {shown[second] for second in range(1, 120)} == {None}
    assert [shown[second] for second in range(120, 721)] == pytest.approx([720 - second for second in range(120, 721)])


def test_the_estimate_is_steady_where_runs_differ(clock):
    """Runs of 9 and 1 s in turn, 5 s on average: after the first twenty of 100 the estimated end is right within 4 %."""
    pace, ends = Pace(), []
    pace.add(0)
    for k in range(1, 101):
        clock[0] += 1.0 + 8.0 * (k % 2)
        pace.add(k)
        if 20 <= k < 100:
            ends.append((k, clock[0] - 100.0 + pace.left_s(100)))
    # Since the first run the mean is 5 s after an odd number k and 5 s - 4 s / (k - 1) after an even one, of 100 - k runs.
    assert all(abs(end - 500.0) <= 400.0 / (k - 1) for k, end in ends)


def test_the_start_of_processes_does_not_enter_the_estimate(clock):
    """4 s until the first of 1000 runs, then two a second: 499.5 s in all, where the mean since the start says 4000 s."""
    pace = Pace()
    pace.add(0)
    clock[0] += 4.0
    pace.add(1)
    assert pace.left_s(1000) is None
    for k in range(2, 20):
        clock[0] += 0.5
        pace.add(k)
        left_s = pace.left_s(1000)
        assert left_s is None if k < 9 else left_s == pytest.approx((1000 - k) / 2.0)


def test_lines_of_runs_have_the_same_estimate(clock):
    said = []
    report = lines_of_runs("camp", said.append)
    report(0, 100)
    for k in range(1, 10):
        clock[0] += 20.0
        report(k, 100)
    # Every 30 s at the soonest: at 40 s, where one run since the first took 20 s, then at 80, 120 and 160 s.
    assert said[0] == "camp: 2 of 100 runs, 3 a minute, 33 min left"
    assert [line.split()[1] for line in said] == ["2", "4", "6", "8"]


@pytest.mark.parametrize(("left_s", "shown"), [(None, "-:--"), (61.4, "01:01"), (30690.0, "8:31:30")])
def test_times_are_shown_by_hours_minutes_and_seconds(left_s, shown):
    assert _clock(left_s) == shown
