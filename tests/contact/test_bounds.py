"""Tolerances of residuals: independent of the length of a run, of the origin and of the speed; every leak is found."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.digest import Digest
from ffsm_mj.analysis.run import Run
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import Layout, Signal
from ffsm_mj.verification.residuals import DRIFT_WINDOW_STEPS
from tests.scenes import ball, scene, two_balls

STEP_S, ROWS = 1e-3, 3001
OVERLAP = "balance.deepest_overlap_m"
BOTH_WAYS = "momentum.robot_P_x_N_s", "momentum.robot_by_mass_matrix_P_x_N_s"


@pytest.fixture(scope="module")
def coast(tmp_path_factory):
    """Two balls before they meet: 2 kg at 1 m/s."""
    return ffsm_mj.run(two_balls(tmp_path_factory.mktemp("coast"), duration_s=0.1)).log


@pytest.fixture
def long(coast):
    """The same as a log of 3000 s with a row every 1000 steps; nothing drifts away."""
    rows = np.tile(coast.rows[0], (ROWS, 1))
    rows[:, 0] = np.arange(ROWS)
    return replace(coast, rows=rows)


def leaking(log: RunLog, keys: str | tuple[str, ...], leak: np.ndarray) -> Run:
    rows = log.rows.copy()
    for key in (keys,) if isinstance(keys, str) else keys:
        rows[:, log.header.layout.index[key]] += leak
    return Run(replace(log, rows=rows))


def broken(run: Run) -> list[tuple[str, str]]:
    return [(check.name, check.subsystem) for check in run.checks() if not check.passes]


def test_tolerance_of_a_step_does_not_depend_on_the_number_of_steps(long):
    """The tolerance is 1e-14 (1 + scale) a step, scale 2 N s: 3e-14 passes for 3e6 steps, a sum of 9e-8; 4e-14 fails."""
    steps = long.rows[:, 0] / STEP_S
    good = leaking(long, BOTH_WAYS, 2.9e-14 * steps)
    assert not broken(good)
    (law,) = (check for check in good.checks() if (check.name, check.subsystem) == ("linear momentum", "robot"))
    assert law.residual == pytest.approx(2.9e-14 * DRIFT_WINDOW_STEPS, rel=1e-6)
    assert law.drift == pytest.approx(2.9e-14 * steps[-1], rel=1e-6)
    assert good.summary()["conservation"]["linear_momentum_residual_N_s"] == law.drift
    for count in (101, ROWS):  # a hundred seconds, and all
        short = replace(long, rows=long.rows[:count])
        leak = 4e-14 * steps[:count]
        assert broken(leaking(short, BOTH_WAYS, leak)) == [("linear momentum", "robot")]


@pytest.mark.long
@pytest.mark.parametrize("at", [1, 99, 100, 101, 1234, 2999, 3000])
@pytest.mark.parametrize(
    ("key", "name"), [("momentum.objects_L_z_N_m_s", "angular momentum"), ("energy.objects_J", "energy")]
)
def test_a_leak_of_a_ten_millionth_is_found_whenever_it_happens(long, at, key, name):
    """Also between the last row of a window and the first of the next; it is reported in the window where it happens."""
    run = leaking(long, key, np.where(np.arange(ROWS) >= at, 1e-7, 0.0))
    if name == "angular momentum":  # a ball on a rail cannot turn: say that it can
        metadata = {**run.log.header.metadata, "free_components_objects": "1 1 1 1 1 1"}
        run = Run(replace(run.log, header=replace(run.log.header, metadata=metadata)))
    assert broken(run) == [(name, "objects")]
    (law,) = (check for check in run.checks() if not check.passes)
    assert law.residual == pytest.approx(1e-7)
    assert law.time_s == at


@pytest.mark.long
def test_checks_do_not_depend_on_the_blocks_of_rows(baseline):
    log = replace(baseline.log, rows=baseline.log.rows[::7])
    header = replace(log.header, metadata={**log.header.metadata, "time_step_s": "3e-5"})  # ten windows
    rng = np.random.default_rng(3)
    found = set()
    for cuts in ([], range(1, len(log.rows)), rng.integers(0, len(log.rows), 50), rng.integers(0, len(log.rows), 900)):
        seen = Digest()
        seen.open(header)
        for block in np.split(log.rows, sorted({*map(int, cuts)})):
            if len(block):
                seen.rows(block)
        found.add((seen.check_accumulator.checks(log.impacts), seen.samples, seen.end_s, str(seen.tip)))
    assert len(found) == 1


def test_a_first_order_integrator_fails_in_a_long_run():
    """Euler's method loses 1e-3 of the momentum in 30 s at 1 ms; windows of 1 s stand for a much longer run."""
    prepared = prepare("baseline", ["duration_s=6.0"])
    prepared.unused.clear()
    prepared.system.mj.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    log = prepared.run().log
    metadata = {**log.header.metadata, "time_step_s": "1e-5"}
    run = Run(replace(log, header=replace(log.header, metadata=metadata)))
    assert {("linear momentum", "robot"), ("angular momentum", "robot"), ("energy", "total")} <= set(broken(run))


def fast_balls(folder, offset=(0.0, 0.0, 0.0), **scenario):
    """A ball of 2 kg at 100 km/s hits one of 3 kg off centre."""
    x, y, z = offset
    joints = {"robot/free": [x, y, z, 1, 0, 0, 0], "target/free": [x + 1000.0, y + 0.05, z + 0.02, 1, 0, 0, 0]}
    return scene(
        folder,
        ball("ball", mass=2.0),
        {"target": ball("target", mass=3.0)},
        initial={"joints": joints, "rates": {"robot/free": [1e5, 0, 0, 0, 0, 0]}},
        contacts={"rules": [{"between": ["ball", "target/target"], "restitution": 1.0}]},
        **scenario,
    )


def test_rounding_at_a_hundred_kilometres_a_second_is_no_violation(tmp_path):
    """L_y is the sum of terms r x m v of 1e5 m x 2e5 N s, each rounded to 1e-16: it is accurate to about 1e-6 only."""
    run = ffsm_mj.run(fast_balls(tmp_path))
    assert run.impacts
    assert not broken(run)
    (law,) = (check for check in run.checks() if (check.name, check.subsystem) == ("angular momentum", "total"))
    assert law.residual > 1e-9 * (1.0 + np.linalg.norm(run.momentum()[:, 3:], axis=1).max())  # what it was held to
    terms = 1e5 * 2e5  # lever at 1 s, momentum
    assert 1e-9 * terms < law.tolerance < 2e-9 * terms
    leak = np.where(run.time > 0.5, 1e-8 * terms, 0.0)
    assert ("angular momentum", "total") in broken(leaking(run.log, "momentum.total_L_z_N_m_s", leak))


def test_checks_do_not_depend_on_the_origin(tmp_path):
    """If the residual of P passes, so does its moment about any origin."""
    log = ffsm_mj.run(fast_balls(tmp_path, (0.0, 3e5, 0.0), duration_s=0.005)).log
    allowed = min(
        check.tolerance for check in Run(log).checks() if check.name == "linear momentum" and check.subsystem == "robot"
    )
    rows, index = log.rows.copy(), log.header.layout.index
    for subsystem in ("robot", "total", "robot_by_mass_matrix"):
        rows[-1, index[f"momentum.{subsystem}_P_x_N_s"]] += 0.9 * allowed
        rows[-1, index[f"momentum.{subsystem}_L_z_N_m_s"]] -= 0.9 * allowed * 3e5
    assert not broken(Run(replace(log, rows=rows)))


@pytest.mark.parametrize("conservative", ["true", "false"])
def test_no_penetration_has_its_own_tolerance_of_a_nanometre(coast, conservative):
    """If the log has the depth. A tolerance for all checks does not change it; its own tolerance does."""
    kept = [i for i, key in enumerate(coast.header.layout.keys) if key != OVERLAP]
    signals = [coast.header.layout.signals[i] for i in kept]
    header, rows = replace(coast.header, layout=Layout(tuple(signals))), coast.rows[:, kept]
    assert "no penetration" not in {check.name for check in Run(replace(coast, header=header, rows=rows)).checks()}
    layout = Layout((*signals, Signal("balance", "deepest_overlap_m", "m", "")))
    metadata = {**header.metadata, "conservative": conservative}
    for depth, holds in ((0.9e-9, True), (1.1e-9, False), (np.nan, False)):
        deep = np.column_stack((rows, np.where(np.arange(len(rows)) == 42, depth, 0.0)))
        run = Run(replace(coast, header=replace(header, layout=layout, metadata=metadata), rows=deep))
        for tolerance in (1e-9, 1.0, 1e-15):
            (law,) = (check for check in run.checks(tolerance) if check.name == "no penetration")
            assert (law.passes, law.tolerance, law.time_s) == (holds, 1e-9, 0.042)
        assert [check.passes for check in run.checks({"no penetration": 1e-6}) if check.name == "no penetration"] == [
            not np.isnan(depth)
        ]


def test_without_conservation_only_impacts_and_overlap_are_checked(tmp_path):
    path = two_balls(tmp_path, conservative=False, duration_s=0.5)
    text = (tmp_path / "target.xml").read_text().replace('<option gravity="0 0 0"/>', '<option density="100"/>')
    (tmp_path / "target.xml").write_text(text)
    run = ffsm_mj.run(path)
    assert not run.conservative
    of_impacts = {"impact energy", "impact restitution", "restitution used", "contact geometry"}
    checks = all_checks(run)
    assert {check.name for check in checks} - {"no penetration"} == of_impacts
    assert all(check.passes for check in checks)
    assert run.summary()["conservation"] is None
    assert np.ptp(run["balance.total_energy_residual_J"]) > 1e-3  # dissipated by the fluid, and not in the balance
