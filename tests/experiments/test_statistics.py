"""Intervals against closed forms and by what they promise: to hold in so many of many samples."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import sem, t

from ffsm_mj.experiments.sentences import sentences_of
from ffsm_mj.experiments.statistics import (
    Proportion,
    digits_of,
    intervals,
    is_constant,
    mean_interval,
    mean_text,
    quantile,
    rank_correlation,
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


@pytest.mark.long(by_turns=True)
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
    shares = intervals(found, "success")
    assert [*shares] == [8, 16, 32]
    assert [each.value for each in shares.values()] == [0.75] * 3
    assert shares[16].low == Proportion(12, 16).interval[0]
    assert intervals(found, "y")[16].value == 7.0
    widths = [each.width for each in shares.values()]
    assert widths == sorted(widths, reverse=True)


def test_convergence_ends_before_a_run_that_is_not_made():
    """Which runs are made early is no chance: long ones come last."""
    found = results([row(i, success=True) for i in range(64) if i != 20], runs=64)
    assert [*intervals(found, "success")] == [8, 16]


def test_a_stop_is_evaluated_at_a_power_of_two_only():
    all_good = [row(i, success=True, y=1.0 * i) for i in range(64)]
    found = [intervals(results(all_good[:made], runs=64), "success") for made in (64, 63, 8, 7)]
    assert [max(each, default=None) for each in found] == [64, 32, 8, None]
    assert intervals(results(all_good), "lacking") == {}


def test_a_stop_sees_the_independent_runs_of_a_saltelli_design():
    """The first 2 n = 16 of 40 rows; 32 rows that are complete are no 32 independent runs."""
    rows = [row(i, success=True, x=float(i), y=float(i)) for i in range(40)]
    assert max(intervals(results(rows, kind="saltelli", n=8), "success")) == 16


def test_no_rank_correlation_of_a_few_runs():
    few, enough = (results([row(i, x=float(i), y=float(i * i)) for i in range(n)]) for n in (9, 10))
    assert rank_correlation(few, "x", "y") is None
    assert rank_correlation(enough, "x", "y") == pytest.approx(1.0)


def test_the_interval_of_a_mean_stays_where_the_values_are():
    """Resamples of positive values have positive means; Student's interval of these has an end below zero."""
    values = np.array([0.01, 0.012, 0.02, 0.25])
    assert values.mean() < t.ppf(0.975, 3) * sem(values)
    assert 0.01 <= mean_interval(values)[0] < values.mean() < mean_interval(values)[1] <= 0.25


def test_an_interval_has_the_digits_that_tell_its_ends_apart():
    """Two digits of what the ends differ by, 0.0007 of 23: to the fifth decimal; and never less than four."""
    values = 23.12347 + 0.002 * np.sin(np.arange(64))
    low, high = mean_interval(values)
    assert 1e-4 < high - low < 1e-3
    assert mean_text(values) == f"{values.mean():.5f} ({low:.5f} to {high:.5f})"
    ends = ((23.1989, 23.2012), (1.0, 2.0), (5.0, 5.0), (-1.00015, -1.0))
    assert [digits_of(*each) for each in ends] == [6, 4, 4, 6]
    (line,) = (line for line in sentences_of(results([row(i, y=y) for i, y in enumerate(values)]), ()) if "mean" in line)
    assert re.search(r"median 23\.12\d+, 5 % 23\.1215, 95 % 23\.1254", line)


def test_the_interval_of_many_values_is_that_of_fewer_to_its_error():
    """4096 are resampled, 4097 not.

    The ends of an exponential distribution differ by 0.05 standard errors at most, by the statement of the constant, and
    by 0.05 more of the 10,000 resamples: the deviation of their 2.5 % quantile is sqrt(0.025 0.975 / 10^4) / 0.058 = 0.027.
    """
    values = np.random.default_rng(2).exponential(size=4097)
    few, many = mean_interval(values[:-1]), mean_interval(values)
    assert few == pytest.approx(many, abs=0.1 * sem(values) + abs(values[:-1].mean() - values.mean()))
    assert few != many
