"""Decisions between numbers that are equal to rounding."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from ffsm_mj.ties import FirstOfLeast, apart, first_of_greatest, last_of_first, logged, shortest_s
from ffsm_mj.tolerances import INSTANT_S


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


@pytest.mark.parametrize("start_s", [0.0, 3.0, 7e4])
def test_logged_times_tell_each_part_of_a_step(start_s):
    """Events of a step as a run applies them, and as a log replay finds them by their times: known to 1.5e-11 s at 7e4 s.

    Where they are located is random, often within rounding of the event before or of the end of the step.
    """
    rng, step_s = np.random.default_rng(3), 2e-3
    tiny, parts = (0.0, 1e-18, 1e-16, 1e-13, 3e-13, 1e-11), 0
    for step in range(round(start_s / step_s), round(start_s / step_s) + 500):
        end_s, left_s, known_s = (step + 1) * step_s, step_s, step_s
        while left_s > 0.0 and rng.uniform() < 0.8:
            place = rng.integers(4)
            located_s = (rng.choice(tiny), left_s - rng.choice(tiny), rng.uniform() * left_s, None)[place]
            elapsed_s = 0.0 if located_s is None else apart(float(np.clip(located_s, 0.0, left_s)), left_s, end_s - left_s)
            assert located_s is None or 0.0 < elapsed_s <= left_s
            left_s -= elapsed_s
            time_s = end_s - left_s
            assert not 0.0 < left_s < 0.9 * shortest_s(time_s)  # a rounded sum
            # The replay has the time alone.
            again_s = logged(known_s - (end_s - time_s), known_s, time_s)
            assert (again_s > 0.0) == (elapsed_s > 0.0)
            assert (again_s == known_s) == (left_s == 0.0)
            assert again_s == pytest.approx(elapsed_s, abs=np.spacing(end_s))
            known_s = end_s - time_s if 0.0 < again_s < known_s else known_s - again_s
            parts += 1
    assert parts > 500


def test_all_that_is_due_within_an_instant_is_due_at_its_last_time():
    assert last_of_first([0.2, 0.1, 0.1 + 0.9 * INSTANT_S, 0.1 + 1.1 * INSTANT_S], 0.0) == 0.1 + 0.9 * INSTANT_S
