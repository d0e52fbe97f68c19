"""Sliding along a line, rolling and sticking against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

import ffsm_mj
from tests.contact_models.persistent.friction.scenes import (
    at,
    block,
    final,
    heat,
    load,
    loaded,
    on_slab,
    slips,
    sphere,
    steps,
    sticks,
)
from tests.replays import proved
from tests.scenes import HEAD, ball, scene

STEPS = [0.05, *(pytest.param(step, marks=pytest.mark.long) for step in (0.1, 4e-3, 2e-3, 1e-3, 5e-4))]
"""Forces are polynomials of time of degree 1 at most along lines: RK4 is exact at any step."""


@pytest.mark.parametrize("step", STEPS)
def test_a_sliding_sphere_rolls(tmp_path, step):
    """The speed falls by mu g = 0.2 m/s^2 from 0.7, the spin grows 2.5 times as fast; both meet at 1 s, where v = 5/7 v0.

    The stop is set where the slip is 1e-9 of 0.7 m/s, along the line of friction: v and place of rolling are the same.
    """
    run = proved(ffsm_mj.run(sphere(tmp_path, mu=0.2, velocity=(0.7, 0, 0), step=step, duration=1.2)))
    np.testing.assert_allclose(final(run, "v_robot_free"), [0.5, 0, 0, 0, 0.5, 0], atol=1e-12)
    assert at(run, 1.0, "q_robot_free_x")[0] == pytest.approx(0.6, abs=1e-12)
    assert final(run, "q_robot_free_x")[0] == pytest.approx(0.7, abs=1e-12)
    assert heat(run) == pytest.approx(0.07, abs=1e-12)
    assert sticks(run) == [pytest.approx(1.0, abs=2e-9)]
    assert not slips(run)


@pytest.mark.parametrize("step", [4e-3, *(pytest.param(step, marks=pytest.mark.long) for step in (2e-3, 1e-3, 5e-4))])
def test_a_rolling_sphere_that_spins_rolls_straight_on(tmp_path, step):
    """The contact point moves with the centre: with the rate of a point fixed in the body its path bends by metres."""
    run = proved(ffsm_mj.run(sphere(tmp_path, mu=5.0, velocity=(0.5, 0, 0), spin=(0, 0.5, 5), step=step, duration=0.5)))
    # Free joints have their spin in body axes; the sphere turns as a whole about one fixed axis.
    assert np.linalg.norm(final(run, "v_robot_free")[3:]) == pytest.approx(math.hypot(0.5, 5.0), abs=1e-12)
    np.testing.assert_allclose(final(run, "v_robot_free")[:3], [0.5, 0, 0], atol=1e-12)
    np.testing.assert_allclose(final(run, "q_robot_free")[:3], [0.25, 0, 1], atol=1e-12)
    assert heat(run) == 0.0


def foot_on_plate(folder, *, mu, speed, push, step, duration):
    """A plate of 3 kg and a foot of 1 kg, each on slides x and z, pressed on each other by 1 N inside."""
    plate = f"""<mujoco>{HEAD}<worldbody><body name="plate"><inertial pos="0 0 0" mass="3" diaginertia="1 1 1"/>
      <joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
      <geom name="plate" type="box" size="5 5 0.1" mass="0"/></body></worldbody></mujoco>"""
    return scene(
        folder,
        plate,
        {"foot": ball("foot", mass=1.0, joints="xz")},
        initial={"joints": {"foot/z": 0.2}, "rates": {"foot/x": speed}},
        contacts={"rules": [{"between": ["plate", "foot/foot"], "restitution": 0.0, "mu": mu}]},
        contact_models=loaded(load("foot/foot", "robot/plate", force_N=[[0, 0, -1], push])),
        **steps(step, duration),
    )


@pytest.mark.parametrize("step", STEPS)
def test_a_foot_comes_to_rest_on_a_free_plate(tmp_path, step):
    """0.8 m/s, relative deceleration 0.2 (1 + 1/3): they stick at 3 s, at the common speed of 0.8 N s / 4 kg."""
    run = proved(ffsm_mj.run(foot_on_plate(tmp_path, mu=0.2, speed=0.8, push=[0, 0, 0], step=step, duration=3.2)))
    assert sticks(run) == [pytest.approx(3.0, abs=1e-8)]
    for column in ("v_robot_x", "v_foot_x"):
        assert final(run, column)[0] == pytest.approx(0.2, abs=1e-12)
    assert heat(run) == pytest.approx(0.24, abs=1e-12)


@pytest.mark.parametrize("step", STEPS)
def test_a_foot_breaks_away_from_a_free_plate(tmp_path, step):
    """An inner force of 0.1 t: all of it is friction, until 0.5 N at 5 s; then u' = (0.1 t - 0.5) (1 + 1/3)."""
    run = proved(ffsm_mj.run(foot_on_plate(tmp_path, mu=0.5, speed=0.0, push=[0.1, 0, 0], step=step, duration=6.0)))
    assert slips(run) == [pytest.approx(5.0, abs=1e-9)]
    assert final(run, "v_foot_x")[0] - final(run, "v_robot_x")[0] == pytest.approx(1 / 15, abs=1e-12)
    assert heat(run) == pytest.approx(1 / 90, abs=1e-12)
    before = run.time < 4.99
    assert np.abs(run["state.v_foot_x_m_s"][before]).max() <= 1e-14


def test_a_block_taller_than_friction_tips(tmp_path):
    """Pushed at its top with 3 N of 10 N weight, mu 0.5: it sticks, and tips where the push has the longer arm.

    The push at height 2 c has the moment 2 c F about the front edge, the weight a W: it tips for c / a > W / (2 F).
    """
    for height, tips in ((0.16, False), (0.18, True)):
        folder = tmp_path / str(height)
        folder.mkdir()
        path = on_slab(
            folder,
            f"""<mujoco>{HEAD}<worldbody><body name="box"><freejoint name="free"/>
              <inertial pos="0 0 0" mass="1" diaginertia="0.02 0.02 0.02"/>
              <geom name="box" type="box" size="0.1 0.1 {height}" mass="0"/></body></worldbody></mujoco>""",
            geom="box",
            mu=0.5,
            weight=10.0,
            step=5e-3,
            duration=0.1,
            initial={"joints": {"robot/free": [0, 0, height, 1, 0, 0, 0]}},
            loads=[load("robot/box", force_N=[[3, 0, 0]], at_m=[0, 0, height])],
        )
        run = proved(ffsm_mj.run(path))
        assert bool(abs(final(run, "v_robot_free_wy")[0]) > 1e-3) is tips
        assert not slips(run)
        if not tips:  # 3 N of mu W = 5 N, however the load is shared; margins are known to 1e-14 of the forces
            np.testing.assert_allclose(run["contact.foot_friction_use"], 0.6, atol=1e-11)


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
