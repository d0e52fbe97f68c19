"""Sensors in orbit against closed forms: accelerometers and force sensors in free fall, stars, nadir, magnetic field."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj._core.magnetic import earth_rotation_angle
from ffsm_mj.errors import InputError
from ffsm_mj.fields.config import DipoleConfig, OrbitConfig
from ffsm_mj.fields.orbit import Orbit, magnetic_field_of
from tests.fields.fields import FIELDS_OF_TESTS
from tests.fields.test_orbit import LEO, RATE, failing, hill_start
from tests.scenes import HEAD, ball, scene
from tests.verification.independent.scenes import changed, independent

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


EPOCH = "2027-03-01T12:00:00Z"
PLACED = {**LEO, "inclination_deg": 97.0, "raan_deg": 40.0, "argument_of_latitude_deg": 25.0}
DIPOLE = {"orbit": PLACED, "epoch": EPOCH, "magnetic_field": {"kind": "dipole"}}
SENSORS = {
    "stars": {"kind": "startracker", "of": "side", "axes": "eci", "interval_s": 0.75},
    "stars_world": {"kind": "startracker", "of": "side", "interval_s": 0.75},
    "nadir": {"kind": "horizon", "of": "side", "interval_s": 0.75},
    "field": {"kind": "magnetometer", "of": "side", "interval_s": 0.75},
    "site": {"kind": "framequat", "of": "side", "interval_s": 0.75},
    "place": {"kind": "framepos", "of": "side", "interval_s": 0.75},
}


def read(run, sensor, parts, row=-1, ending=""):
    return np.array([run[f"sensor.{sensor}_{part}{ending}"][row] for part in parts])


def igrf_dipole(eci_m, days):
    """Degree 1 of IGRF-14 at 2025.0 by the gradient of its potential in spherical coordinates of the Earth, ECI, T.

    The angle is that of the IERS Conventions (2010), eq. 5.15, in whole and broken days.
    """
    turned = 2.0 * np.pi * ((0.7790572732640 + 1.00273781191135448 * days) % 1.0)
    x, y, z = eci_m
    r, theta, phi = np.linalg.norm(eci_m), np.arccos(z / np.linalg.norm(eci_m)), np.arctan2(y, x) - turned
    g10, g11, h11 = -29350e-9, -1410.3e-9, 4545.5e-9
    cubed = (6371.2e3 / r) ** 3
    across = g11 * np.cos(phi) + h11 * np.sin(phi)
    B = cubed * np.array(
        (
            2.0 * (g10 * np.cos(theta) + across * np.sin(theta)),
            g10 * np.sin(theta) - across * np.cos(theta),
            g11 * np.sin(phi) - h11 * np.cos(phi),
        )
    )
    (s, c), (sp, cp) = (np.sin(theta), np.cos(theta)), (np.sin(phi + turned), np.cos(phi + turned))
    return B @ np.array(((s * cp, s * sp, c), (c * cp, c * sp, -s), (-sp, cp, 0.0)))


def elements(argument):
    """Position in ECI at an argument of latitude of the orbit PLACED, and its Hill axes as columns."""
    node, tilt = np.radians(40.0), np.radians(97.0)
    ascending = np.array((np.cos(node), np.sin(node), 0.0))
    normal = np.array((np.sin(node) * np.sin(tilt), -np.cos(node) * np.sin(tilt), np.cos(tilt)))
    up = np.cos(argument) * ascending + np.sin(argument) * np.cross(normal, ascending)
    return (6378137.0 + 400e3) * up, np.column_stack((up, np.cross(normal, up), normal))


def test_the_earth_has_turned():
    # ERA of pyerfa 2.0.1.5 (eraEra00 of IAU SOFA) for 2027-03-01 12:00 and 2025-01-01 0:00; 2 pi 2e-16 times 1e4 days.
    assert earth_rotation_angle(9921.0) == pytest.approx(5.9117814849679675, abs=2e-11)
    assert earth_rotation_angle(9131.5) == pytest.approx(1.7554386710824161, abs=2e-11)


def test_stars_nadir_and_magnetic_field(tmp_path):
    """Against orbital elements in ECI; the world axes are Hill's at t = 0, the sensors off the centre and turned."""
    run = in_orbit(tmp_path, satellite(""), environment=DIPOLE, sensors=SENSORS, spin=SPIN, duration_s=3.0)
    assert not failing(run)
    argument, (_, hill) = np.radians(25.0), elements(np.radians(25.0))
    for row in (2, -1):
        time_s = run["sensor.nadir_sampled_s"][row]
        assert time_s == (0.75 if row == 2 else 3.0)
        site, place = turn(read(run, "site", "wxyz", row)), read(run, "place", "xyz", row, "_m")
        R, _ = elements(argument + RATE * time_s)
        place = R + hill @ place
        attitude = turn(read(run, "stars", "wxyz", row))
        np.testing.assert_allclose(attitude, hill @ site, atol=1e-14)
        np.testing.assert_allclose(turn(read(run, "stars_world", "wxyz", row)), site, atol=1e-15)
        np.testing.assert_allclose(
            read(run, "nadir", "xyz", row), -attitude.T @ place / np.linalg.norm(place), rtol=0.0, atol=1e-14
        )
        field = igrf_dipole(place, 9921.0 + time_s / 86400.0)
        assert 1e-5 < np.linalg.norm(field) < 6e-5
        # The angle of the Earth has an error of 1e-11 rad, 5e-16 T.
        np.testing.assert_allclose(read(run, "field", "xyz", row, "_T"), attitude.T @ field, rtol=0.0, atol=1e-15)


def test_their_errors(tmp_path):
    """A star tracker is five times worse about its boresight, the axis z of its site; the others have bias and noise."""
    sensors = {
        "stars": {**SENSORS["stars"], "interval_s": 0.005, "noise": [2e-4, 2e-4, 1e-3]},
        "nadir": {**SENSORS["nadir"], "interval_s": 0.005, "bias": [1e-3, 0.0, 0.0]},
        "field": {**SENSORS["field"], "interval_s": 0.005, "noise": [1e-7, 2e-7, 0.0], "bias": [0.0, 0.0, 3e-7]},
    }
    steps = {"time_step_s": 0.005, "control_period_s": 0.005, "duration_s": 2.0}
    run = in_orbit(tmp_path, satellite(""), environment=DIPOLE, sensors=sensors, **steps)
    checks = independent(run)
    assert checks["sensor noise"].passes
    assert checks["sensor values"].passes
    for key, error in (("nadir_true_x", 1e-8), ("field_true_x_T", 1e-8), ("stars_true_w", 1e-8)):
        other = independent(changed(run, f"sensor.{key}", lambda x, error=error: x + error))
        assert not other["sensor values"].passes, key
    rows = range(400)
    measured, true = ([turn(read(run, "stars" + kind, "wxyz", row)) for row in rows] for kind in ("", "_true"))
    turns = np.array(
        [(M := T.T @ Q)[[2, 0, 1], [1, 2, 0]] - M[[1, 2, 0], [2, 0, 1]] for Q, T in zip(measured, true, strict=True)]
    )
    # 400 samples: the standard deviation of a deviation is 1 / sqrt(800) = 3.5 %.
    np.testing.assert_allclose(turns.std(axis=0) / 2.0, (2e-4, 2e-4, 1e-3), rtol=0.15)
    v, u = read(run, "nadir", "xyz"), read(run, "nadir_true", "xyz")
    np.testing.assert_allclose(np.linalg.norm(v), 1.0, rtol=1e-15)
    np.testing.assert_allclose(v - u, np.cross((1e-3, 0, 0), u), atol=6e-7)  # half of the angle squared
    away = np.array([read(run, "field", "xyz", k, "_T") - read(run, "field_true", "xyz", k, "_T") for k in rows])
    np.testing.assert_allclose(away.std(axis=0), (1e-7, 2e-7, 0.0), rtol=0.15, atol=1e-20)
    np.testing.assert_allclose(away[:, 2], 3e-7, rtol=1e-9)


@pytest.mark.parametrize("world_axes", ["hill", "lvlh", "eci"])
def test_the_dipole_is_the_same_in_all_world_axes(world_axes):
    orbit, beside = Orbit.of(OrbitConfig(**PLACED), world_axes), np.array((3.0, 40.0, -5.0))
    field = magnetic_field_of(DipoleConfig(kind="dipole"), orbit, EPOCH).at(700.0, orbit.axes.T @ beside)
    place, _ = elements(np.radians(25.0) + RATE * 700.0)
    days = 9921.0 + 700.0 / 86400.0
    np.testing.assert_allclose(orbit.axes @ field, igrf_dipole(place + beside, days), rtol=0.0, atol=1e-15)


OWN = {
    "stars": {"kind": "startracker", "of": "side", "axes": "eci", "interval_s": 0.5},
    "place": {"kind": "framepos", "of": "hub", "interval_s": 0.5},
    "gyro": {"kind": "gyro", "of": "side", "interval_s": 0.5},
    "speed": {"kind": "framelinvel", "of": "hub", "interval_s": 0.5},
}


def test_an_estimate_from_stars_is_the_true_attitude(tmp_path):
    """Without errors: `direct` has the state to rounding of 10 m and of the turns between axes."""
    keys = {"environment": {"orbit": PLACED}, "sensors": OWN, "estimator": {"kind": "direct"}, "spin": SPIN}
    run = in_orbit(tmp_path, satellite(""), **keys)
    errors = [key for key in run.keys if key.startswith("estimate.error_")]
    assert len(errors) == 12
    for key in errors:
        np.testing.assert_allclose(run[key], 0.0, atol=1e-14, err_msg=key)


def test_a_filter_with_a_star_tracker_in_orbit(tmp_path):
    """Errors of `mekf` after 60 s are as large as it says: all 12 within 4 deviations, beyond which one of 16 000 is."""
    noise = {"stars": [2e-5, 2e-5, 2e-4], "place": 1e-3, "gyro": 1e-5, "speed": 1e-4}
    sensors = {name: keys | {"noise": noise[name]} for name, keys in OWN.items()}
    still = {"acceleration_density": 1e-8, "angular_acceleration_density": 1e-8}
    estimator = {"kind": "mekf", "process": still}
    keys = {"environment": {"orbit": PLACED}, "spin": SPIN / 10.0, "seed": 3, "duration_s": 60.0}
    run = in_orbit(tmp_path, satellite(""), sensors=sensors, estimator=estimator, **keys)
    for key in [key for key in run.keys if key.startswith("estimate.error_")]:
        assert abs(run[key][-1]) < 4.0 * run[key.replace("error", "sigma")][-1], key
    turned = [run[f"estimate.error_q_robot_free_turn_{axis}_rad"][-1] for axis in "xyz"]
    assert np.linalg.norm(turned) < 1e-4


def test_a_uniform_magnetic_field_needs_no_orbit(tmp_path):
    field = {"kind": "uniform", "field_T": [1e-5, 2e-5, -3e-5]}
    sensors = {name: SENSORS[name] for name in ("field", "site", "stars_world")}
    run = in_orbit(tmp_path, satellite(""), environment={"magnetic_field": field}, sensors=sensors, spin=SPIN)
    site = turn(read(run, "site", "wxyz"))
    np.testing.assert_allclose(read(run, "field", "xyz", -1, "_T"), site.T @ (1e-5, 2e-5, -3e-5), atol=1e-20)
    np.testing.assert_array_equal(read(run, "stars_world", "wxyz"), read(run, "site", "wxyz"))


@pytest.mark.parametrize(
    ("environment", "sensors", "fault"),
    [
        (None, {"s": {"kind": "horizon", "of": "side"}}, r"sensors\.s\.kind: a horizon sensor needs 'environment\.orbit'"),
        (None, {"s": {"kind": "magnetometer", "of": "side"}}, r"sensors\.s\.kind: a magnetometer needs"),
        (None, {"s": {**SENSORS["stars"]}}, r"sensors\.s\.axes: eci are axes of a central body"),
        ({"orbit": LEO}, {"s": {**SENSORS["stars"]}}, r"inclination_deg: is needed with the axes eci of a star"),
        (None, {"s": {"kind": "gyro", "of": "side", "axes": "eci"}}, r"sensors\.s: 'axes' are those in which"),
        ({"orbit": LEO}, {"s": {"kind": "horizon", "of": "hub"}}, r"sensors\.s\.of: unknown site 'hub'"),
        (None, {"s": {**SENSORS["stars_world"], "noise": [1e-4, 1e-4]}}, r"sensors\.s\.noise: has 2 numbers"),
        (None, {"s": {**SENSORS["stars_world"], "noise": [1e-4, -1e-4, 0.0]}}, r"sensors\.s\.noise"),
        ({"magnetic_field": {"kind": "dipole"}}, {}, r"magnetic_field\.kind: the dipole of the Earth needs"),
        ({**DIPOLE, "epoch": None}, {}, r"magnetic_field\.kind: the dipole turns with the Earth: it needs"),
        ({**DIPOLE, "orbit": {"altitude_km": 400.0, "body": "mars"}}, {}, r"kind: the dipole is that of the Earth"),
        ({**DIPOLE, "orbit": LEO}, {}, r"orbit\.raan_deg: is needed with magnetic_field: \{kind: dipole\}"),
        ({"magnetic_field": {"kind": "uniform", "field_T": [0.0, float("nan"), 0.0]}}, {}, r"magnetic_field\.field_T"),
        ({"magnetic_field": {"kind": "uniform"}}, {}, r"magnetic_field\.field_T: is missing"),
        ({"magnetic_field": {"kind": "igrf"}}, {}, r"magnetic_field\.kind: .*dipole"),
    ],
)  # fmt: skip
def test_faults(tmp_path, environment, sensors, fault):
    keys = {} if environment is None else {"environment": environment}
    with pytest.raises(InputError, match=r"scene\.yaml:1:\d+: .*" + fault):
        ffsm_mj.run(scene(tmp_path, satellite(""), {}, sensors=sensors, **keys))
