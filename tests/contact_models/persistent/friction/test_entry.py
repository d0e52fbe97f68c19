"""From bounces with friction into persistent contact with friction."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from tests.contact_models.persistent.friction.reading import final, sticks
from tests.contact_models.persistent.friction.scenes import block, sphere
from tests.replays import proved


def thrown(folder, interval):
    """The sphere comes down sliding and spinning backwards, bounces with e = 0.5, and slides until it rolls."""
    return sphere(
        folder,
        mu=0.05,
        velocity=(1, 0, -1),
        spin=(0, -0.5, 0),
        step=0.04,
        duration=8.0,
        restitution=0.5,
        impact={"rest_interval_s": interval},
    )


@pytest.mark.parametrize(
    ("interval", "impacts", "entry"),
    [
        (1e-2, 8, 1.984375),
        pytest.param(1e-3, 11, 1.998046875, marks=pytest.mark.long),
        pytest.param(1e-4, 15, 1.9998779296875, marks=pytest.mark.long),
    ],
)
def test_a_thrown_sphere_ends_up_rolling(tmp_path, interval, impacts, entry):
    """The speed is 5/7 v0 + 2/7 R w0 however often it bounces."""
    run = proved(ffsm_mj.run(thrown(tmp_path, interval)))
    assert len(run.impacts) == impacts
    assert run.impacts[-1].time_s == pytest.approx(entry, abs=1e-9)
    assert all(impact.energy_change_J < 0.0 for impact in run.impacts)
    speed = 5 / 7 - 2 / 7 * 0.5
    np.testing.assert_allclose(final(run, "v_robot_free"), [speed, 0, 0, 0, speed, 0], atol=1e-10)
    assert final(run, "q_robot_free_x")[0] == pytest.approx(6.004591836735, abs=1e-9)
    assert sticks(run) == [pytest.approx(53 / 7, abs=1e-7)]


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_a_block_that_lands_flat_slides_to_rest(tmp_path, restitution):
    """On four corners at once, bouncing or not: friction takes mu times the normal impulse, which gravity and fall give."""
    path = block(
        tmp_path,
        mu=0.1,
        velocity=(1.0, 0.0, -0.5),
        step=0.05,
        duration=2.5,
        restitution=restitution,
        impact={"rest_interval_s": 1e-2},
    )
    run = proved(ffsm_mj.run(path))
    # Impacts give 0.5 (1 + e) (1 + e + e^2 ...) N s and flights nothing, rest 1 N: in all 1 N times the time and 0.5 N s.
    assert final(run, "v_robot_free")[0] == pytest.approx(1.0 - 0.1 * (0.5 + 2.5), abs=1e-10)
