"""Every check of a run passes or fails as the same check recomputed from the log, in random scenes of all that there is."""

from __future__ import annotations

import pytest

import ffsm_mj
from ffsm_mj.replay import replay_log
from tests.replay.random_scenes import LAWS, drawn

SEEDS = 300
SHARES = [range(2), range(2, 4), *(range(start, min(start + 43, SEEDS)) for start in range(4, SEEDS, 43))]
"""A plain run takes the first."""


def differences(path):
    """What the run and its log say differently."""
    run = ffsm_mj.run(path, controllers=LAWS)
    again = replay_log(run.log)
    ours, theirs = ({(check.name, check.subsystem): check for check in checks} for checks in (run.checks(), again.checks()))
    found = [
        f"{ours.get(key)} in the run, {theirs.get(key)} recomputed"
        for key in sorted(ours.keys() | theirs.keys())
        if (key not in ours or ours[key].passes) != (key not in theirs or theirs[key].passes)
    ]
    found += [str(each) for each in again.worst.values() if not each.passes]
    return found + ([again.obstacle] if again.obstacle else [])


@pytest.mark.long
@pytest.mark.parametrize("seeds", SHARES, ids=lambda seeds: f"{seeds.start}-{seeds.stop - 1}")
def test_run_and_log_give_the_same_verdicts(tmp_path, seeds):
    for seed in seeds:
        folder = tmp_path / str(seed)
        folder.mkdir()
        assert differences(drawn(seed, folder)) == [], seed
