"""Control laws in LVLH axes: station keeping on the three bars, paths, attitude, and a stack that rests relative to LVLH."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.controller_protocol import LvlhAxes
from ffsm_mj.errors import InputError
from tests.controllers.detumbling import detumbled, spacecraft
from tests.fields.test_orbit import ELLIPSE, EYE, LEO, RATE
from tests.scenes import HEAD, scene

WHEELS = ["wheel_0", "wheel_1", "wheel_2"]
MASS, W = 100.0, 0.2
UNITS = {name: " ".join("1" if i == k else "0" for i in range(6)) for k, name in enumerate("xyzuvw")}
BODY = f"""<mujoco>{HEAD}<worldbody><body name="hub"><freejoint name="base"/><site name="centre"/>
  <inertial pos="0 0 0" mass="{MASS}" diaginertia="10 12 14"/></body></worldbody><actuator>{
    "".join(f'<motor name="{name}" site="centre" gear="{gear}"/>' for name, gear in UNITS.items())
}</actuator></mujoco>"""
TURN = {"kp": 14.0 * W**2, "kd": 28.0 * W}
PUSH = {"kp": MASS * W**2, "kd": 2.0 * MASS * W}


def kept(folder, place, *, orbit=LEO, translation=None, rotation=None, duration_s=100.0, **keys):
    """A run in which a body of 100 kg is kept in LVLH axes with critical damping at 0.2 rad/s, from rest at a place."""
    law = {"kind": "base_pd", "frame": "lvlh", "thrusters": [*UNITS]}
    law |= {"translation": PUSH | (translation or {}), "rotation": TURN | (rotation or {})}
    keys = {
        "environment": {"orbit": orbit},
        "initial": {"frame": "lvlh", "joints": {"base": [*place, *EYE]}},
        "phases": [{"name": "keep", "until": "end", "controller": law}],
        "time_step_s": 0.05,
        "control_period_s": 0.05,
        "duration_s": duration_s,
    } | keys
    return ffsm_mj.run(scene(folder, BODY, {}, **keys))


def place(run, row=-1):
    return np.array([run[f"orbit.robot_{axis}_m"][row] for axis in "xyz"])


@pytest.mark.parametrize(("bar", "pull"), [(0, 0.0), (1, -1.0), (2, 3.0)], ids=["V-bar", "H-bar", "R-bar"])
def test_station_keeping_takes_what_the_tide_pulls(tmp_path, bar, pull):
    # At rest in LVLH the tide and the rotation leave 3 n^2 d along the R-bar, -n^2 d along the H-bar, 0 along the V-bar.
    # The thrust against it is kp times the offset o: w^2 o = pull n^2 (d + o).
    d, expected = 10.0, np.zeros(3)
    expected[bar] = pull * RATE**2 * d / (W**2 - pull * RATE**2)
    start = d * np.eye(3)[bar]
    run = kept(tmp_path, start)
    assert all(check.passes for check in run.checks())
    # The thrust keeps its direction for a tick, in which LVLH turns by 5.7e-5 rad: 2.7e-8 m of an offset of 9.6e-4 m; of
    # the start 20 exp(-20) is left, 4e-11 m.
    np.testing.assert_allclose(place(run) - start, expected, atol=5e-8)
    thrust = MASS * W**2 * run["controller.base_position_error_m"][-1]
    assert thrust == pytest.approx(abs(pull) * RATE**2 * MASS * d, rel=1e-4, abs=1e-6)
    # It turns with LVLH; the torque of the gravity gradient leaves 3/2 n^2 2 / (10 w^2) rad at most.
    turning = np.array([run[f"orbit.robot_w{axis}_rad_s"][-1] for axis in "xyz"])
    np.testing.assert_allclose(turning, 0.0, atol=1e-7)
    assert run["controller.base_rotation_error_rad"][-1] < 1e-5


def turn_backwards(monkeypatch):
    """Give LVLH axes a rotation of the other sign."""
    right = LvlhAxes.update

    def wrong(self, time_s):
        right(self, time_s)
        self.spin = -self.spin

    monkeypatch.setattr(LvlhAxes, "update", wrong)


def test_the_other_sign_of_the_rotation_is_seen(tmp_path, monkeypatch):
    turn_backwards(monkeypatch)
    run = kept(tmp_path, (0.0, 0.0, 10.0))
    # Fed forward with the wrong sign, the rate 2 n d is an error that kd turns into an offset of 2 n d 2 w / w^2 = 0.23 m.
    assert np.abs(place(run) - (0.0, 0.0, 10.0)).max() > 0.1


def test_waypoints_and_attitude_in_lvlh(tmp_path):
    half = np.sqrt(0.5)
    points = [{"at_s": 60.0, "position_m": [-4.0, 0.0, 0.0]}, {"at_s": 120.0, "position_m": [-2.0, 0.0, 1.0]}]
    goal = {"attitude": [half, 0.0, 0.0, half]}
    run = kept(tmp_path, (-10.0, 0.0, 0.0), translation={"waypoints": points}, rotation=goal, duration_s=200.0)
    # On the way acceleration and Coriolis force are not fed forward: 5.8 * 6 / 60^2 + 2 n 0.2 over w^2, 0.25 m.
    np.testing.assert_allclose(place(run, round(60.0 / 0.05)), (-4.0, 0.0, 0.0), atol=0.25)
    np.testing.assert_allclose(place(run), (-2.0, 0.0, 1.0), atol=1.1 * 3.0 * RATE**2 / W**2)
    attitude = [run[f"orbit.robot_q{part}"][-1] for part in "wxyz"]
    np.testing.assert_allclose(attitude, (half, 0, 0, half), atol=1e-5)


def test_lvlh_set_points_need_an_orbit(tmp_path):
    with pytest.raises(InputError, match=r"frame: 'lvlh' needs 'environment.orbit'"):
        kept(tmp_path, (0.0, 0.0, 0.0), environment={}, initial={})


@pytest.mark.parametrize("frame", ["world", "lvlh"])
@pytest.mark.parametrize("orbit", [LEO, ELLIPSE], ids=["circular", "ellipse"])
def test_detumbling_to_rest_in_either_axes(tmp_path, frame, orbit):
    # What is left falls as exp(-t / 2), though the tide turns the stack by some 3/2 n^2 230 = 4e-4 N m.
    run = detumbled(
        tmp_path,
        {"wheels": WHEELS, "frame": frame, "rate_1_s": 0.5},
        robot=spacecraft(inertia=(200.0, 250.0, 430.0)),
        duration_s=50.0,
        time_step_s=0.05,
        control_period_s=0.05,
        environment={"orbit": orbit},
    )
    left = run["controller.stack_momentum_N_m_s"]
    assert left[0] > 50.0
    # Without the torque fed forward 8e-4 N m s would be left. Torques that are constant for a tick of dt turn with LVLH only
    # after it: of n h for the momentum h = 160 N m s of the wheels n^2 h dt / 2 is late, over the rate 1e-5 N m s.
    assert left[-1] < 2e-5
    turning = np.array([run[f"orbit.robot_w{axis}_rad_s"][-1] for axis in "xyz"])
    spin = np.linalg.norm(run_spin(run))
    # Momentum over the least inertia, 200 kg m^2.
    assert np.linalg.norm(turning) == pytest.approx(0.0 if frame == "lvlh" else spin, abs=1e-7)


def run_spin(run):
    """Angular velocity of LVLH at the end of a run, rad/s."""
    R = [run[f"orbit.R_{axis}_m"][-1] for axis in "xyz"]
    V = [run[f"orbit.V_{axis}_m_s"][-1] for axis in "xyz"]
    return np.cross(R, V) / np.dot(R, R)
