"""Random pushes with friction: every check passes, energy grows by efforts alone, and the log says what its states say."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.contact_models.persistent.random_pushes import drawn
from tests.contact_models.persistent.test_random_pushes import wrong

ROUND = (0.01, 0.1, 0.3, 0.5, 0.7, 1.0, 1.5)


def rubbed(seed, folder):
    """A scene of random pushes with a coefficient of friction for each pair: a round number, or an odd one."""
    path = drawn(np.random.default_rng(seed), folder)
    scenario, rng = json.loads(path.read_text()), np.random.default_rng(seed + 10**6)
    for rule in scenario["contacts"]["rules"]:
        rule["mu"] = float(rng.choice(ROUND)) if rng.random() < 0.5 else float(rng.uniform(0, 1))
    path.write_text(json.dumps(scenario))
    return path


@pytest.mark.long
@pytest.mark.parametrize("seed", range(60))
def test_random_pushes_with_friction(tmp_path, seed):
    assert wrong(rubbed(seed, tmp_path)) == []
