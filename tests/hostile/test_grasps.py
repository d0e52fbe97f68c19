"""Mistakes in scenarios with grasps, and mutated logs of a capture: a documented exit code, every fault with its place."""

from __future__ import annotations

import pytest

from tests.hostile.grasps import GRASPS
from tests.hostile.series import complaints, parts, run_series, takes_some


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("part", parts(24, 600), ids=str)
def test_hostile_captures(part, tmp_path):
    results = run_series(GRASPS, part.start, len(part), tmp_path, workers=1)
    assert complaints(results) == []
    assert takes_some(results, "grasp")
    assert takes_some(results, "log")
