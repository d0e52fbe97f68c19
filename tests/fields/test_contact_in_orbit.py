"""Bodies that touch in orbit: a contact that the tide closes and opens again, and collisions seen from another origin."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import ffsm_mj
from tests.fields.test_orbit import EYE, LEO, RATE, failing, hill_start
from tests.scenes import ball, scene

A, B = ball(mass=200.0, radius=0.5), ball("ball", mass=20.0, radius=0.5)


def test_two_balls_that_touch_on_the_v_bar(tmp_path):
    # At rest in axes that do not rotate, the tide presses them together until the radius has turned towards them. Without
    # friction they are a rod of 1 m that turns by phi, psi from the radius: phi'' = -3/2 n^2 sin 2 psi, and the load of the
    # contact is -m d (phi'^2 + n^2 (3 cos^2 psi - 1)) with the reduced mass m.
    def turning(t, phi):
        return phi[1], -1.5 * RATE**2 * np.sin(2.0 * (phi[0] - RATE * t))

    def load(t, phi):
        return -200.0 / 11.0 * (phi[1] ** 2 + RATE**2 * (3.0 * np.cos(phi[0] - RATE * t) ** 2 - 1.0))

    load.terminal = True
    rod = solve_ivp(
        turning, (0.0, 600.0), (0.5 * np.pi, 0.0), method="DOP853", rtol=1e-12, atol=1e-15, events=load, dense_output=True
    )
    assert rod.t_events[0][0] == pytest.approx(445.8367, abs=1e-3)  # the note
    keys = {
        "environment": {"orbit": LEO},
        "duration_s": 450.0,
        "time_step_s": 1.0,
        "control_period_s": 1.0,
        "initial": {"joints": {"ball/free": [0, 1.0, 0, *EYE]}},
        "contacts": {"rules": [{"between": ["robot/ball", "ball/ball"], "restitution": 0.4}]},
    }
    run = ffsm_mj.run(scene(tmp_path, A, {"ball": B}, **keys))
    assert not failing(run)
    assert not len(run.impacts)
    force = run["contact.robot_ball_ball_ball_force_N"]
    assert force[0] == pytest.approx(200.0 / 11.0 * RATE**2, rel=1e-9)
    rows = run.time < 445.5
    expected = [load(t, rod.sol(t)) for t in run.time[rows]]
    # The rod knows the linear tide alone: the next term is d / R = 1.5e-7 of it, and the force passes through zero.
    np.testing.assert_allclose(force[rows], expected, rtol=0.0, atol=1e-6 * force[0])
    # The opening is late by the 1e-11 m/s^2 from which on an acceleration counts, over the jerk of 7e-9 m/s^3: 1.5 ms.
    assert np.all(force[rows] > 0.0)
    assert not np.any(force[run.time > 446.0])
    gap = run["contact.robot_ball_ball_ball_gap_m"]
    jerk = 6.8e-9
    # The gap grows as jerk t^3 / 6 from the opening on.
    assert gap[-1] == pytest.approx(jerk * (450.0 - rod.t_events[0][0]) ** 3 / 6.0, rel=0.05)


def seen_from(origin_m, position, rate):
    """Hill coordinates and world rates of a body from an origin that is ahead by an arc on the same circular orbit.

    Args:
        origin_m: Length of the arc.
        position: World position from the first origin.
        rate: World velocity.
    """
    R = 6778137.0
    angle = origin_m / R
    turn = np.array(((np.cos(angle), np.sin(angle), 0), (-np.sin(angle), np.cos(angle), 0), (0, 0, 1)))
    # cos - 1 as -2 sin^2 (angle / 2): the difference would lose the digits that count.
    lift = -2.0 * np.sin(0.5 * angle) ** 2
    there = turn @ position + R * np.array((lift, -np.sin(angle), 0.0))
    return there, turn @ rate + RATE * R * np.array((np.sin(angle), lift, 0.0)), turn


def test_a_collision_seen_from_another_origin(tmp_path):
    # The note: positions relative to each other move by 2e-11 m, the time of the impact by 7e-11 s for an origin 1 km away,
    # which is the rounding of coordinates of 1 km, 1e-13 m, over 200 s of an unstable motion.
    (q, v), runs = hill_start((-0.3, 3.0, 0.1), (0.0, -0.02, 0.0)), []
    for origin_m in (0.0, 1000.0):
        folder = tmp_path / str(origin_m)
        folder.mkdir()
        joints, rates = {}, {}
        for name, place, rate in (("robot/free", np.zeros(3), np.zeros(3)), ("ball/free", np.array(q[:3]), np.array(v[:3]))):
            there, moving, turn = seen_from(origin_m, place, rate)
            joints[name], rates[name] = [*there.tolist(), *EYE], [*moving.tolist(), 0, 0, 0]
        keys = {
            "environment": {"orbit": LEO},
            "duration_s": 200.0,
            "time_step_s": 0.5,
            "control_period_s": 0.5,
            "initial": {"joints": joints, "rates": rates},
            "contacts": {"rules": [{"between": ["robot/ball", "ball/ball"], "restitution": 0.4, "mu": 0.3}]},
        }
        run = ffsm_mj.run(scene(folder, A, {"ball": B}, **keys))
        assert not failing(run)
        assert len(run.impacts) == 1
        ends = [np.array([run[f"state.q_{name}_free_{axis}_m"][-1] for axis in "xyz"]) for name in ("robot", "ball")]
        runs.append((run.impacts[0].time_s, turn.T @ (ends[1] - ends[0])))
    (here_s, here), (away_s, away) = runs
    assert away_s == pytest.approx(here_s, abs=1e-9)
    np.testing.assert_allclose(away, here, rtol=0.0, atol=2e-10)
    assert np.linalg.norm(here - np.array(q[:3])) > 1.0
