"""A coefficient of zero is no friction, to the last bit."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

import ffsm_mj
from tests.contact_models.persistent.random_pushes import LAWS, drawn


def stated(path, folder, mu):
    """The same scene with a coefficient of friction in every rule."""
    scenario = json.loads(path.read_text())
    for rule in scenario["contacts"]["rules"]:
        rule["mu"] = mu
    other = folder / "stated.yaml"
    other.write_text(json.dumps(scenario))
    return other


@pytest.mark.parametrize("seed", [5, *(pytest.param(seed, marks=pytest.mark.long) for seed in range(6, 16))])
def test_mu_of_zero_is_bit_for_bit_the_run_without(tmp_path, seed):
    """Rows and records of scenes of up to three pairs that hit, press and open."""
    path = drawn(np.random.default_rng(seed), tmp_path)
    without = ffsm_mj.run(path, controllers=LAWS)
    zero = ffsm_mj.run(stated(path, tmp_path, 0.0), controllers=LAWS)
    assert without.keys == zero.keys
    np.testing.assert_array_equal(without.log.rows, zero.log.rows)
    for kind, records in without.records.items():
        for one, other in zip(records, zero.records[kind], strict=True):
            assert repr(dataclasses.asdict(one)) == repr(dataclasses.asdict(other))
