"""Run, checks, log replay and an independent oracle agree in random scenes; the oracle sees one wrong number of a log."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import ffsm_mj
from tests import long_share
from tests.random_scenes.drawing import draw
from tests.random_scenes.judge import judge
from tests.random_scenes.oracle import oracle_differences

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


GRASP, FRICTION = 3, 5
"""Seeds with a capture, and with impacts with friction of one contact and motion between them."""


class Changed:
    """A run in which a column or a record is another one."""

    def __init__(self, run, columns=None, **records):
        self._run, self._columns, self.keys = run, columns or {}, run.keys
        self.records = {**run.records, **records}

    def __getitem__(self, key):
        return self._columns.get(key, self._run[key])


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    found = {}
    for seed in (GRASP, FRICTION):
        folder = tmp_path_factory.mktemp(str(seed))
        found[seed] = folder, ffsm_mj.run(draw(seed, folder))
    return found


def said(folder, run):
    with np.errstate(all="ignore"):
        return " ".join(oracle_differences(folder, run))


def drifting(key, size):
    return lambda run: {key: np.array(run[key]) + size * np.arange(len(run[key]))}


@pytest.mark.long
@pytest.mark.parametrize(
    ("change", "found"),
    [
        (drifting("energy.robot_J", 1e-9), "row: energy of robot"),
        (drifting("momentum.objects_L_z_N_m_s", 1e-9), "row: momentum of objects"),
        (drifting("state.v_o0_free_vx_m_s", 1e-7), "motion of object"),
        (drifting("balance.work_J", 1e-7), "motion: work of actuators"),
    ],
)
def test_a_wrong_column(runs, change, found):
    folder, run = runs[FRICTION]
    assert found in said(folder, Changed(run, change(run)))


@pytest.mark.long
@pytest.mark.parametrize(
    ("seed", "kind", "change", "found"),
    [
        (FRICTION, "impacts", lambda r: {"impulse_N_s": r.impulse_N_s * (1.0 + 1e-6)}, "M dv less impulses"),
        (FRICTION, "impacts", lambda r: {"gap_m": r.gap_m + 1e-7}, "impact: gap of"),
        (FRICTION, "impacts", lambda r: {"restitution_used": 0.9 * r.restitution + 0.01}, "restitution_used"),
        (FRICTION, "impacts", lambda r: {"mu": r.mu * (1.0 + 1e-5)}, "one contact with friction"),
        (FRICTION, "impacts", lambda r: {"normal": tuple(np.array(r.normal) * (1.0 + 1e-6))}, "impact: speed"),
        (GRASP, "grasp_impulses", lambda r: {"impulse_N_s": tuple(-np.array(r.impulse_N_s))}, "less the impulse"),
        (GRASP, "grasp_impulses", lambda r: {"qvel_after": r.qvel_before}, "velocity of the latch"),
        (GRASP, "grasp_impulses", lambda r: {"loss_J": r.loss_J * (1.0 + 1e-5)}, "loss of energy"),
    ],
)
def test_a_wrong_record(runs, seed, kind, change, found):
    folder, run = runs[seed]
    records = tuple(replace(record, **change(record)) for record in run.records[kind])
    assert found in said(folder, Changed(run, **{kind: records}))
