"""The optional compilation changes how fast a run is, not what it is."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

from ffsm_mj.compiled import COMPILED

SCRIPT = """
import sys, numpy, ffsm_mj
from ffsm_mj.compiled import COMPILED
run = ffsm_mj.run("baseline", {"duration_s": 12.0})
assert COMPILED == (sys.argv[1] == "1")
numpy.save(sys.argv[2], numpy.column_stack([run[key] for key in run.keys]))
"""


def rows(path, compiled):
    """All columns of the first twelve seconds of the baseline, impact and pause included, in a process of its own."""
    environment = os.environ | {"FFSM_COMPILED": compiled}
    subprocess.run([sys.executable, "-c", SCRIPT, compiled, str(path)], check=True, env=environment)
    return np.load(path)


@pytest.mark.slow
@pytest.mark.skipif(not COMPILED, reason="numba is not installed, or switched off")
def test_results_agree_with_and_without_compilation(tmp_path):
    """Array products may be summed in another order: 1e-15 per tick, amplified a little by the feedback."""
    with_numba, without = rows(tmp_path / "with.npy", "1"), rows(tmp_path / "without.npy", "0")
    np.testing.assert_allclose(with_numba, without, rtol=0.0, atol=1e-10, equal_nan=True)
