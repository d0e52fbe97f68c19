"""Intervals against closed forms and by what they promise: to hold in so many of many samples."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ffsm_mj.experiments.statistics import (
    Proportion,
    interval_at,
    intervals,
    is_constant,
    narrow_enough,
    quantile,
    values_for_bound,
    values_for_upper_end,
)
from tests.experiments.made_up import results, row

Z = 1.959963984540054


@pytest.mark.parametrize(("of", "percent"), [(64, 5.66), (1000, 0.383)])
def test_no_failure_is_no_proof(of, percent):
    """Wilson's upper end for 0 of n is z^2 / (n + z^2)."""
    low, high = Proportion(0, of).interval
    assert low == pytest.approx(0.0, abs=1e-12)
    assert high == pytest.approx(Z**2 / (of + Z**2), rel=1e-9)
    assert 100 * high == pytest.approx(percent, abs=0.005)


@settings(max_examples=50, deadline=None)
@given(st.integers(1, 5000).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_wilson_as_it_is_printed(counted):
    count, of = counted
    p = count / of
    middle = (p + Z**2 / (2 * of)) / (1 + Z**2 / of)
    half = Z * math.sqrt(p * (1 - p) / of + Z**2 / (4 * of**2)) / (1 + Z**2 / of)
    assert Proportion(count, of).interval == pytest.approx((middle - half, middle + half), abs=1e-12)


@pytest.mark.parametrize(("share", "confidence", "needed"), [(0.95, 0.95, 59), (0.99, 0.95, 299), (0.90, 0.997, 56)])
def test_wilks(share, confidence, needed):
    """The least n with 1 - p^n >= c."""
    assert values_for_bound(share, confidence) == needed
    assert 1 - share**needed >= confidence > 1 - share ** (needed - 1)


def test_64_runs_bound_no_95th_percentile_from_above():
    """The upper rank would be 65; the bound is there from as many runs as the page says it takes, and no fewer."""
    values = np.arange(64.0)
    found = quantile(values, 0.95)
    assert found.high is None
    assert found.low is not None
    assert quantile(values, 0.05).low is None
    needed = values_for_upper_end(0.95)
    assert needed == 72
    assert quantile(np.arange(float(needed)), 0.95).high == needed - 1
    assert quantile(np.arange(float(needed - 1)), 0.95).high is None


def test_a_quantile_is_an_order_statistic():
    values = np.array([5.0, 1.0, 4.0, 2.0, 3.0])
    assert quantile(values, 0.5).value == 3.0
    assert quantile(values, 0.2).value == 1.0
    assert quantile(values, 0.21).value == 2.0


@pytest.mark.long
@pytest.mark.parametrize("share", [0.05, 0.5, 0.9])
def test_intervals_of_quantiles_hold_as_often_as_they_say(share):
    """Of 4000 samples of 100 at least 95 %, to 5 sigma = 5 sqrt(.95 .05 / 4000) = 1.7 %; a missing end is no end."""
    samples = np.random.default_rng(7).exponential(size=(4000, 100))
    true = -math.log(1 - share)
    held = 0
    for values in samples:
        found = quantile(values, share)
        above = found.low is None or found.low <= true
        held += above and (found.high is None or true <= found.high)
    assert held / 4000 > 0.95 - 0.017


def test_what_is_constant():
    assert is_constant(np.full(64, 7.769248852))
    assert is_constant(7.769248852 + 1e-15 * np.arange(10))
    assert is_constant(np.zeros(3))
    assert not is_constant(np.array([0.0, 1e-30]))
    assert not is_constant(np.array([1.0, 1.0 + 1e-9]))


def test_convergence_looks_at_powers_of_two_of_the_first_runs():
    found = results([row(i, success=i % 4 != 0, y=float(i)) for i in range(40)])
    assert [each.runs for each in intervals(found, "success")] == [8, 16, 32]
    assert [each.value for each in intervals(found, "success")] == [0.75] * 3
    assert interval_at(found, "success", 16).low == Proportion(12, 16).interval[0]
    assert interval_at(found, "y", 16).value == 7.0
    widths = [each.width for each in intervals(found, "success")]
    assert widths == sorted(widths, reverse=True)


def test_convergence_ends_before_a_run_that_is_not_made():
    """Which runs are made early is no chance: long ones come last."""
    found = results([row(i, success=True) for i in range(64) if i != 20], runs=64)
    assert [each.runs for each in intervals(found, "success")] == [8, 16]


def test_a_campaign_is_narrow_enough_at_a_power_of_two_only():
    """The width at 64 of 64 is below 0.06, that at 32 above it; between them nobody looks."""
    all_good = [row(i, success=True, y=1.0 * i) for i in range(64)]
    assert narrow_enough(results(all_good), "success", 0.06)
    assert not narrow_enough(results(all_good[:63], runs=64), "success", 0.06)
    assert not narrow_enough(results(all_good), "y", 0.06)
    assert not narrow_enough(results(all_good[:5], runs=64), "success", 1.0)
