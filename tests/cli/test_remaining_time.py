"""The remaining time: estimated from what is done since the first report, soon, and without the slow beginning."""

from __future__ import annotations

import pytest

from ffsm_mj.cli.remaining_time import RemainingTime, clock


def test_there_is_an_estimate_within_two_seconds_that_ignores_the_time_before_the_first_report():
    """A run of 100 s at 10 s per second, whose first step follows 30 s of imports."""
    left = RemainingTime()
    assert left.seconds(100.0) is None
    for tenth in range(20):
        left.add(tenth, now_s=30.0 + 0.1 * tenth)
        assert (left.seconds(100.0) is None) == (tenth < 10)
    assert left.seconds(100.0) == pytest.approx((100.0 - 19.0) / 10.0)


def test_a_slow_part_is_forgotten():
    """A hundredth of the rate for 20 s, then the full rate for 10 s: the estimate is that of the last seconds."""
    left = RemainingTime()
    for tenth in range(200):
        left.add(0.01 * tenth, now_s=0.1 * tenth)
    assert left.seconds(100.0) == pytest.approx(98.0 / 0.1, rel=0.01)
    for tenth in range(100):
        left.add(2.0 + tenth, now_s=20.0 + 0.1 * tenth)
    assert left.seconds(201.0) == pytest.approx(10.0, rel=0.02)


def test_nothing_is_said_while_nothing_is_done():
    left = RemainingTime()
    for second in range(5):
        left.add(0.0, now_s=float(second))
    assert left.seconds(1.0) is None


def test_the_time_is_written_like_a_clock():
    assert [clock(s) for s in (None, 0.4, 18.0, 125.0, 7500.0, float("inf"), float("nan"))] == [
        *("", "0:00 left", "0:18 left", "2:05 left", "2:05:00 left", "", "")
    ]
