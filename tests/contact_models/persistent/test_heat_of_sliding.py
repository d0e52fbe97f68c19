"""Heat of sliding: mu times the normal force times the way, and what the energy of the bodies lacks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run import Run
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.replay import replay_log
from tests.contact_models.persistent.test_friction_seen import SLIPS, T_STOP, U0, on_floor
from tests.replays import proved

HEAT, TOTAL, WORK = "contact.sole_heat_J", "balance.friction_heat_J", "balance.contact_work_J"


@pytest.fixture(scope="module")
def rolled(tmp_path_factory):
    """A sphere that slips, pressed with 1 N at mu = 0.2, and then rolls."""
    return proved(ffsm_mj.run(on_floor(tmp_path_factory.mktemp("rolled"), rates=SLIPS)))


def failures(checks):
    """Names and components of those that fail."""
    return {(check.name, check.component) for check in checks if not check.passes}


def test_heat_is_friction_times_way_until_the_slip_stops(rolled):
    time = np.minimum(rolled.time, T_STOP)
    np.testing.assert_allclose(rolled[HEAT], 0.2 * (U0 * time - 0.35 * time**2), atol=2e-11)
    assert np.diff(rolled[HEAT]).min() >= 0.0
    np.testing.assert_allclose(rolled[TOTAL], rolled[HEAT], atol=1e-17)  # sums in another order
    energy = rolled["energy.total_J"]
    # In one step energy errs by rounding; there is no other force that does work.
    np.testing.assert_allclose(energy[0] - energy, rolled[HEAT], atol=1e-14)
    np.testing.assert_allclose(rolled[WORK], -rolled[HEAT], atol=1e-14)


def test_heat_of_impacts_and_of_sliding_add_up(tmp_path):
    """A sphere that falls at 0.5 m/s with e = 0: a plastic impact, which rubs, and then sliding."""
    run = proved(ffsm_mj.run(on_floor(tmp_path, rates=(0.9, 0.0, -0.5, 0.0, 0.0, 0.0), duration_s=0.048)))
    (hit,) = run.impacts
    assert hit.friction_work_J < 0.0
    assert run[HEAT][-1] > 0.001
    np.testing.assert_allclose(run[TOTAL], run[HEAT] - hit.friction_work_J * (run.time > 0.0), atol=1e-14)


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("factor", [1.0 + 1e-5, -1.0])
def test_heat_that_is_not_the_energy_lost_fails_the_check(rolled, factor):
    log = rolled.log
    rows = np.array(log.rows)
    rows[:, log.header.layout.index[HEAT]] *= factor
    falsified = replace(log, rows=rows)
    assert "heat of sliding" in {name for name, _ in failures(Run(falsified).checks())}
    again = replay_log(falsified)
    assert not again.agrees
    assert {name for name, _ in failures(again.checks())} == {
        "heat of friction"
    }  # the states are right, this looks at the log


def test_heat_that_falls_fails_the_check(rolled):
    log = rolled.log
    rows = np.array(log.rows)
    heat, work = (log.header.layout.index[key] for key in (HEAT, WORK))
    rows[30:, heat] -= 1e-4
    rows[30:, work] += 1e-4
    assert failures(Run(replace(log, rows=rows)).checks()) >= {("heat of sliding", "fall")}


def test_sticking_gives_no_heat(tmp_path):
    """A box on a slope of 1 in 5, mu = 0.5."""
    slope = {"geom": 'type="box" size=".5 .4 .1"', "height": 0.1, "gravity": (-0.2, 0.0, -1.0), "duration_s": 0.048}
    run = proved(ffsm_mj.run(on_floor(tmp_path, mu=0.5, **slope)))
    assert not run[HEAT].any()


def test_without_friction_there_is_no_heat_and_no_check(tmp_path):
    run = ffsm_mj.run(on_floor(tmp_path, mu=0.0, rates=SLIPS, duration_s=0.02))
    assert not [key for key in run.keys if "heat" in key or key == WORK]
    assert "heat of sliding" not in {check.name for check in all_checks(run)}
