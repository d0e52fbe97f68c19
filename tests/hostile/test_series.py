"""Own files with mistakes, and mutated logs: no traceback, no hang, a documented exit code, faults with file and line.

``uv run python -m tests.hostile --cases 20000`` runs a long one by hand; ``--only N --keep DIR`` one case, its files kept.
"""

from __future__ import annotations

import pytest

from tests.hostile.series import complaints, parts, run_series


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("part", parts(40, 2500), ids=str)
def test_hostile_input(part, tmp_path):
    results = run_series(1, part.start, len(part), tmp_path, workers=1)
    assert complaints(results) == []
    # The cases must reach every end, or they would show nothing: most are refused, many run.
    codes = [result.codes[-1] for result in results]
    assert codes.count(0) > len(part) // 20
    assert codes.count(2) > len(part) // 2
