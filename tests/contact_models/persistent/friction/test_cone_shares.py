"""Shares of a load inside the friction cones: of the same effect, and of least norm."""

from __future__ import annotations

import math

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.contact_models.persistent.friction.choice import ModeChoice
from ffsm_mj.contact_models.persistent.friction.cones import cone_depth, largest_margin
from ffsm_mj.contact_models.persistent.friction.internal_forces import least_in_cones
from ffsm_mj.replay import replay_log
from tests.contact_models.persistent.test_friction_seen import in_a_v, on_floor
from tests.replays import proved


def problems(count):
    """Forces outside their cones, forces without effect, and coefficients, where others are inside."""
    rng = np.random.default_rng(1)
    while count:
        k = int(rng.integers(2, 9))
        mu = rng.uniform(0.1, 1.2, k)
        freedom = np.linalg.qr(rng.normal(size=(3 * k, int(rng.integers(1, 3 * k - 4)))))[0]
        given = np.column_stack((rng.uniform(0.1, 1.0, k), 0.3 * rng.normal(size=(k, 2)))).ravel()
        given = (given - freedom @ (freedom.T @ given)).reshape(-1, 3)
        if cone_depth(given, mu) < 0.0 <= largest_margin(given, freedom, mu)[0]:
            count -= 1
            yield given, freedom, mu


def test_shares_have_the_effect_are_inside_the_cones_and_of_least_norm():
    rng = np.random.default_rng(2)
    for given, freedom, mu in problems(30):
        unit = np.abs(given).max()
        found = least_in_cones(given, freedom, mu)
        change = (found - given).ravel()
        assert np.abs(change - freedom @ (freedom.T @ change)).max() < 1e-10 * unit
        assert cone_depth(found, mu) > -2e-9 * unit  # the cones are larger by 1e-9 of the largest force
        inside = largest_margin(given, freedom, mu)[1]
        # No step to others inside the cones reduces the norm: to those of the largest margin, and from there to random ones.
        directions = [
            np.zeros((len(mu), 3)),
            *((freedom @ rng.normal(size=freedom.shape[1])).reshape(-1, 3) for _ in range(5)),
        ]
        for other in (inside + direction for direction in directions):
            share = 1.0
            while cone_depth(inside + share * (other - inside), mu) < 0.0:
                share *= 0.5
            feasible = inside + share * (other - inside)
            assert np.sum(found * (feasible - found)) > -1e-8 * unit**2


def test_a_ball_pressed_into_a_v_is_logged_with_forces_on_its_cones(tmp_path):
    """Half-angle 30 degrees, mu = 0.5, 1 N: equal springs give t / n = 1.73; inside the cones the least norm has t = n / 2.

    Along the load n sin 30 + t cos 30 = 1/2 at each side.
    """
    run = proved(ffsm_mj.run(in_a_v(tmp_path, 0.5, math.radians(30.0), (0.0, -1.0))))
    normal = 0.5 / (0.5 + 0.5 * math.sqrt(0.75))
    np.testing.assert_allclose(run["contact.groove_friction_N"], normal, rtol=1e-8)
    np.testing.assert_allclose(run["contact.groove_force_N"], 2.0 * normal * math.hypot(1.0, 0.5), rtol=1e-8)


def failures(log):
    """Names of checks that fail by the states of a log."""
    return {check.name for check in replay_log(log).checks() if not check.passes}


@pytest.mark.long
@pytest.mark.parametrize("mu", [0.19, 0.21])
def test_points_that_stick_outside_their_cones_fail_a_check(tmp_path, monkeypatch, mu):
    """A box on a slope of 1 in 5, with code that never lets it slip: of mu = 0.19 it needs more than there is."""
    slope = {"geom": 'type="box" size=".5 .4 .1"', "height": 0.1, "gravity": (-0.2, 0.0, -1.0), "duration_s": 0.02}
    monkeypatch.setattr(ModeChoice, "stick_margin", lambda *_: 1.0)
    run = ffsm_mj.run(on_floor(tmp_path, mu=mu, **slope))
    assert set(run["contact.sole_mode"]) == {3.0}
    assert failures(run.log) == ({"contact complementarity"} if mu < 0.2 else set())
