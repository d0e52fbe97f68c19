"""Mistakes in scenarios with grasps, and mutated logs of a capture: a documented exit code, every fault with its place."""

from __future__ import annotations

import pytest

from tests.hostile.captures import CAPTURES
from tests.hostile.series import complaints, run_series, takes_some

_PART = 60


@pytest.mark.long
@pytest.mark.parametrize("part", range(10))
def test_hostile_captures(part, tmp_path):
    results = run_series(CAPTURES, part * _PART, _PART, tmp_path, workers=1)
    assert complaints(results) == []
    assert takes_some(results, "capture")
    assert takes_some(results, "log")
