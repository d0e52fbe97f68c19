"""Columns of contact rules in steady states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ffsm_mj.contact_models.persistent.rule_columns import IMPULSE, NOTHING, PRESSING, STICKING
from ffsm_mj.contact_models.persistent.steady_columns import PairLoad, RuleColumns, RuleTables


@dataclass(eq=False)
class Pair:
    rule: str


def test_rules_with_pairs_have_their_resultants_and_others_nothing():
    """Two pairs of a rule with friction, one of a rule without; a third rule has just opened."""
    tables = RuleTables(
        np.full((3, IMPULSE + 1), 7.0), {"grip": 0, "stop": 1, "open": 2}, np.full((2, 8), 7.0), {}, np.zeros(1)
    )
    tables.friction_rows.update(grip=0, open=1)
    own = {Pair("grip"): [1, 2], Pair("stop"): [3], Pair("grip"): [4]}
    columns = RuleColumns(own, tables)
    columns.write(
        [
            PairLoad((3.0, 0.0, 4.0), (1.0, 0.0, 0.0), (0.0, 0.0, 4.0), 0.5),
            PairLoad((0.0, 2.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 0.0), 0.0),
            PairLoad((-15.0, 0.0, 0.0), (5.0, 0.0, 4.0), (0.0, -3.0, 0.0), 0.75),
        ]
    )
    # The centre of both is weighted by the sizes 5 and 15 of their forces.
    np.testing.assert_array_equal(tables.values[0, :IMPULSE], [STICKING, 2, 3, 20, -12, 0, 4, 4, 0, 3])
    np.testing.assert_array_equal(tables.values[1, :IMPULSE], [PRESSING, 1, 1, 2, 0, 2, 0, 0, 1, 0])
    np.testing.assert_array_equal(tables.values[2, :IMPULSE], NOTHING[:IMPULSE])
    np.testing.assert_array_equal(tables.friction_values, [[7, 0, -3, 4, 0.75, 0, 7, 7], [0, 0, 0, 0, 0, 0, 7, 7]])
    columns.add_impulses([0.5, 0.25, 2.0])
    np.testing.assert_array_equal(tables.values[:, IMPULSE], [9.5, 7.25, 7.0])
