"""The estimate of the remaining time of counted work: a mean rate, counted down between reports."""

from __future__ import annotations

import pytest

from ffsm_mj.cli import progress_line
from ffsm_mj.cli.progress_line import Pace


@pytest.fixture
def clock(monkeypatch):
    """A clock of the test: a list of one time, s."""
    now = [100.0]
    monkeypatch.setattr(progress_line.time, "monotonic", lambda: now[0])
    return now


def seconds(text: str) -> int:
    """Seconds of ``m:ss`` or ``h:mm:ss``."""
    total = 0
    for part in text.split(":"):
        total = 60 * total + int(part)
    return total


@pytest.mark.parametrize("before", [0, 500])
def test_the_estimate_of_runs_that_take_a_minute_counts_down(clock, before):
    """Two workers, 60 s a run, 24 runs to go: 720 s; what was done before the start does not count."""
    pace, total = Pace(), before + 24
    pace.add(before)
    assert pace.left(total) == "-:--"
    shown = {}
    for second in range(1, 721):
        clock[0] += 1.0
        if second % 60 == 0:
            pace.add(before + second // 30)
        shown[second] = pace.left(total)
    assert {shown[second] for second in range(1, 60)} == {"-:--"}
    assert [seconds(shown[second]) for second in range(60, 721)] == [720 - second for second in range(60, 721)]


def test_the_estimate_is_steady_where_runs_differ(clock):
    """Runs of 9 and 1 s in turn, 5 s on average: after the first twenty of 100 the estimated end is right within 4 %."""
    pace, ends = Pace(), []
    pace.add(0)
    for k in range(1, 101):
        clock[0] += 1.0 + 8.0 * (k % 2)
        pace.add(k)
        if 20 <= k < 100:
            ends.append((k, clock[0] - 100.0 + seconds(pace.left(100))))
    # After an odd number k the mean is 5 s + 4 s / k, for all 100 runs; it is shown in whole seconds.
    assert all(abs(end - 500.0) <= 400.0 / k + 0.5 for k, end in ends)


def test_hours_are_shown(clock):
    pace = Pace()
    pace.add(0)
    clock[0] += 30.0
    pace.add(1)
    assert pace.left(1024) == "8:31:30"
