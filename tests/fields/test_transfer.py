"""Two-impulse transfers: Clohessy-Wiltshire, two Kepler orbits, what a straight plan misses by, thrusters with a limit."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.errors import InputError
from tests.fields.test_lvlh_laws import BODY, TURN, UNITS, place, turn_backwards
from tests.fields.test_orbit import ELLIPSE, EYE, LEO, RATE
from tests.scenes import scene

FROM, TO, DURATION_S, TICK_S = np.array((-20.0, 3.0, 4.0)), np.array((-5.0, -1.0, 1.0)), 300.0, 0.1
JETS = {axis: {"kind": "on_off", "force_N": 4.0, "threshold_N": 2.0} for axis in "xyz"}


def transferred(folder, *, orbit=LEO, duration_s=DURATION_S + 1.0, law=None, **keys):
    """A run in which a body of 100 kg at rest in LVLH is to be 18 m further after 300 s; its attitude is kept."""
    law = {"kind": "transfer", "thrusters": [*"xyz"], "position_m": TO.tolist(), "duration_s": DURATION_S} | (law or {})
    attitude = {"kind": "base_pd", "frame": "lvlh", "thrusters": [*UNITS][3:], "rotation": TURN}
    keys = {
        "environment": {"orbit": orbit},
        "initial": {"frame": "lvlh", "joints": {"base": [*FROM.tolist(), *EYE]}},
        "phases": [{"name": "all", "until": "end", "controllers": {"base": law, "attitude": attitude}}],
        "time_step_s": TICK_S,
        "control_period_s": TICK_S,
        "duration_s": duration_s,
    } | keys
    return ffsm_mj.run(scene(folder, BODY, {}, **keys))


def clohessy_wiltshire(angle):
    """Position in LVLH axes per position, and times n per velocity, at the start, (3, 3) each."""
    s, c = np.sin(angle), np.cos(angle)
    by_position = np.array(((1.0, 0.0, 6.0 * (angle - s)), (0.0, c, 0.0), (0.0, 0.0, 4.0 - 3.0 * c)))
    by_velocity = np.array(((4.0 * s - 3.0 * angle, 0.0, 2.0 * (1.0 - c)), (0.0, s, 0.0), (-2.0 * (1.0 - c), 0.0, s)))
    return by_position, by_velocity / RATE


def start_velocity():
    by_position, by_velocity = clohessy_wiltshire(RATE * DURATION_S)
    return np.linalg.solve(by_velocity, TO - by_position @ FROM)


def test_the_first_impulse_is_that_of_clohessy_and_wiltshire(tmp_path):
    run = transferred(tmp_path)
    assert all(check.passes for check in run.checks())
    # CW is the linear theory: at 20 m it is off by n 20^2 / R = 7e-8 m/s.
    wanted = start_velocity()
    assert run["controller.base_transfer_to_go_m_s"][0] == pytest.approx(np.linalg.norm(wanted), abs=1e-7)
    # An impulse takes a tick, in which the robot goes half as far as after it: it passes by the point at half a tick's way.
    way_m = np.linalg.norm(wanted) * TICK_S
    miss = run["controller.base_transfer_miss_m"][10:2990]
    assert miss[0] < 0.6 * way_m
    # The plan and the motion agree on two orbits: what is predicted does not change. Absolute positions round to 1e-9 m.
    assert np.ptp(miss) < 1e-7
    np.testing.assert_allclose(place(run), TO, atol=1.1 * way_m)
    np.testing.assert_allclose([run[f"orbit.robot_v{axis}_m_s"][-1] for axis in "xyz"], 0.0, atol=1e-5)  # a second of tide
    (report,) = (phase["reports"] for phase in run.summary()["controller"]["phases"])
    assert report["base_miss_before_braking_m"] == pytest.approx(miss[-1], rel=0.05)  # of the way of half a tick
    assert report["base_arrival_error_m"] < 1.1 * way_m


def test_an_ellipse(tmp_path):
    run = transferred(tmp_path, orbit=ELLIPSE | {"true_anomaly_deg": 70.0})
    assert np.ptp(run["controller.base_transfer_miss_m"][10:2990]) < 1e-7
    np.testing.assert_allclose(place(run), TO, atol=0.02)


def test_thrusters_with_a_limit(tmp_path):
    # 4 N on 100 kg: 2 s for each 0.08 m/s. Burns are re-planned while they last; a tick of thrust is 4e-3 m/s, a half of it
    # is no more than rounded away: 2e-3 m/s along each axis, for 300 s 1 m. Corrections would be another transfer.
    run = transferred(tmp_path, actuators=JETS, duration_s=DURATION_S + 4.0)
    miss = run["controller.base_transfer_miss_m"][200:2900]
    assert np.ptp(miss) < 1e-7
    assert miss[0] < np.sqrt(3.0) * 2e-3 * DURATION_S
    assert np.abs(place(run) - TO).max() < miss[0] + 0.1
    thrust = np.array([run[f"actuators.robot_{axis}_applied_N"] for axis in "xyz"])
    assert not thrust[:, 200:2900].any()
    assert set(np.abs(thrust).ravel()) == {0.0, 4.0}


def test_what_a_straight_plan_misses_by(tmp_path):
    # On the way to where the point would be without a field and without rotation; by CW, from the velocity in LVLH.
    by_position, by_velocity = clohessy_wiltshire(RATE * DURATION_S)
    turning = RATE * np.array((-FROM[2], 0.0, FROM[0]))  # Omega x r with Omega along -y
    there = by_position @ FROM + by_velocity @ ((TO - FROM) / DURATION_S - turning)
    run = transferred(tmp_path, law={"plan": "straight"})
    (report,) = (phase["reports"] for phase in run.summary()["controller"]["phases"])
    assert report["base_arrival_error_m"] == pytest.approx(np.linalg.norm(there - TO), abs=0.02)
    assert report["base_arrival_error_m"] > 1.0


def test_the_other_sign_of_the_rotation_is_seen(tmp_path, monkeypatch):
    turn_backwards(monkeypatch)
    run = transferred(tmp_path)
    # It comes to rest in axes that turn the other way: 2 n 5 m is left.
    assert np.linalg.norm([run[f"orbit.robot_v{axis}_m_s"][-1] for axis in "xyz"]) > 5e-3


@pytest.mark.parametrize(
    ("law", "keys", "fault"),
    [
        ({}, {"environment": {}, "initial": {}}, "transfer needs 'environment.orbit'"),
        ({"duration_s": 3000.0}, {}, r"duration_s: must be less than half a period, 2776.81 s"),
        ({"thrusters": ["w1"]}, {}, "w1"),
    ],
)
def test_what_cannot_be_flown_is_refused(tmp_path, law, keys, fault):
    with pytest.raises(InputError, match=fault):
        transferred(tmp_path, law=law, **keys)
