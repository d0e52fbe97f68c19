"""Points of the unit cube: streams by name, rows that stay, strata, and Saltelli's blocks."""

from __future__ import annotations

from zlib import crc32

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ffsm_mj.experiments.design import unit_cube_points

NAMES = ("mass", "y", "restitution")


def test_a_new_parameter_does_not_move_the_others():
    three = unit_cube_points("random", 20, 7, NAMES)
    four = unit_cube_points("random", 20, 7, ("mass", "new", "y", "restitution"))
    np.testing.assert_array_equal(three, four[:, [0, 2, 3]])


def test_a_run_is_drawn_alone():
    """One word of the seed sequence that stands for the name and the run, whatever else is drawn."""
    drawn = unit_cube_points("random", 50, 2024, NAMES)[37, 1]
    word = np.random.SeedSequence(2024, spawn_key=(crc32(b"y"), 37)).generate_state(1, np.uint64)[0]
    assert drawn == ((int(word) >> 12) + 0.5) / 2**52


@pytest.mark.parametrize("kind", ["random", "sobol"])
@settings(max_examples=10, deadline=None)
@given(st.integers(0, 5), st.integers(0, 2**31))
def test_more_rows_leave_the_first_where_they_are(kind, power, seed):
    few, many = unit_cube_points(kind, 2**power, seed, NAMES), unit_cube_points(kind, 2 ** (power + 1), seed, NAMES)
    np.testing.assert_array_equal(few, many[: len(few)])


def test_more_rows_of_a_hypercube_are_others():
    """Why it cannot be extended."""
    assert not np.array_equal(unit_cube_points("lhs", 64, 3, NAMES), unit_cube_points("lhs", 128, 3, NAMES)[:64])


@pytest.mark.parametrize("kind", ["random", "lhs", "sobol", "saltelli"])
def test_seeds_and_only_seeds_matter(kind):
    np.testing.assert_array_equal(unit_cube_points(kind, 16, 5, NAMES), unit_cube_points(kind, 16, 5, NAMES))
    assert not np.array_equal(unit_cube_points(kind, 16, 5, NAMES), unit_cube_points(kind, 16, 6, NAMES))


@pytest.mark.parametrize("kind", ["lhs", "sobol"])
def test_one_point_in_every_stratum(kind):
    strata = np.floor(unit_cube_points(kind, 64, 11, NAMES) * 64).astype(int)
    for column in strata.T:
        assert sorted(column) == list(range(64))


def test_random_numbers_lie_inside_and_are_uniform():
    """The mean of 3000 uniform numbers is 0.5 to 5 sigma = 5 / sqrt(12 * 3000)."""
    drawn = unit_cube_points("random", 1000, 1, NAMES)
    assert drawn.min() > 0.0
    assert drawn.max() < 1.0
    assert abs(drawn.mean() - 0.5) < 5.0 / np.sqrt(12.0 * drawn.size)
    correlation = np.corrcoef(drawn.T) - np.eye(3)
    assert np.abs(correlation).max() < 5.0 / np.sqrt(1000.0)


def test_saltelli_exchanges_one_column_at_a_time():
    n, d = 8, 3
    a, b, *mixed = unit_cube_points("saltelli", n, 4, NAMES).reshape(d + 2, n, d)
    for k, block in enumerate(mixed):
        np.testing.assert_array_equal(block[:, k], b[:, k])
        others = [i for i in range(d) if i != k]
        np.testing.assert_array_equal(block[:, others], a[:, others])


def test_a_grid_is_every_combination_of_level_centres():
    points = unit_cube_points("grid", 0, 0, ("a", "b"), (2, 3))
    assert [tuple(point) for point in points] == [(a, b) for a in (0.25, 0.75) for b in (1 / 6, 0.5, 5 / 6)]
