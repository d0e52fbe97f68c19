"""Possibly hostile files for every command: no traceback, no hang, no write outside the output, only printable text.

``uv run python -m tests.hostile --seed 27 --cases 8000`` runs a long series by hand.
"""

from __future__ import annotations

import pytest

from tests.hostile.series import complaints, run_series
from tests.hostile.strangers import STRANGERS

_PART = 25


@pytest.mark.long
@pytest.mark.parametrize("part", range(10))
def test_strangers(part, tmp_path):
    results = run_series(STRANGERS, part * _PART, _PART, tmp_path, workers=1)
    assert complaints(results) == []
    codes = [result.codes[-1] for result in results]
    assert codes.count(0) > _PART // 10
    assert codes.count(2) > _PART // 4
