"""Fits of (mu, e): exact impacts give theirs, intervals cover them, and unknown laws are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ffsm_mj.errors import UnsupportedContactError
from ffsm_mj.identification.fit import fit, median_interval, predicted, split
from tests.identification.synthetic import MU, E, blocks, ellipses


def test_exact_impacts_give_their_coefficients():
    fitted = fit(ellipses(60), "stronge")
    assert (fitted.mu.value, fitted.e.value) == pytest.approx((MU, E), abs=1e-9)
    assert fitted.mu.high - fitted.mu.low < 1e-9  # nothing scatters


def test_impacts_that_stick_say_nothing_of_mu():
    """Without slip before, and friction enough, every mu explains them: its interval is the whole range, not that of e."""
    impacts = ellipses(60)
    impacts.before[:, 0] -= np.einsum("ki,ki->k", impacts.tangents[:, 0], impacts.before)
    fitted = fit(replace(impacts, after=predicted(impacts, "stronge", 1.9, E)), "stronge", (1.8, 0.5))
    assert fitted.e.value == pytest.approx(E, abs=1e-9)
    assert fitted.mu.high - fitted.mu.low > 1.8
    assert fitted.e.high - fitted.e.low < 1e-9


def test_exact_impacts_in_space_give_their_coefficients():
    fitted = fit(blocks(8), "stronge", (0.15, 0.5))
    assert (fitted.mu.value, fitted.e.value) == pytest.approx((MU, E), abs=1e-7)


def test_sliding_impacts_in_closed_form():
    """A body whose impulse has no moment: v_n' = -e v_n, v_t' = v_t - mu (1 + e) |v_n| by each law."""
    impacts = ellipses(10)
    impacts.normal[:, 2] = 0.0
    impacts.tangents[:] = (1.0, 0.0, 0.0)
    impacts.before[:, :2] = (3.0, -1.0)
    sliding = np.array([3.0 - 0.2 * 1.5, 0.5])
    for law in ("stronge", "poisson", "coulomb", "blend"):
        after = predicted(impacts, law, 0.2, 0.5)
        np.testing.assert_allclose(after[:, :2], np.broadcast_to(sliding, (len(impacts), 2)), atol=1e-12)
        np.testing.assert_array_equal(after[:, 2], impacts.before[:, 2])


def test_the_name_of_a_law_is_its_rule_for_one_contact():
    impacts = ellipses(10)
    np.testing.assert_array_equal(predicted(impacts, "blend", MU, E), predicted(impacts, "stronge", MU, E))
    assert np.abs(predicted(impacts, "poisson", MU, E) - predicted(impacts, "stronge", MU, E)).max() > 1e-3


@pytest.mark.parametrize(("law", "error"), [("nobody", LookupError), ("newton", UnsupportedContactError)])
def test_a_law_without_friction_or_without_a_name_is_refused(law, error):
    with pytest.raises(error, match=law):
        predicted(ellipses(3), law, MU, E)


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("seed", [0, 100, 200])
def test_intervals_cover_the_truth(seed):
    """Of 100 samples with noise, at least 89 of the 95 % intervals: a binomial is below that in 1 of 200 sets of seeds."""
    fits = [fit(ellipses(60, k, noise=0.05), "stronge", (MU, E), resamples=500) for k in range(seed, seed + 100)]
    assert sum(one.mu.low <= MU <= one.mu.high for one in fits) >= 89
    assert sum(one.e.low <= E <= one.e.high for one in fits) >= 89


def test_a_median_has_the_interval_of_its_resamples():
    """Of n normal values the median scatters by sqrt(pi / 2 n): 0.0396 for 1000, a 95 % interval of 0.155."""
    values = np.random.default_rng(3).standard_normal(1000)
    interval = median_interval(values)
    assert interval.low < interval.value < interval.high
    assert interval.high - interval.low == pytest.approx(0.155, rel=0.25)


def test_a_split_is_of_all_impacts_once():
    train, test = split(50, 20, seed=1)
    assert len(train) == 20
    assert sorted([*train, *test]) == list(range(50))
