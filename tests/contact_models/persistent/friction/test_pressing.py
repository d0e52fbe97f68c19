"""Accelerations that press contacts which slide or stick: whether a bounce is dropped depends on friction."""

from __future__ import annotations

import pytest

import ffsm_mj
from ffsm_mj.contact_models.impact import rest_rule
from tests.contact_models.persistent.friction.scenes import block, load
from tests.replays import proved

HALF = L, W, H = 0.1, 0.08, 0.3
"""A tall block of 1 kg: friction mu tips it over its front edge where mu h > l, at mu = 1/3."""
I_X, I_Y = (W**2 + H**2) / 3.0, (L**2 + H**2) / 3.0
INVERSE, COUPLING = 1.0 + L**2 / I_Y + W**2 / I_X, L * H / I_Y
"""Of a front corner: G_nn, and G_nt to friction against x; at the rear the latter has the other sign."""
ROUNDING = 2e-7
"""The impact leaves velocities of 1e-7 m/s, which turn a slip of 0.6 m/s; accelerations are of the order of 1 m/s^2."""


@pytest.fixture
def pressing(monkeypatch):
    """The accelerations of each impact, in the order of its contact points."""
    found, honest = [], rest_rule.pressing_accelerations

    def noted(*given):
        found.append(honest(*given))
        return found[-1]

    monkeypatch.setattr(rest_rule, "pressing_accelerations", noted)
    return found


def landing(folder, mu, *, speed=0.6, loads=()):
    """It comes down flat at 1e-7 m/s, sliding along x."""
    given = {"step": 1e-3, "duration": 5e-3, "restitution": 0.5, "loads": loads}
    return block(folder, mu=mu, velocity=(speed, 0.0, -1e-7), half=HALF, **given)


def side(impact):
    """Of a corner: 1 at the front, -1 at the rear."""
    return 1.0 if impact.point_m[0] > 0.0 else -1.0


@pytest.mark.parametrize("mu", [0.0, 0.1, 0.3])
def test_friction_of_a_block_that_slides_presses_its_front(tmp_path, pressing, mu):
    """Corners share 1 N: 1/4 (1 +- mu h / l) each; without its own force a corner falls at (G_nn -+ mu G_nt) lambda_n."""
    run = proved(ffsm_mj.run(landing(tmp_path, mu)))
    sides = [side(impact) for impact in run.impacts]
    expected = [0.25 * (1.0 + at * mu * H / L) * (INVERSE - at * mu * COUPLING) for at in sides]
    assert pressing[0] == pytest.approx(expected, abs=ROUNDING)
    assert [impact.restitution_used for impact in run.impacts] == [0.0] * 4


@pytest.mark.parametrize("mu", [0.4, 0.7])
def test_nothing_presses_the_rear_of_a_block_that_tips(tmp_path, pressing, mu):
    """Its rear lifts off, however slowly; without friction each corner would be pressed at 1/4 G_nn."""
    run = proved(ffsm_mj.run(landing(tmp_path, mu)))
    sides = [side(impact) for impact in run.impacts]
    total = 1.0 / (1.0 + L**2 / I_Y - mu * COUPLING)
    expected = [0.5 * total * (INVERSE - mu * COUPLING) if at > 0.0 else 0.0 for at in sides]
    assert pressing[0] == pytest.approx(expected, abs=ROUNDING)
    assert [impact.restitution_used for impact in run.impacts] == [0.0 if at > 0.0 else 0.5 for at in sides]


def test_friction_of_a_block_that_sticks_counts_too(tmp_path, pressing):
    """It is pulled by 0.2 N at its centre, of which each corner takes a quarter."""
    run = proved(ffsm_mj.run(landing(tmp_path, 0.8, speed=0.0, loads=[load("robot/box", force_N=[[0.2, 0, 0]])])))
    sides = [side(impact) for impact in run.impacts]
    expected = [0.25 * ((1.0 + at * 0.2 * H / L) * INVERSE - at * 0.2 * COUPLING) for at in sides]
    assert pressing[0] == pytest.approx(expected, abs=ROUNDING)
