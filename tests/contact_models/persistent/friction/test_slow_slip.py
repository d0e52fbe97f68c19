"""Slips that begin in a wrong direction, as an impact leaves them: friction turns them within a layer of |u| m / (mu N).

A foot of 1 kg under 10 N and a force B, mu 0.3: with a = 3 / B and the angle psi from B to u, |u| = r,

    r (a + cos psi) - B (1 - a^2) t   is constant, and r ~ tan(psi / 2)^a / sin psi
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.replay import replay_log
from tests.contact.unions.scenes import fixed, free, geoms, on
from tests.contact_models.persistent.friction.scenes import block, final, load, pulled, sphere, sticks
from tests.replays import proved

PSI = 2.5


def foot(folder, B, speed, *, step, duration, turned=0.0):
    """The foot, with its velocity at PSI from the force; all turned about the vertical by an angle in rad."""
    force = B * np.array((math.cos(turned), math.sin(turned)))
    u = speed * np.array((math.cos(turned + PSI), math.sin(turned + PSI)))
    return pulled(folder, step, [[*force, 0.0]], mu=0.3, weight=10.0, duration=duration, velocity=u.tolist())


@pytest.mark.long
@pytest.mark.parametrize("turned", [0.0, 0.7])
@pytest.mark.parametrize("step", [1e-3, 1e-4])
@pytest.mark.parametrize(
    ("B", "speed", "along", "across", "error"),
    [
        (10 / 3, 1e-8, 3.33333853630094e-4, 0.0, 2e-13),
        (6.0, 1e-8, 2.9999979923759e-3, 1.9835e-15, 2e-14),
        (10 / 3, 1e-4, 3.38536300936126e-4, None, 1.5e-12),
    ],
)
def test_a_slip_turns_to_the_force(tmp_path, B, speed, along, across, error, step, turned):
    """Errors of 1e-12 m/s by the rule of steps, damped since; three times those of 1 ms are allowed."""
    run = proved(ffsm_mj.run(foot(tmp_path, B, speed, step=step, duration=1e-3, turned=turned)))
    velocity = np.array([*final(run, "v_robot_x"), *final(run, "v_robot_y")])
    c, s = math.cos(turned), math.sin(turned)
    assert velocity @ (c, s) == pytest.approx(along, abs=3 * error)
    if across is not None:
        assert velocity @ (-s, c) == pytest.approx(across, abs=3 * error)


def test_a_slip_that_turns_stops(tmp_path):
    """Where r = 0: after r0 (a + cos psi) / (B (a^2 - 1)) = 2.795e-4 s."""
    run = proved(ffsm_mj.run(foot(tmp_path, 2.0, 1e-3, step=1e-3, duration=1e-3)))
    assert sticks(run) == [pytest.approx(2.79542553781e-4, abs=4e-12)]
    assert np.abs([*final(run, "v_robot_x"), *final(run, "v_robot_y")]).max() < 1e-11


def test_an_edge_that_turns_about_one_end_stops(tmp_path):
    """A leaning box on one edge: the end that stands still stuck before the other stops, in the log replay too.

    Taken for one that slid it would, by the drift of its rate, slide on, and the replay would miss the stop.
    """
    tilt, spin, half = -0.01, -0.037, np.array((0.085, 0.065, 0.111))
    sine, cosine = math.sin(tilt), math.cos(tilt)
    turned = np.array(((1.0, 0.0, 0.0), (0.0, cosine, -sine), (0.0, sine, cosine)))
    end, rates = turned @ (half * (1, 1, -1)), np.array((-0.06, 0.0, spin))  # it falls about the edge, and spins
    run = ffsm_mj.run(
        on(
            tmp_path / "run",
            free(
                '<geom name="g" type="box" size="0.085 0.065 0.111" mass="0"/>', mass=2.3, inertia=(0.0102, 0.0097, 0.0094)
            ),
            fixed(geoms([((-1.0, -0.8, -0.1), (1.0, 0.8, 0.0))])),
            joints=[0.0, 0.0, -end[2], math.cos(tilt / 2.0), math.sin(tilt / 2.0), 0.0, 0.0],
            rates=[*np.cross(end, rates), *(turned.T @ rates)],
            mu=0.55,
            duration_s=4e-3,
        )
    )
    assert len(sticks(proved(run))) == 1
    assert replay_log(run.log).agrees
    place, spins = final(run, "q_robot"), final(run, "v_robot")[3:]
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, place[3:])
    moved = place[:3] + matrix.reshape(3, 3) @ (half * (1, 1, -1)) - (end - (0.0, 0.0, end[2]))
    # The end stays to the rounding of coordinates of 0.1 m, and then turns about the edge: a stop leaves 1e-11 rad/s.
    assert np.abs(moved).max() < 1e-14
    np.testing.assert_allclose(spins[1:], 0.0, rtol=0, atol=1e-10)
    assert spins[0] > 0.01


def test_a_ball_begins_to_slip_under_spin(tmp_path):
    """By order 8 at 3e-14 on the whole state; steps of 10 ms, of which the layer takes 3e-8 s."""
    rates = (-3.71390676e-9, 9.28476691e-9, 0.0)
    push = load("robot/ball", force_N=[[0.5, 0.2, 0.0]])
    scene = sphere(tmp_path, mu=0.1, velocity=rates, spin=(0, 0, 3), step=1e-2, duration=1e-2, loads=[push])
    velocity = final(proved(ffsm_mj.run(scene)), "v_robot_free")[:2]
    np.testing.assert_allclose(velocity, (4.0715217013e-3, 1.6286163736e-3), rtol=0, atol=2e-11)


def test_a_corner_of_a_sliding_block_that_hardly_slips(tmp_path):
    """Three corners slip at 1 m/s, one at 1e-8 m/s; by order 8 on the whole state."""
    start = (0.4 + 6e-9, -0.8 - 8e-9, 0.0)
    run = proved(ffsm_mj.run(block(tmp_path, mu=0.3, velocity=start, spin=4.0, step=4e-3, duration=4e-3)))
    found = final(run, "v_robot_free")[[0, 1, 5]]
    np.testing.assert_allclose(found, (0.39975831707643, -0.79929679214237, 3.9908078978074), rtol=0, atol=3e-12)


def test_a_foot_that_creeps_against_the_pull_begins_to_slide_once(tmp_path):
    """A drift of 5e-13 m/s is none while it sticks: at the limit, where it has no acceleration yet, it stops no slide.

    The pull passes mu N = 0.5 N at 50.3 us and grows by 1 N/s: v = (t - 50.3 us)^2 / 2 from there, which takes 1 us, a step,
    to make up for the drift. In nodes of that step at which the foot still slid backwards friction would push it on.
    """
    starts = 5.03e-5
    pull = [[0.5 - starts, 0.0, 0.0], [1.0, 0.0, 0.0]]
    run = proved(ffsm_mj.run(pulled(tmp_path, 1e-6, pull, velocity=(-5e-13, 0.0), duration=1e-4)))
    assert [len(run.records[kind]) for kind in ("contact_slips", "contact_changes")] == [1, 0]
    slides = run.time > starts
    # The start is known to rounding of the forces, 1e-16 N, over 1 N/s: the velocity to much less than that of the drift.
    assert run["state.v_robot_x_m_s"][slides] == pytest.approx(0.5 * (run.time[slides] - starts) ** 2, abs=1e-15)


@pytest.mark.long
def test_slide_and_spin_of_a_cap_end_together(tmp_path):
    """A cylinder that stands, slides and spins: all its energy is heat, its points stick at one instant, and no load rubs.

    The load goes round the rim as the slide turns: points lose and regain it, and their own slips say nothing of the scale.
    """
    mass, velocity, spin, inertia = 1.888, np.array([0.0786, 0.0272]), -0.0675, (0.00773, 0.00773, 0.00822)
    run = ffsm_mj.run(
        on(
            tmp_path / "run",
            free('<geom name="g" type="cylinder" size="0.103 0.0972" mass="0"/>', mass=mass, inertia=inertia),
            fixed(geoms([((-1.0, -0.8, -0.1), (1.0, 0.8, 0.0))])),
            joints=[0.0, 0.0, 0.0972, 0.96, 0.0, 0.0, 0.28],
            rates=[*velocity, 0.0, 0.0, 0.0, spin],
            mu=0.728,
            duration_s=0.02,
        )
    )
    proved(run)
    energy = 0.5 * (mass * velocity @ velocity + inertia[2] * spin**2)
    assert run["balance.friction_heat_J"][-1] == pytest.approx(energy, rel=1e-12)
    assert len(run.records["contact_sticks"]) == 1
    assert run["contact.hit_friction_use"][-1] == 0.0
