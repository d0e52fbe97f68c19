"""Sliding along a line, rolling and sticking against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

import ffsm_mj
from tests.contact_models.persistent.friction.reading import at, final, heat, slips, sticks
from tests.contact_models.persistent.friction.scenes import block, load, loaded, on_slab, sphere, steps
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


@pytest.mark.parametrize(("mu", "slides"), [(0.99, True), (1.01, False)])
def test_a_probe_pressed_on_a_face_at_45_degrees(tmp_path, mu, slides):
    """It slides along the face if and only if mu < tan 45: at (1 - mu) / sqrt 2 of its force."""
    face = f"""<mujoco>{HEAD}<worldbody><geom name="slab" type="box" size="2 2 0.5" euler="0 45 0"
      pos="{-0.5 * math.sin(math.pi / 4)} 0 {-0.5 * math.cos(math.pi / 4)}"/></worldbody></mujoco>"""
    path = scene(
        tmp_path,
        ball("probe", mass=2.0, joints="xz"),
        {"slab": face},
        fixed={"slab": {}},
        initial={"joints": {"robot/x": 0.1 * math.sin(math.pi / 4), "robot/z": 0.1 * math.cos(math.pi / 4)}},
        contacts={"rules": [{"between": ["probe", "slab/slab"], "restitution": 0.0, "mu": mu}]},
        contact_models=loaded(load("robot/probe", force_N=[[0, 0, -2]])),
        **steps(4e-3, 0.4),
    )
    run = proved(ffsm_mj.run(path))
    speed = (1.0 - mu) / math.sqrt(2) * 0.4 if slides else 0.0
    down = speed / math.sqrt(2)
    assert [*final(run, "v_robot_x"), *final(run, "v_robot_z")] == pytest.approx([down, -down], abs=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("pull", [0.0, 5.0, 3.0])
def test_a_sliding_block(tmp_path, pull):
    """10 N of weight, mu 0.4: pulled with 5 N it gains 1 m/s^2, with 3 N it loses 1 m/s^2 and stays at rest once it is."""
    path = block(
        tmp_path,
        mu=0.4,
        velocity=(0.5, 0.0, 0.0),
        weight=10.0,
        step=0.01,
        duration=0.6,
        loads=[load("robot/box", force_N=[[pull, 0, 0]], at_m=[0, 0, -0.05])],
    )
    run = proved(ffsm_mj.run(path))
    gain = pull - 4.0
    time = 0.6 if gain > 0.0 else min(0.6, 0.5 / -gain)
    assert final(run, "v_robot_free_vx")[0] == pytest.approx(0.5 + gain * time, abs=1e-12)
    assert final(run, "q_robot_free_x")[0] == pytest.approx(0.5 * time + 0.5 * gain * time**2, abs=1e-12)
    assert heat(run) == pytest.approx(4.0 * (0.5 * time + 0.5 * gain * time**2), abs=1e-12)
    assert sticks(run) == ([] if gain > 0.0 else [pytest.approx(time, abs=2e-9)])


@pytest.mark.parametrize(("slope", "sticks_there"), [(0.29, True), (0.31, False)])
def test_a_block_on_a_slope(tmp_path, slope, sticks_there):
    """A side load of a share of the weight, at the foot: it rests for less than mu = 0.3."""
    path = block(
        tmp_path,
        mu=0.3,
        velocity=(0.0, 0.0, 0.0),
        weight=10.0,
        step=0.01,
        duration=0.3,
        loads=[load("robot/box", force_N=[[10 * slope * 0.6, 10 * slope * 0.8, 0]], at_m=[0, 0, -0.05])],
    )
    run = proved(ffsm_mj.run(path))
    speed = 0.0 if sticks_there else 10 * (slope - 0.3) * 0.3
    np.testing.assert_allclose(final(run, "v_robot_free")[:2], [0.6 * speed, 0.8 * speed], atol=1e-11)


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
