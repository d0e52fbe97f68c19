"""Possibly hostile files for every command: no traceback, no hang, no write outside the output, only printable text.

``uv run python -m tests.hostile --seed 27 --cases 8000`` runs a long series by hand.
"""

from __future__ import annotations

import pytest

from tests.hostile.series import complaints, parts, run_series
from tests.hostile.strangers import STRANGERS


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("part", parts(12, 250), ids=str)
def test_strangers(part, tmp_path):
    results = run_series(STRANGERS, part.start, len(part), tmp_path, workers=1)
    assert complaints(results) == []
    codes = [result.codes[-1] for result in results]
    assert codes.count(0) > len(part) // 20
    assert codes.count(2) > len(part) // 4
