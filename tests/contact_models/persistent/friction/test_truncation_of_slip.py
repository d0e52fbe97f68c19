"""Checks that fail by the truncation of large steps alone, while bodies slide and spin, and stop; a leak of heat is none."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.cli.main import main
from ffsm_mj.contact_models.persistent import closed_contacts
from ffsm_mj.replay import explain, replay_log
from ffsm_mj.replay.truncation import AnalysisLimits, analyze_truncation
from tests.contact_models.persistent.friction.scenes import block, pulled, sticks
from tests.contact_models.persistent.friction.test_random_friction import rubbed
from tests.contact_models.persistent.random_pushes import LAWS
from tests.replays import proved

TURNING = [[0.6, 0, 0], [0, 4.0, 0], [-3.0, 0, 0]]
"""A force that breaks the foot away at once, and turns by 2 rad while it slides, N."""


def shares(run):
    """By failing check, what half the step and no truncation leave of it, over the residual and over the tolerance."""
    failing = [check for check in explain(run, limits=AnalysisLimits()).checks if not check.passes]
    assert all(check.truncation is not None for check in failing)
    return {
        (check.name, check.subsystem): (
            check.truncation.half / check.residual,
            (check.truncation.left + check.truncation.bound) / check.tolerance,
        )
        for check in failing
    }


def fall_as_order_four(found):
    """16 at a halving, 8 to 32 where the next orders count; what is unknown of all steps stays below the tolerance."""
    return found and all(1 / 32 < half < 1 / 8 and left < 1.0 for half, left in found.values())


@pytest.mark.long
@pytest.mark.parametrize("step", [4e-2, 2e-2])
def test_steps_too_long_for_their_loads_fail_by_truncation_alone(tmp_path, step):
    """Implicit ones too: the work of the load over a step has order four."""
    path = pulled(tmp_path, step, TURNING)
    assert main(["run", str(path), "--out", str(tmp_path / "run"), "--no-rerun"]) == 5
    found = shares(ffsm_mj.load_run(tmp_path / "run"))
    assert ("energy", "total") in found
    assert fall_as_order_four(found)


@pytest.mark.long
@pytest.mark.parametrize("step", [4e-2, 5e-3])
def test_a_block_that_spins_until_it_stops_does_not(tmp_path, step):
    """Steps are divided while its slip turns, whatever was asked for."""
    spins = block(tmp_path, mu=0.5, velocity=(0.6, 0.2, 0.0), spin=4.0, weight=10.0, step=step, duration=0.16)
    assert len(sticks(proved(ffsm_mj.run(spins)))) == 1


@pytest.mark.long(one_of=20)
@pytest.mark.parametrize("seed", [204, pytest.param(292, marks=pytest.mark.long)])
def test_heat_of_sliding_fails_by_truncation_too(tmp_path, seed):
    """Of gap rates that drift within a step by more than heat is known to."""
    run = ffsm_mj.run(rubbed(seed, tmp_path), controllers=LAWS)
    found = shares(run)
    assert ("heat of sliding", "total") in found
    assert fall_as_order_four(found)


@pytest.mark.long
def test_steps_that_are_tried_leave_the_replay_as_it_is(tmp_path):
    """Friction modes are those of the run, to the last bit of the residuals."""
    run = ffsm_mj.run(rubbed(223, tmp_path), controllers=LAWS)
    tried = {
        (check.name, check.subsystem): check
        for check in analyze_truncation(run.log, all_checks(run)).refined.states.checks(())
    }
    for check in replay_log(run.log).checks():
        if (check.name, check.subsystem) in tried:
            assert tried[check.name, check.subsystem].residual == check.residual


@pytest.mark.long
def test_a_leak_of_heat_is_no_truncation(tmp_path, monkeypatch):
    """Heat that is wrong by 1e-7 of itself, more than the check allows; half the step leaves it as it is."""
    honest = closed_contacts.stage_of

    def stage_of(*given):
        stage, generalised = honest(*given)
        if stage.slide is not None:
            stage.slide.heat[:] *= 1.0 + 1e-7
        return stage, generalised

    monkeypatch.setattr(closed_contacts, "stage_of", stage_of)
    path = rubbed(223, tmp_path)
    run = ffsm_mj.run(path, controllers=LAWS)
    (heat,) = [check for check in explain(run, limits=AnalysisLimits()).checks if check.name == "heat of sliding"]
    assert not heat.passes
    assert heat.fails_by_truncation is False
    assert np.isfinite(heat.truncation.left)
