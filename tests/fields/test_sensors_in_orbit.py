"""Sensors in orbit: accelerometers and force sensors in free fall against closed forms."""

from __future__ import annotations

import numpy as np

import ffsm_mj
from tests.fields.fields import FIELDS_OF_TESTS
from tests.fields.test_orbit import LEO, RATE, failing, hill_start
from tests.scenes import HEAD, ball, scene

MOMENTS = np.array((100.0, 400.0, 430.0))
LEVER = np.array((0.3, 0.2, -0.1))
SPIN = np.array((0.01, -0.02, 0.015))
CHILD = 2.0
"""Mass of a sphere on the body, kg; its centre is at LEVER."""


def satellite(sensors: str, child: str = "") -> str:
    """A body of 100 kg whose frame is at its mass centre, with sites there and at LEVER."""
    place = " ".join(map(str, LEVER))
    return f"""<mujoco>{HEAD}<worldbody><body name="hub"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="100" diaginertia="{" ".join(map(str, MOMENTS))}"/>
      <site name="centre"/><site name="side" pos="{place}" euler="20 -30 40"/>{child}</body></worldbody>
      <sensor>{sensors}</sensor></mujoco>"""


def in_orbit(folder, robot, *, position=(10.0, 0.0, 0.0), spin=(0.0, 0.0, 0.0), **keys):
    """The robot alone in orbit, at rest in LVLH but for its spin; steps of 0.5 s, 2 s in all."""
    keys = {"environment": {"orbit": LEO}} | keys
    q, v = hill_start(position)
    initial = {"joints": {"free": [*map(float, q)]}, "rates": {"free": [*map(float, v[:3]), *map(float, spin)]}}
    steps = {"time_step_s": 0.5, "control_period_s": 0.5, "duration_s": 2.0}
    return ffsm_mj.run(scene(folder, robot, {}, initial=initial, **steps | keys), fields=FIELDS_OF_TESTS)


def shown(run, sensor, row=-1):
    return np.array([run[f"sensor.robot_{sensor}_{axis}"][row] for axis in ("x_m_s2", "y_m_s2", "z_m_s2")])


def turn(quaternion):
    w, *v = quaternion
    cross = np.cross(np.eye(3), v)
    return np.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross


def attitude(run, row):
    return turn([run[f"state.q_robot_free_q{part}"][row] for part in "wxyz"])


def gradient(time_s):
    """Gradient of the tide at the origin in world axes: that of a point mass, to first order."""
    u = np.array((np.cos(RATE * time_s), np.sin(RATE * time_s), 0.0))
    return RATE**2 * (3.0 * np.outer(u, u) - np.eye(3)), u


def test_a_free_ball_feels_nothing(tmp_path):
    # The tide is 3 n^2 10 m = 3.8e-5 m/s^2 there; its rounding is 1e-20. One sample in three is inside a step.
    robot = ball(mass=3.0).replace("</mujoco>", '<sensor><accelerometer name="acc" site="centre"/></sensor></mujoco>')
    run = in_orbit(tmp_path, robot, sensors={"acc": {"interval_s": 0.75}})
    assert run["orbit.R_x_m"][0] > 6e6
    assert not failing(run)
    for row in range(len(run.time)):
        assert np.abs(shown(run, "acc", row)).max() < 1e-18


def test_away_from_the_mass_centre(tmp_path):
    """It feels alpha x s + w x (w x s) - G s, with alpha of Euler's equations and the gravity gradient.

    The gradient is linear here: the rest is 3 n^2 |r| |s| / R = 2e-12 m/s^2; the tide on the body 3.8e-5, G s 8e-7.
    """
    sensors = '<accelerometer name="acc" site="side"/><framequat name="q" objtype="site" objname="side"/>'
    run = in_orbit(tmp_path, satellite(sensors), spin=SPIN, sensors={"acc": {"interval_s": 0.75}})
    assert not failing(run)
    compared = 0
    for row in range(1, len(run.time)):
        time_s = run["sensor.robot_acc_sampled_s"][row]
        at = [k for k, time in enumerate(run.time) if time == time_s]
        if not at:
            continue
        R = attitude(run, at[0])
        w = np.array([run[f"state.v_robot_free_w{axis}_rad_s"][at[0]] for axis in "xyz"])
        G, u = gradient(time_s)
        d = R.T @ u
        alpha = (3.0 * RATE**2 * np.cross(d, MOMENTS * d) - np.cross(w, MOMENTS * w)) / MOMENTS
        felt = np.cross(alpha, LEVER) + np.cross(w, np.cross(w, LEVER)) - R.T @ G @ R @ LEVER
        assert np.linalg.norm(R.T @ G @ R @ LEVER) > 3e-7
        site = R.T @ turn([run[f"sensor.robot_q_{part}"][at[0]] for part in "wxyz"])
        np.testing.assert_allclose(site @ shown(run, "acc", row), felt, rtol=0.0, atol=3e-12)
        compared += 1
    assert compared >= 2


def test_gravitation_is_not_felt_and_drag_is(tmp_path):
    fall = {"kind": "uniform", "acceleration_m_s2": [0.3, -0.2, 0.1]}
    drag = {"kind": "drag_constant", "coefficient_kg_s": 0.6, "wind_m_s": [5.0, 0.0, 0.0]}
    robot = ball(mass=3.0).replace("</mujoco>", '<sensor><accelerometer name="acc" site="centre"/></sensor></mujoco>')
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    falling = in_orbit(tmp_path / "a", robot, environment={"orbit": LEO, "fields": [fall]})
    assert np.abs(shown(falling, "acc")).max() < 1e-16
    braked = in_orbit(tmp_path / "b", robot, environment={"fields": [fall, drag]})
    v = np.array([braked[f"state.v_robot_free_v{axis}_m_s"][-1] for axis in "xyz"])
    np.testing.assert_allclose(shown(braked, "acc"), 0.2 * ((5.0, 0.0, 0.0) - v), rtol=1e-13)


def test_a_force_sensor_knows_the_field(tmp_path):
    """A sphere welded to the body at s is held by m (a - g(r + s)): its share of the gradient and of the turning.

    Of a sphere the gradient is no force of second order and no torque. The tide on it is 7.7e-5 N, which is not felt.
    """
    place = " ".join(map(str, LEVER))
    child = f"""<body name="ball" pos="{place}"><site name="wrist"/>
      <geom type="sphere" size=".01" mass="{CHILD}"/></body>"""
    run = in_orbit(tmp_path, satellite('<force name="load" site="wrist"/><torque name="twist" site="wrist"/>', child))
    assert not failing(run)
    G, u = gradient(0.0)
    ball_moment = 0.4 * CHILD * 0.01**2
    centre = CHILD / (100.0 + CHILD) * LEVER
    s, c = LEVER - centre, -centre
    inertia = np.diag(MOMENTS) + ball_moment * np.eye(3)
    for mass, x in ((100.0, c), (CHILD, s)):
        inertia += mass * (x @ x * np.eye(3) - np.outer(x, x))
    alpha = np.linalg.solve(inertia, 3.0 * RATE**2 * np.cross(u, inertia @ u))
    force = np.array([run[f"sensor.robot_load_{axis}_N"][0] for axis in "xyz"])
    # At t = 0 the body's axes are the world's. 3 n^2 |r| |s| m / R = 4e-12 N is left out.
    np.testing.assert_allclose(force, CHILD * (np.cross(alpha, s) - G @ s), rtol=0.0, atol=8e-12)
    torque = np.array([run[f"sensor.robot_twist_{axis}_N_m"][0] for axis in "xyz"])
    np.testing.assert_allclose(torque, ball_moment * alpha, rtol=0.0, atol=1e-15)
