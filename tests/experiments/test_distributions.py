"""What campaigns draw from, against SciPy's distributions and by properties that every inverse has."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy import stats

from ffsm_mj.experiments.distributions import Distribution

SHARES = (np.arange(2000) + 0.5) / 2000
CONTINUOUS = {
    "uniform": ({"uniform": [-2.0, 3.0]}, stats.uniform(-2.0, 5.0)),
    "normal": ({"normal": {"mean": 4.0, "sd": 0.5}}, stats.norm(4.0, 0.5)),
    "lognormal": ({"lognormal": {"median": 2.0, "sigma": 0.3}}, stats.lognorm(0.3, scale=2.0)),
    "truncated": (
        {"truncated": {"mean": 1.0, "sd": 2.0, "low": 0.0, "high": 2.5}},
        stats.truncnorm(-0.5, 0.75, loc=1.0, scale=2.0),
    ),
    "one bound": ({"truncated": {"mean": 1.0, "sd": 2.0, "low": 7.0}}, stats.truncnorm(3.0, np.inf, loc=1.0, scale=2.0)),
}


def drawn(given, u=SHARES, **options):
    return Distribution.model_validate(given).quantiles(np.asarray(u), **options)


@pytest.mark.parametrize(("given_", "reference"), CONTINUOUS.values(), ids=CONTINUOUS)
def test_inverses_are_those_of_scipy(given_, reference):
    """To 1e-12: both are rational approximations good to some roundings."""
    np.testing.assert_allclose(drawn(given_), reference.ppf(SHARES), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("given_", [given_ for given_, _ in CONTINUOUS.values()], ids=CONTINUOUS)
def test_every_share_gives_a_finite_plain_float(given_):
    """A Sobol point may be 0, and rounding may make it 1."""
    values = drawn(given_, [0.0, 1.0])
    assert all(type(value) is float and math.isfinite(value) for value in values)
    assert values[0] < values[1]


def test_truncation_far_out_keeps_to_its_bounds():
    """Thirteen deviations out, where a difference of two integrals has no digit left."""
    values = drawn({"truncated": {"mean": 0.0, "sd": 1.0, "low": 13.0, "high": 13.5}})
    assert min(values) >= 13.0
    assert max(values) <= 13.5
    assert len(set(values)) == len(values)


def test_a_mean_that_is_not_stated_is_given_by_the_use():
    assert drawn({"normal": {"sd": 0.1}}, [0.5], mean=1.0) == [1.0]
    assert drawn({"truncated": {"sd": 0.1, "low": 0.95, "high": 1.05}}, [0.5], mean=1.0) == pytest.approx([1.0])
    assert drawn({"normal": {"mean": 3.0, "sd": 0.1}}, [0.5], mean=1.0) == [3.0]


@pytest.mark.long
@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from([st.booleans(), st.integers(-5, 5), st.text(max_size=3)]).flatmap(
        lambda of: st.lists(of, min_size=1, max_size=7)
    )
)
def test_a_choice_takes_every_item_as_often_as_it_stands_there(items):
    shares = (np.arange(20 * len(items)) + 0.5) / (20 * len(items))
    assert drawn({"choice": items}, shares) == [item for item in items for _ in range(20)]


def test_values_are_drawn_in_rising_order():
    assert drawn({"values": [3.0, 1.0, 2.0]}, [0.1, 0.5, 0.9]) == [1.0, 2.0, 3.0]
    assert drawn({"values": [3.0, 1.0, 2.0]}, [0.0, 1.0]) == [1.0, 3.0]


def test_levels_of_a_grid():
    assert Distribution.model_validate({"grid": {"low": 0.0, "high": 1.0, "levels": 5}}).levels == (
        0.0,
        0.25,
        0.5,
        0.75,
        1.0,
    )
    assert Distribution.model_validate({"uniform": [0.0, 1.0]}).levels is None


@settings(max_examples=60, deadline=None)
@given(
    st.floats(-1e3, 1e3),
    st.floats(1e-3, 1e3),
    st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0)),
    st.sampled_from(["uniform", "normal", "lognormal", "truncated"]),
)
def test_a_larger_share_is_no_smaller_value(middle, width, shares, kind):
    """Stratified and Sobol samples, and rank correlations, rest on it."""
    given_ = {
        "uniform": [middle, middle + width],
        "normal": {"mean": middle, "sd": width},
        "lognormal": {"median": width, "sigma": 0.5},
        "truncated": {"mean": middle, "sd": width, "low": middle - width},
    }[kind]
    low, high = drawn({kind: given_}, sorted(shares))
    assert low <= high


@pytest.mark.parametrize(
    ("given_", "message"),
    [
        ({}, "needs one of uniform, normal, truncated, lognormal, choice, values, grid; got none"),
        ({"uniform": [0.0, 1.0], "values": [1.0]}, "got uniform and values"),
        ({"uniform": [1.0, 1.0]}, "needs a lower and a higher number, got 1 and 1"),
        ({"normal": {"mean": 0.0, "sd": 0.0}}, "greater than 0"),
        ({"truncated": {"mean": 0.0, "sd": 1.0}}, "without bounds, write 'normal'"),
        ({"truncated": {"mean": 0.0, "sd": 1.0, "low": 1.0, "high": 1.0}}, "low must be below high"),
        ({"lognormal": {"median": -1.0, "sigma": 1.0}}, "greater than 0"),
        ({"values": []}, "at least 1 item"),
        ({"values": [float("nan")]}, "finite"),
        ({"choice": [1.0, float("nan")]}, "should be a finite number, a text, a flag or a list"),
        ({"choice": [1.0, "a"]}, "the values of a choice must have one type"),
        ({"choice": [True, 1]}, "the values of a choice must have one type"),
        ({"grid": {"low": 0.0, "high": 1.0, "levels": 1}}, "greater than or equal to 2"),
    ],
)
def test_what_is_no_distribution(given_, message):
    with pytest.raises(ValidationError, match=message):
        Distribution.model_validate(given_)
