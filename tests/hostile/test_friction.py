"""Mistakes in scenarios with friction at impacts, and mutated logs: a documented exit code, every fault with its place."""

from __future__ import annotations

import pytest

from tests.hostile.friction import FRICTION
from tests.hostile.series import complaints, run_series, takes_some

_PART = 30


@pytest.mark.long
@pytest.mark.parametrize("part", range(10))
def test_hostile_friction(part, tmp_path):
    results = run_series(FRICTION, part * _PART, _PART, tmp_path, workers=1)
    assert complaints(results) == []
    assert takes_some(results, "friction")
    assert takes_some(results, "log")
