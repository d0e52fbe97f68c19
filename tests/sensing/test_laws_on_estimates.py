"""Laws on the task's output with an estimator: from ideal sensors, the run of the true state."""

from __future__ import annotations

import numpy as np
import pytest

from tests.controllers.task_laws import LAWS
from tests.sensing.scenes import arm, column, pushing, run
from tests.sensing.test_direct import BASE, DIRECT, ENCODERS

GAINS = {kind: law for kind, law in LAWS.items() if kind != "rns"} | {"lqr": {"Q": [1.0, 1.0, 0.5, 0.5], "R": [1.0, 1.0]}}
"""Without the reaction null space: two joints cannot hold a base that turns about three axes."""


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize("kind", GAINS)
def test_ideal_sensors_give_the_run_of_the_true_state(tmp_path, kind):
    """Up to rounding, 1e-16 through gains of some 100."""
    options = {
        "robot": arm(ENCODERS + BASE),
        "contacts": {"rules": []},
        "duration_s": 0.5,
        "task": {"tip": "pad", "axes": ["y", "z"], "target_m": [0.1, -0.15]},
        "phases": [{"name": "reach", "until": "end", "controller": {"kind": kind, **GAINS[kind]}}],
    }
    runs = []
    for name, more in (("true", {}), ("estimated", {"estimator": DIRECT})):
        (tmp_path / name).mkdir()
        runs.append(run(pushing(tmp_path / name, **options, **more)))
    keys = [key for key in runs[0].log.header.layout.keys if key.startswith("state.") or key.endswith("_applied_N_m")]
    apart = [np.abs(column(runs[0], key) - column(runs[1], key)).max() for key in keys]
    assert max(apart) < 1e-10
    assert runs[0].tip_error()[-1] < runs[0].tip_error()[0]
