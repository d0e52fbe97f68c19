"""The shipped scenario of a soft and a hard latch: what each stops, what it costs, and from which starts it locks."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.experiments.planning import load_campaign
from tests.replays import proved

REDUCED_MASS_KG = 152.0 * 90.0 / 242.0


@pytest.mark.slow
def test_the_probe_is_guided_and_locked():
    """The hard latch stops 2 cm/s of the reduced mass along the axis, to what the lever arms of some millimetres change."""
    run = ffsm_mj.run("probe-and-cone", {"duration_s": 12.0})
    proved(run)
    assert [(phase.name, phase.reason) for phase in run.phases] == [
        ("approach", "start"),
        ("in_cone", "grasp"),
        ("detumble", "grasp"),
    ]
    assert run.impacts == run.unhandled_contacts == ()
    soft, hard = run.records["grasp_impulses"]
    assert (soft.rank, hard.rank, hard.replaces) == (4, 6, "soft")
    assert soft.position_m == pytest.approx(0.12, abs=1e-12)
    assert hard.position_m == pytest.approx(0.02, abs=1e-12)
    impulse = np.linalg.norm(hard.impulse_N_s)
    assert impulse == pytest.approx(0.02 * REDUCED_MASS_KG, rel=1e-2)
    # Of the axial motion and of the roll, 0.04 rad/s of the reduced moment of 27.5 and 9 kg m^2 or less about the axis.
    assert 0.5 * REDUCED_MASS_KG * 0.02**2 < hard.loss_J < 0.5 * (REDUCED_MASS_KG * 0.02**2 + 9.0 * 0.04**2)
    assert 100.0 * soft.loss_J < hard.loss_J


@pytest.mark.long
@pytest.mark.parametrize("row", range(20))
def test_it_locks_from_dispersed_starts(row):
    plan = load_campaign("probe-and-cone-dispersed", ())
    assert plan.config.samples.n == 20
    run = ffsm_mj.run("probe-and-cone", plan.design().overrides(row) | {"duration_s": 13.0})
    assert run.outcome == "completed", run.message
    assert [capture.grasp for capture in run.grasps] == ["soft", "hard"]
    assert all(check.passes for check in all_checks(run))
