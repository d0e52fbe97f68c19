"""Motion of the coordinates since gaps were evaluated: the sums of a slow copy, and no gap closes by more.

Of both bounds on the closing of a pair the smaller one counts, and a reach ends where the first pair uses up its clearance.
"""

from __future__ import annotations

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from ffsm_mj._core.steppers import BOUND_MARGIN
from ffsm_mj._core.travel import Closings, Travel
from ffsm_mj.contact.motion_bound import TravelBound
from tests.scenes import ARM


def test_sums_of_the_largest_rates_at_both_ends_of_each_step(rng):
    rates, weights = np.zeros(5), rng.uniform(size=5)
    travel = Travel(rates)
    rates[:] = before = rng.normal(size=5)
    travel.begin(weights, 2.0)
    travelled, length = np.zeros(5), 0.0
    for duration_s in rng.uniform(0.0, 0.1, 40):
        rates[:] = rng.normal(size=5)
        step = BOUND_MARGIN * duration_s * np.maximum(np.abs(before), np.abs(rates))
        travelled, length, before = travelled + step, length + (step * weights).max(), rates.copy()
        assert travel.add(duration_s) == travel.is_within == (length < 2.0)
        np.testing.assert_allclose(travel.travelled, travelled, rtol=1e-14)
        np.testing.assert_allclose(travel.last, step, rtol=1e-14)
        assert travel.length == pytest.approx(length, rel=1e-14)
    assert length > 2.0


def test_nothing_is_excluded_where_rates_are_no_numbers():
    rates = np.zeros(2)
    travel = Travel(rates)
    travel.begin(np.ones(2), 1.0)
    rates[0] = np.nan
    assert not travel.add(0.001)


def test_two_bodies_approach_by_no_more(rng):
    """An arm that whirls on a free base: the distance of its tip from the hull changes by less than the bound says."""
    model = mujoco.MjModel.from_xml_string(ARM)
    data = mujoco.MjData(model)
    ids = [tuple(model.geom(name).id for name in ("hull", "tip"))]
    data.qvel[:] = rng.normal(size=model.nv) * 3.0
    model.opt.timestep, model.opt.integrator = 1e-3, mujoco.mjtIntegrator.mjINT_RK4
    mujoco.mj_forward(model, data)
    spheres = SimpleNamespace(ids=ids[0], radii=tuple(float(model.geom_rbound[geom]) for geom in ids[0]))
    travel, bound = Travel(data.qvel), TravelBound(model, data.qpos, [spheres])
    travel.begin(np.ones(model.nv), np.inf)

    def apart():
        return float(np.linalg.norm(np.subtract(*(data.geom_xpos[i] for i in ids[0]))))

    start = apart()
    for _ in range(400):
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        travel.add(1e-3)
        assert abs(apart() - start) <= (bound.rows @ travel.travelled)[0]


def test_the_smaller_bound_counts_for_each_pair(rng):
    """By rates, by energy, and by nothing where the energy has moved nothing; a rate that is no number excludes nothing."""
    rows, per_root_energy = rng.uniform(size=(4, 3)), np.array((0.1, 10.0, np.inf, 1.0))
    closings, moved = Closings(rows, np.zeros(0, dtype=np.intp), per_root_energy), rng.uniform(size=3)
    np.testing.assert_allclose(closings.most(moved, 1.0), np.minimum(rows @ moved, per_root_energy), rtol=1e-14)
    np.testing.assert_array_equal(closings.most(moved, 0.0), 0.0)
    assert np.isnan(closings.most(np.full(3, np.nan), 1.0)).all()


def test_the_reach_ends_with_the_first_clearance(rng):
    """No pair has closed by its clearance, and no displacement gone by its allowance, while the motion is within the reach.

    A pair without a clearance, or without a bound by energy, does not count; both together are no number.
    """
    rows, per_root_energy = rng.uniform(size=(4, 3)), np.array((0.5, 2.0, 1.0, np.inf))
    rows[2] = 0.0  # a pair that no coordinate moves
    clearances, rates = np.array((0.3, 0.7, np.inf, np.inf)), np.zeros(3)
    closings, travel = Closings(rows, np.array([1]), per_root_energy), Travel(rates)
    reaches = []
    for allowance in (10.0, 1e-3):
        assert closings.begin(travel, clearances, np.array([allowance])) == pytest.approx(0.7 / 2.0, rel=1e-14)
        rates[:], reach = rng.uniform(size=3), 0.0
        while travel.add(1e-5):
            assert (closings.most(travel.travelled, np.inf)[:2] < clearances[:2]).all()
            assert travel.travelled[1] < allowance
            reach = travel.length
        reaches.append(reach)
    assert 0.0 < reaches[1] < 0.1 * reaches[0]
