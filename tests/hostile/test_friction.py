"""Hostile cases of friction at impacts: no traceback, no hang, exit codes of the contract, complaints with their place."""

from __future__ import annotations

import pytest

from tests.hostile.friction import FRICTION
from tests.hostile.series import run_series

_PART = 30


@pytest.mark.long
@pytest.mark.parametrize("part", range(10))
def test_hostile_friction(part, tmp_path):
    results = run_series(FRICTION, part * _PART, _PART, tmp_path, workers=1)
    assert [f"case {r.number} ({r.kind}): {r.complaint}\n{r.stderr[-600:]}" for r in results if r.complaint] == []
    # Scenarios and logs are among them, some of both are taken, and some are not.
    for kind in ("friction", "log"):
        refused = [r.codes[-1] == 2 for r in results if r.kind.startswith(kind)]
        assert any(refused)
        assert not all(refused)
