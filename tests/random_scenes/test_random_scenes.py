"""Run, checks, log replay and an independent oracle agree in random scenes of all features."""

from __future__ import annotations

import pytest

from tests import long_share
from tests.random_scenes.judge import judge

SEEDS = 1000
SHARES = 20
"""A plain run takes the first seed of a fifth of the shares, ``--long`` all."""
MOST_ENDS = 0.02
"""Largest share of seeds that are refused or end early."""


@pytest.mark.long(one_of=5)
@pytest.mark.parametrize("share", range(SHARES))
def test_run_checks_replay_and_oracle_agree(tmp_path, share):
    seeds = range(share, SEEDS, SHARES)
    verdicts = []
    for seed in seeds if long_share.every_case else seeds[:1]:
        folder = tmp_path / str(seed)
        folder.mkdir()
        verdicts.append(judge(seed, folder))
    assert [str(verdict) for verdict in verdicts if verdict.differences] == []
    early = [str(verdict) for verdict in verdicts if verdict.end != "completed"]
    assert len(early) <= max(1, 2 * MOST_ENDS * len(seeds)), early  # of a share; of all seeds the command counts them
