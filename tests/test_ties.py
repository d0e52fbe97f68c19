"""Decisions between numbers that are equal to rounding."""

from __future__ import annotations

import itertools

import numpy as np

from ffsm_mj.ties import FirstOfLeast, first_of_greatest


def fed(values, rounding=1e-12):
    least = FirstOfLeast[int]()
    for place, value in enumerate(values):
        least.add(value, rounding, place)
    return least


def test_of_equal_values_the_first_is_the_greatest():
    rounding = 1e-12
    for noise in itertools.product((-3e-16, 0.0, 3e-16), repeat=3):
        assert first_of_greatest([0.3, *(1.0 + x for x in noise)], rounding) == 1
    assert first_of_greatest([0.3, 1.0, 1.0 + 1e-11], rounding) == 2


def test_of_equal_values_the_first_is_the_least():
    noise = np.random.default_rng(1).normal(scale=1e-15, size=500)
    least = fed([3.0, 2.0, *(1.0 + noise)])
    assert least.first() == 2
    assert least.least == 1.0 + noise.min()
    assert fed([3.0, 1.0, 2.0, 1.0 - 1e-11]).first() == 3
    assert FirstOfLeast[int]().first() is None


def test_the_first_of_slowly_falling_values_is_among_those_that_count_as_equal_under_any_rounding():
    """Steps of 1e-14 with noise of 1e-15: when the limit is passed depends on it, and each way the other says so."""
    rng, falling = np.random.default_rng(2), 1.0 + 1e-14 * np.arange(500.0)[::-1]
    ways = [fed(falling + rng.normal(scale=1e-15, size=500)) for _ in range(30)]
    firsts = {way.first() for way in ways}
    assert len(firsts) > 1
    for way in ways:
        assert min(way.equals()) <= min(firsts)
        assert max(firsts) <= max(way.equals())
