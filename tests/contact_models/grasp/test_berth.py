"""The shipped scenario of two arms and a port: three grasps at once, and from which starts the satellite is berthed."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.experiments.planning import load_campaign
from tests.replays import proved

PHASES = ["approach", "second_grasp", "settle", "bring_in", "berthed", "hand_over"]


@pytest.mark.long
@pytest.mark.slow
def test_two_arms_and_a_port_hold_the_satellite_and_one_arm_lets_go():
    """Mobility by counting: 18 + 6 less 6 by each grasp. At rest in the port no arm carries anything."""
    run = ffsm_mj.run("berth", {"duration_s": 41.0})
    proved(run)
    assert [phase.name for phase in run.phases] == PHASES
    assert run.impacts == run.unhandled_contacts == ()
    closed = [(each.grasp, each.place, each.rank, each.mobility) for each in run.records["grasp_impulses"]]
    assert closed == [("left", 1, 6, 18), ("right", 2, 6, 12), ("port", 3, 6, 6)]
    assert [each.grasp for each in run.records["releases"]] == ["left"]
    for grasp, place in (("left", 0.0), ("right", 1.0), ("port", 2.0)):
        assert run[f"contact.grasp_{grasp}_closed"][-1] == place
    berthed = int(np.searchsorted(run.time, 39.9))
    for grasp in ("left", "right", "port"):
        force = [run[f"contact.grasp_{grasp}_force_{x}_N"][berthed] for x in "xyz"]
        assert np.linalg.norm(force) < 1e-3


@pytest.mark.long
@pytest.mark.parametrize("row", range(0, 20, 3))
def test_it_berths_from_dispersed_starts(row):
    """Every third of the campaign's rows; the campaign itself runs them all."""
    plan = load_campaign("berth-dispersed", ())
    assert plan.config.samples.n == 20
    run = ffsm_mj.run("berth", plan.design().overrides(row) | {"duration_s": 46.0})
    assert run.outcome == "completed", run.message
    assert [capture.grasp for capture in run.grasps] == ["left", "right", "port"]
    assert [phase.name for phase in run.phases] == PHASES
    assert all(check.passes for check in all_checks(run))
