"""The plastic impulse: closed relations on random states, free and planar."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_mj.contact_models.grasp.latch_joints import plastic_impulse, relative_twist_rows
from tests.contact_models.grasp.scenes import FLAT_ARM, FLAT_TARGET, Bench

GRASPS = 100
SPACE, PLANE = (), (FLAT_ARM, FLAT_TARGET)


@pytest.mark.parametrize(("models", "rank"), [(SPACE, 6), (PLANE, 3)], ids=["space", "plane"])
def test_what_a_capture_keeps_and_what_it_loses(tmp_path, rng, models, rank):
    """Momenta, no relative twist, energy by the formula, whatever the state; tolerances are rounding of the terms."""
    bench = Bench(tmp_path, *models)
    for _ in range(GRASPS):
        bench.draw(rng)
        momentum, energy = bench.momentum(), bench.energy()
        found = bench.capture()
        assert found.rank == rank
        # What the joints of a plane bear is no momentum of the system.
        kept = slice(None) if rank == 6 else [0, 1, 5]
        assert np.abs(bench.momentum() - momentum)[kept].max() <= 1e-14 * (1.0 + bench.moduli())
        assert np.abs(bench.twist()).max() <= 1e-13 * (1.0 + np.abs(bench.data.qvel).max())
        assert found.loss_J >= 0.0
        assert abs(energy - bench.energy() - found.loss_J) <= 1e-14 * energy


def test_rows_of_a_plane_are_solved_with_least_norm(tmp_path, rng):
    """Force and moment out of the plane are borne by joints: of least norm there are none."""
    bench = Bench(tmp_path, *PLANE)
    bench.draw(rng)
    assert np.abs(bench.impulse().impulses[[2, 3, 4]]).max() <= 1e-15


@pytest.mark.parametrize("models", [SPACE, PLANE], ids=["space", "plane"])
def test_without_relative_twist_nothing_changes(tmp_path, rng, models):
    bench = Bench(tmp_path, *models)
    for _ in range(20):
        bench.draw(rng)
        bench.capture()
        found = bench.impulse()
        assert np.abs(found.change).max() <= 1e-13 * (1.0 + np.abs(bench.data.qvel).max())
        assert found.loss_J <= 1e-26 * (1.0 + bench.energy())


def test_the_loss_is_that_of_the_formula(tmp_path, rng):
    """u^T (J M^-1 J^T)^-1 u / 2, section by section another way than the code's."""
    bench = Bench(tmp_path)
    bench.draw(rng)
    model, data, sites = bench.model, bench.data, bench.sites
    J = relative_twist_rows(model, data, sites.link, sites.root, sites.point(data))
    response = np.empty_like(J)
    mujoco.mj_solveM(model, data, response, J)
    u = J @ data.qvel
    impulse = -np.linalg.solve(response @ J.T, u)
    found = bench.impulse()
    np.testing.assert_allclose(found.impulses, impulse, rtol=1e-11)
    assert found.loss_J == pytest.approx(-0.5 * u @ impulse, rel=1e-12)


def test_an_impact_before_changes_nothing_of_what_comes_after(tmp_path, rng):
    """A normal impulse at any point of the two is within the rows: the velocities after the capture are the same."""
    bench = Bench(tmp_path)
    bench.draw(rng)
    model, data, sites = bench.model, bench.data, bench.sites
    alone = data.qvel + bench.impulse().change
    normal, point = np.array([0.6, 0.0, 0.8]), np.array([0.3, -0.2, 0.1])
    row = normal @ relative_twist_rows(model, data, sites.link, sites.root, point)[:3]
    change = np.empty((1, model.nv))
    mujoco.mj_solveM(model, data, change, row[None])
    data.qvel[:] -= 1.7 * (row @ data.qvel) / (row @ change[0]) * change[0]
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qvel + bench.impulse().change, alone, atol=1e-12)


def test_rows_between_two_points_would_leak_angular_momentum(tmp_path, rng):
    """The check above sees it: each body's rows at a site of its own."""
    bench = Bench(tmp_path)
    bench.draw(rng)
    model, data, sites = bench.model, bench.data, bench.sites
    momentum = bench.momentum()
    rows = np.empty((2, 6, model.nv))
    for each, body, site in ((rows[0], sites.link, sites.robot), (rows[1], sites.root, sites.object)):
        mujoco.mj_jac(model, data, each[:3], each[3:], data.site_xpos[site].copy(), body)
    J, response = rows[1] - rows[0], np.empty((6, model.nv))
    mujoco.mj_solveM(model, data, response, J)
    data.qvel[:] -= response.T @ np.linalg.solve(response @ J.T, J @ data.qvel)
    mujoco.mj_forward(model, data)
    assert np.abs(bench.momentum() - momentum)[:3].max() <= 1e-13 * (1.0 + bench.moduli())
    assert np.abs(bench.momentum() - momentum)[3:].max() > 1e-3


def test_joining_a_body_to_itself_has_no_rows(tmp_path, rng):
    """Nothing moves against itself: rank 0, no impulse."""
    bench = Bench(tmp_path)
    bench.draw(rng)
    found = plastic_impulse(bench.model, bench.data, bench.sites.link, bench.sites.link, np.zeros(3))
    assert (found.rank, found.loss_J) == (0, 0.0)
