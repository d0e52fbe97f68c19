"""Round bodies that are pressed on each other or on boxes: nothing but the end of the run ends it."""

from __future__ import annotations

import numpy as np
import pytest

from tests.contact_models.persistent.friction.pressed_pairs import pressed
from tests.contact_models.persistent.test_random_pushes import wrong

SLOW = 33, 28, 36, 14, 51, 53, 52, 24, 58
"""Seeds that take up to 6 s with friction; the first is the shortest."""


@pytest.mark.long(one_of=20)
@pytest.mark.parametrize("seed", range(60))
def test_pressed_pairs_without_friction(tmp_path, seed):
    assert wrong(pressed(np.random.default_rng(seed), tmp_path, friction=False), completes=True) == []


@pytest.mark.long(one_of=20)
@pytest.mark.parametrize("seed", [seed for seed in range(60) if seed not in SLOW])
def test_pressed_pairs_with_friction(tmp_path, seed):
    assert wrong(pressed(np.random.default_rng(seed), tmp_path, friction=True), completes=True) == []


@pytest.mark.long
@pytest.mark.parametrize("seed", SLOW)
def test_slow_pressed_pairs_with_friction(tmp_path, seed):
    assert wrong(pressed(np.random.default_rng(seed), tmp_path, friction=True), completes=True) == []
