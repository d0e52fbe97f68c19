"""Hostile cases of captures: no traceback, no hang, exit codes of the contract, every complaint with its file and place."""

from __future__ import annotations

import pytest

from tests.hostile.captures import CAPTURES
from tests.hostile.series import run_series

_PART = 60


@pytest.mark.long
@pytest.mark.parametrize("part", range(10))
def test_hostile_captures(part, tmp_path):
    results = run_series(CAPTURES, part * _PART, _PART, tmp_path, workers=1)
    assert [f"case {r.number} ({r.kind}): {r.complaint}\n{r.stderr[-600:]}" for r in results if r.complaint] == []
    # Scenarios and logs are among them, some of both are taken, and some are not.
    for kind in ("capture", "log"):
        refused = [r.codes[-1] == 2 for r in results if r.kind.startswith(kind)]
        assert any(refused)
        assert not all(refused)
