"""Mistakes in scenarios with friction at impacts, and mutated logs: a documented exit code, every fault with its place."""

from __future__ import annotations

import pytest

from tests.hostile.friction import FRICTION
from tests.hostile.series import complaints, parts, run_series, takes_some


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("part", parts(16, 300), ids=str)
def test_hostile_friction(part, tmp_path):
    results = run_series(FRICTION, part.start, len(part), tmp_path, workers=1)
    assert complaints(results) == []
    assert takes_some(results, "friction")
    assert takes_some(results, "log")
