"""Random scenes by compiled twins and by their originals: the same events, and the same rows to rounding."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from tests.random_scenes.drawing import draw

pytest.importorskip("ffsm_mj_fast", reason="the extra 'fast' is not installed")
AFTER_CONTACT = 1e-7
"""Of the scale of a column. Sums are taken in another order, 1e-16; contacts of a tumbling body multiply that, and roots of
gaps are known to 1e-13 m, which at 1e-3 m/s is 1e-10 s."""


@pytest.mark.parametrize("seed", range(6))
def test_plain_and_compiled_runs_are_the_same(tmp_path, monkeypatch, seed):
    path = draw(seed, tmp_path)
    compiled = ffsm_mj.run(path)
    monkeypatch.setenv("FFSM_COMPILED", "0")
    plain = ffsm_mj.run(path)
    assert compiled.outcome == plain.outcome
    kinds = {kind: [len(run.records[kind]) for run in (compiled, plain)] for kind in plain.records}
    assert {kind: counts for kind, counts in kinds.items() if counts[0] != counts[1]} == {}
    states = [key for key in plain.keys if key.startswith("state.")]
    for key in states:
        one, other = np.array(compiled[key]), np.array(plain[key])
        assert np.abs(one - other).max() <= AFTER_CONTACT * (1.0 + np.abs(other).max()), key
