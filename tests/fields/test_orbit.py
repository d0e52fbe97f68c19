"""Motion in orbit against closed forms: Clohessy-Wiltshire, two Kepler orbits in extended precision, libration, Beletsky."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import ffsm_mj
from ffsm_mj._core.fields import Bodies
from ffsm_mj._core.orbit import OrbitalField
from ffsm_mj.errors import InputError
from ffsm_mj.fields.config import OrbitConfig
from ffsm_mj.fields.interface import Field, StrictModel
from ffsm_mj.fields.orbit import Orbit
from ffsm_mj.replay import replay_log
from ffsm_mj.simulation import orbit as orbit_columns
from tests.contact_models.grasp.scenes import grasping
from tests.fields.kepler import MU, relative
from tests.scenes import FLOATING_BASES, HEAD, ball, scene

LEO = {"altitude_km": 400.0}
ELLIPSE = {"kind": "elliptic", "semi_major_axis_km": 7500.0, "eccentricity": 0.1}
RATE = 1.1313666536110223e-3  # of LEO, sqrt(mu / R^3)
OFFSET = np.array((0.6, -0.7, 0.387))
EYE = [1.0, 0.0, 0.0, 0.0]


def hill_start(position, rate=(0.0, 0.0, 0.0)):
    """Position and velocity of a free joint in world axes of kind hill for those relative to Hill's rotating axes, LEO."""
    return [*position, *EYE], [*(np.array(rate) + np.cross((0, 0, RATE), position)), 0, 0, 0]


def free_run(folder, orbit, starts, *, step_s=1.0, duration_s, robot=ball(), **keys):  # noqa: B008
    """Free bodies in orbit: the robot and, if there are two starts, an object; starts are pairs of qpos and qvel."""
    folder.mkdir(exist_ok=True)
    names = ["robot/free", "ball/free"]
    initial = {"joints": {}, "rates": {}}
    for name, (q, v) in zip(names if len(starts) > 1 else ["free"], starts, strict=False):
        initial["joints"][name], initial["rates"][name] = [*map(float, q)], [*map(float, v)]
    keys = {"time_step_s": step_s, "control_period_s": step_s, "duration_s": duration_s} | keys
    environment = ({"orbit": orbit} if orbit else {}) | keys.pop("environment", {})
    objects = {"ball": ball("ball", mass=3.0)} if len(starts) > 1 else {}
    initial |= keys.pop("initial", {})
    if environment:
        keys["environment"] = environment
    return ffsm_mj.run(scene(folder, robot, objects, initial=initial, **keys))


def place(run, name="robot", row=-1):
    return np.array([run[f"state.q_{name}_free_{axis}_m"][row] for axis in "xyz"])


def failing(run):
    return [check for check in run.checks() if not check.passes]


def origin_of(orbit):
    reference = Orbit.of(OrbitConfig(**orbit), "hill").reference
    return reference.state(0.0)


@pytest.mark.parametrize("orbit", [LEO, ELLIPSE], ids=["circular", "ellipse"])
def test_two_kepler_orbits(tmp_path, orbit):
    # The note: 8.4e-9 and 4.1e-8 m at 10 and 90 m after 5500 s with steps of 4 s, 250 times less with 1 s: order 4.
    R, V = origin_of(orbit)
    spin = np.cross(R, V)[2] / (R @ R)
    starts = []
    for distance in (10.0, 90.0):
        x, y, z = distance * OFFSET
        starts.append(((x, y, z, *EYE), (0.0 - spin * y, -2.0 * spin * x + spin * x, 0.1 * distance * 1e-3, 0, 0, 0)))
    errors = []
    for step_s in (4.0, 2.0):
        run = free_run(tmp_path / f"{step_s}", orbit, starts, step_s=step_s, duration_s=5500.0)
        assert not failing(run)
        exact = [relative((R, V), q[:3], v[:3], 5500.0) for q, v in starts]
        errors.append(
            [np.linalg.norm(place(run, name) - there) for name, there in zip(("robot", "ball"), exact, strict=True)]
        )
    orders = np.log2(np.divide(*errors))
    assert np.all(np.abs(orders - 4.0) < 0.3), (errors, orders)
    assert errors[0][0] < (2e-8 if orbit is LEO else 4e-8)  # within twice the note's, whose z rate is another one
    assert errors[0][1] < (2e-7 if orbit is LEO else 4e-7)
    if orbit is LEO:
        assert "Jacobi integral" in {check.name for check in run.checks()}


def test_clohessy_wiltshire(tmp_path):
    # 2:1 ellipse of 10 m after a period: CW is the linear solution, and misses by 1.4e-4 m as the note says.
    run = free_run(tmp_path, LEO, [hill_start((10.0, 0, 0), (0, -2.0 * RATE * 10.0, 0))], step_s=2.0, duration_s=1388.0)
    angle = RATE * 1388.0
    x, y = 10.0 * np.cos(angle), -20.0 * np.sin(angle)
    in_hill = np.array((-run["orbit.robot_z_m"][-1], run["orbit.robot_x_m"][-1]))
    np.testing.assert_allclose(in_hill, (x, y), atol=1.5e-4)
    assert np.abs(in_hill - (x, y)).max() > 1e-6  # the exact tide is not the linear one


@pytest.mark.parametrize(
    ("rate", "turns", "end_m", "misses_m"),
    [
        ((25.0 * RATE, 0.0), 0.5, -100.0, 2e-2),  # radial: 4 v / n along the V-bar in half an orbit
        ((0.0, 100.0 * RATE / (6.0 * np.pi)), 1.0, -100.0, 5e-2),  # tangential: 6 pi v / n in an orbit
    ],
    ids=["radial", "tangential"],
)
def test_hops(tmp_path, rate, turns, end_m, misses_m):
    # CW, the linear solution, misses by 1.2e-2 and 2.8e-2 m; two Kepler orbits agree.
    duration_s = float(round(turns * 2.0 * np.pi / RATE))
    run = free_run(tmp_path, LEO, [hill_start((0, 0, 0), (*rate, 0))], duration_s=duration_s)
    (u, w), angle = rate, RATE * duration_s
    x = u / RATE * np.sin(angle) + 2.0 * w / RATE * (1.0 - np.cos(angle))
    y = -2.0 * u / RATE * (1.0 - np.cos(angle)) + w / RATE * (4.0 * np.sin(angle) - 3.0 * angle)
    assert y == pytest.approx(end_m, abs=0.1)
    np.testing.assert_allclose((-run["orbit.robot_z_m"][-1], run["orbit.robot_x_m"][-1]), (x, y), atol=misses_m)
    np.testing.assert_allclose(place(run), relative(origin_of(LEO), (0, 0, 0), (*rate, 0), duration_s), atol=5e-10)


def test_a_body_at_rest_on_the_v_bar_stays(tmp_path):
    run = free_run(tmp_path, LEO, [], duration_s=300.0, initial={"frame": "lvlh", "joints": {"free": [50, 0, 0, *EYE]}})
    # The V-bar is curved: at 50 m the circle is 50^2 / 2 R = 1.8e-4 m below, and n t = 0.34 of 6 pi makes some 1e-4 m of it.
    np.testing.assert_allclose([run[f"orbit.robot_{axis}_m"][-1] for axis in "xyz"], (50.0, 0, 0), atol=2e-4)
    np.testing.assert_allclose([run[f"orbit.robot_q{part}"][-1] for part in "wxyz"], EYE, atol=1e-12)


def body(moments, mass=100.0):
    return f"""<mujoco>{HEAD}<worldbody><body name="ball"><inertial pos="0 0 0" mass="{mass}"
      diaginertia="{" ".join(map(str, moments))}"/><freejoint name="free"/></body></worldbody></mujoco>"""


def pitching(folder, moments, orbit, angle, *, step_s, duration_s, spin):
    """A body whose x axis is radial but for a pitch; at rest relative to axes that turn at a rate."""
    folder.mkdir(exist_ok=True)
    initial = {
        "joints": {"free": [0, 0, 0, np.cos(0.5 * angle), 0, 0, np.sin(0.5 * angle)]},
        "rates": {"free": [0, 0, 0, 0, 0, spin]},
    }
    keys = {"time_step_s": step_s, "control_period_s": step_s, "duration_s": duration_s, "environment": {"orbit": orbit}}
    return ffsm_mj.run(scene(folder, body(moments), {}, initial=initial, **keys))


def pitch(run):
    """Angle of the body's x axis to the radius, rad, of each row."""
    turned = 2.0 * np.unwrap(np.arctan2(run["state.q_robot_free_qz"], run["state.q_robot_free_qw"]), period=np.pi)
    return turned - np.unwrap(np.arctan2(run["orbit.R_y_m"], run["orbit.R_x_m"]))


def test_libration(tmp_path):
    # (100, 400, 430) kg m^2: 4 K(sin 0.5) / (n sqrt(3 (Iy - Ix) / Iz)) = 4093.3871729 s from an amplitude of 0.5 rad.
    period_s = float(4 * mp.ellipk(mp.sin(mp.mpf("0.5")) ** 2) / (mp.mpf(RATE) * mp.sqrt(mp.mpf(900) / 430)))
    assert period_s == pytest.approx(4093.3871729, abs=2e-7)
    step_s = period_s / 1024
    run = pitching(tmp_path, (100.0, 400.0, 430.0), LEO, 0.5, step_s=step_s, duration_s=period_s, spin=RATE)
    assert not failing(run)
    # At the turning point the angle is even in time: a period that is off by d changes it by 0.5 a d^2, the rate by a d.
    acceleration = 1.5 * RATE**2 * 300.0 / 430.0 * np.sin(1.0)
    late_s = (run["state.v_robot_free_wz_rad_s"][-1] - RATE) / acceleration
    assert abs(late_s) < 1e-9 * period_s
    assert pitch(run)[-1] == pytest.approx(0.5, abs=1e-10)


@pytest.mark.parametrize("orbit", [LEO, ELLIPSE], ids=["circular", "ellipse"])
def test_a_planar_base(tmp_path, orbit):
    # Slides along x and y and a hinge about z in the plane of the orbit: the place of a Kepler orbit, and the attitude of a
    # free body with the same moment about z.
    R, V = origin_of(orbit)
    rates = np.cross(np.cross(R, V) / (R @ R), (10.0, -7.0, 0.0)) + np.array((0.002, 0.01, 0.0))
    planar = body((100.0, 400.0, 430.0)).replace('<freejoint name="free"/>', FLOATING_BASES["planar"])
    initial = {"joints": {"x": 10.0, "y": -7.0, "yaw": 0.3}, "rates": {"x": rates[0], "y": rates[1], "yaw": 2.0 * RATE}}
    run = free_run(tmp_path / "planar", orbit, [], duration_s=1000.0, robot=planar, initial=initial)
    assert not failing(run)
    free = ((10.0, -7.0, 0.0, np.cos(0.15), 0, 0, np.sin(0.15)), (*rates, 0, 0, 2.0 * RATE))
    other = free_run(tmp_path / "free", orbit, [free], duration_s=1000.0, robot=body((100.0, 400.0, 430.0)))
    exact = relative((R, V), (10.0, -7.0, 0.0), rates, 1000.0)
    # Order 4 at steps of 1 s: below 1e-11 m (see above); the second-order force of the body moves it by 1e-7 m.
    np.testing.assert_allclose(run.qpos[-1][:2], exact[:2], rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(run.qpos[-1][:2], place(other)[:2], rtol=0.0, atol=1e-11)
    assert np.linalg.norm(exact[:2] - (10.0, -7.0)) > 1.0
    turned = 2.0 * np.unwrap(np.arctan2(other["state.q_robot_free_qz"], other["state.q_robot_free_qw"]), period=np.pi)
    np.testing.assert_allclose(run.qpos[:, 2], turned, rtol=0.0, atol=1e-11)
    assert abs(run.qpos[-1][2] - 0.3 - 2000.0 * RATE) > 1e-3  # the torque turns it


def test_pitch_on_an_ellipse(tmp_path):
    # Beletsky's equation (1 + e cos f) q'' - 2 e sin f q' + 3 k sin q cos q = 2 e sin f, k = (Iy - Ix) / Iz, from perigee to
    # t = 6464 s, 0.023 s before the next one.
    e, k = 0.1, 300.0 / 430.0
    orbit = Orbit.of(OrbitConfig(**ELLIPSE), "hill")
    x, y, _ = orbit.reference.state(6464.0)[0]
    found = solve_ivp(
        lambda f, q: (q[1], (2 * e * np.sin(f) * (1.0 + q[1]) - 3 * k * np.sin(q[0]) * np.cos(q[0])) / (1 + e * np.cos(f))),
        (0.0, np.arctan2(y, x) % (2.0 * np.pi)), (0.0, 0.0), method="DOP853", rtol=1e-13, atol=1e-14, max_step=0.05,
    )  # fmt: skip
    assert found.y[0, -1] == pytest.approx(-0.0562837335, abs=1e-10)
    run = pitching(tmp_path, (100.0, 400.0, 430.0), ELLIPSE, 0.0, step_s=2.0, duration_s=6464.0, spin=orbit.spin[2])
    assert not failing(run)
    assert pitch(run)[-1] == pytest.approx(found.y[0, -1], abs=1e-11)  # 6e-13 with steps of 1 s: order 4
    assert np.abs(pitch(run)).max() == pytest.approx(np.abs(found.y[0]).max(), abs=1e-3)


def test_force_and_torque_of_point_masses(rng):
    # Exact sums over 8 masses within 3 m against the expansion: the note has 2e-13 N m and 3e-13 of 1.4e-10 N.
    field = Orbit.of(OrbitConfig(**LEO), "hill").field()
    half, some = rng.uniform(-3.0, 3.0, (4, 3)), rng.uniform(10.0, 40.0, 4)
    points, masses = np.concatenate((half, -half)), np.concatenate((some, some))  # symmetric: no third moments
    total = masses.sum()
    J = sum(m * ((p @ p) * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, points, strict=True))
    moments, axes = np.linalg.eigh(J)
    bodies = Bodies(["one"], [total], [moments])
    centre = np.array((40.0, -70.0, 20.0))
    bodies.position_m[0], bodies.axes[0] = centre, axes
    field.add_wrenches(0.0, bodies)
    with mp.workdps(40):
        R, force, torque = mp.matrix([mp.mpf("6778137"), 0, 0]), mp.zeros(3, 1), mp.zeros(3, 1)
        for mass, arm in zip(masses, points, strict=True):
            r = mp.matrix([mp.mpf(float(c)) + mp.mpf(float(s)) for c, s in zip(centre, arm, strict=True)])
            f = mp.mpf(float(mass)) * (-MU * (R + r) / mp.norm(R + r) ** 3 + MU * R / mp.norm(R) ** 3)
            force += f
            a = [mp.mpf(float(s)) for s in arm]
            torque += mp.matrix([a[1] * f[2] - a[2] * f[1], a[2] * f[0] - a[0] * f[2], a[0] * f[1] - a[1] * f[0]])
    found = np.array([float(x) for x in torque])
    assert np.linalg.norm(found) > 1e-5
    np.testing.assert_allclose(bodies.torque_N_m[0], found, rtol=1e-12, atol=2e-13)
    exact = np.array([float(x) for x in force])
    np.testing.assert_allclose(bodies.force_N[0], exact, rtol=0, atol=3e-14 + 1e-15 * np.linalg.norm(exact))
    second_order = np.linalg.norm(bodies.force_N[0] - total * field.acceleration(0.0, centre))
    assert second_order > 1e-11  # seen, and so is its sign


def test_the_difference_of_absolute_positions_is_no_tide():
    # The naive difference has noise of 5e-15 m/s^2 at 1 m; the stable form has that of the result, 1e-21.
    field, r = Orbit.of(OrbitConfig(**LEO), "hill").field(), np.array((0.6, -0.7, 0.387))
    R = np.array((6778137.0, 0.0, 0.0))
    with mp.workdps(40):
        Re, re = mp.matrix([mp.mpf(float(x)) for x in R]), mp.matrix([mp.mpf(float(x)) for x in r])
        exact = np.array([float(x) for x in -MU * (Re + re) / mp.norm(Re + re) ** 3 + MU * Re / mp.norm(Re) ** 3])
    naive = -float(MU) * (R + r) / np.linalg.norm(R + r) ** 3 + float(MU) * R / np.linalg.norm(R) ** 3
    np.testing.assert_allclose(field.acceleration(0.0, r), exact, rtol=1e-15, atol=2e-21)
    assert np.linalg.norm(naive - exact) > 1e-17


def test_the_potential_is_that_of_the_force():
    orbit = Orbit.of(OrbitConfig(**LEO), "hill")
    field, place_m = orbit.field(), np.array((300.0, -200.0, 500.0))
    bodies = Bodies(["one"], [100.0], [[10.0, 40.0, 43.0]])
    bodies.axes[0] = np.eye(3)
    values, step = [], 0.1
    for axis in range(3):
        for sign in (1, -1):
            bodies.position_m[0] = place_m + sign * step * np.eye(3)[axis]
            values.append(field.potential(0.0, bodies))
    bodies.position_m[0] = place_m
    field.add_wrenches(0.0, bodies)
    slope = -np.subtract(values[::2], values[1::2]) / (2.0 * step)
    # Central differences err by step^2 / 6 times 6 m n^2 / R = 1.1e-10, 1.9e-13 N, and by rounding of U / step, 1e-14 N;
    # the second-order force is 1e-11 N.
    np.testing.assert_allclose(slope, bodies.force_N[0], rtol=0, atol=4e-13)


def test_axes_on_an_ellipse():
    orbit = Orbit.of(OrbitConfig(**ELLIPSE, true_anomaly_deg=40.0), "hill")
    times = np.array((499.99, 500.0, 500.01))
    axes, spin = orbit.lvlh(*orbit.states(times))
    turning = (axes[2] - axes[0]) / 0.02 @ axes[1].T
    np.testing.assert_allclose((turning[2, 1], turning[0, 2], turning[1, 0]), spin[1], atol=1e-10)
    R, V = orbit.reference.state(500.0)
    np.testing.assert_allclose(axes[1][:, 2], -R / np.linalg.norm(R), atol=1e-15)
    assert axes[1][:, 0] @ V > 0.0
    np.testing.assert_allclose(axes[1][:, 1], -np.cross(R, V) / np.linalg.norm(np.cross(R, V)), atol=1e-15)


def test_j2_against_absolute_orbits():
    # The reference and a mass at 10 m, both integrated in absolute coordinates at 1e-13: they differ to 1e-7 m.
    config = OrbitConfig(altitude_km=400.0, j2=True, inclination_deg=51.6, argument_of_latitude_deg=30.0)
    orbit = Orbit.of(config, "hill")
    field, reference = orbit.field(), orbit.reference
    R, V = reference.state(0.0)
    r, v = 10.0 * OFFSET, np.array((0.01, -0.02, 0.005))
    ends = [
        solve_ivp(
            lambda _, y: np.concatenate((y[3:], reference.acceleration(y[:3]))),
            (0.0, 1000.0),
            np.concatenate(start),
            method="DOP853",
            rtol=1e-13,
            atol=1e-6,
            max_step=20.0,
        ).y[:3, -1]
        for start in ((R, V), (R + r, V + v))
    ]
    moved = solve_ivp(
        lambda t, y: np.concatenate((y[3:], field.acceleration(t, np.ascontiguousarray(y[:3])))),
        (0.0, 1000.0),
        np.concatenate((r, v)),
        method="DOP853",
        rtol=1e-12,
        atol=1e-12,
        max_step=50.0,
    ).y[:3, -1]
    np.testing.assert_allclose(reference.state(1000.0)[0], ends[0], atol=1e-6)
    np.testing.assert_allclose(moved, ends[1] - ends[0], atol=1e-7)
    kepler = Orbit.of(OrbitConfig(altitude_km=400.0, inclination_deg=51.6, argument_of_latitude_deg=30.0), "hill")
    assert np.linalg.norm(kepler.reference.state(100.0)[0] - reference.state(100.0)[0]) == pytest.approx(50.0, abs=20.0)


def test_world_axes_and_origin_change_nothing(tmp_path):
    start = {
        "frame": "lvlh",
        "joints": {"free": [5.0, 3.0, -4.0, 0.8, 0.6, 0, 0]},
        "rates": {"free": [0.01, 0, 0.02, 0, 0.1, 0]},
    }
    runs = [
        free_run(
            tmp_path / axes,
            LEO | {"inclination_deg": 30.0, "argument_of_latitude_deg": 50.0, "raan_deg": 20.0},
            [],
            duration_s=200.0,
            robot=body((1.0, 4.0, 4.3)),
            initial=start,
            environment={"world_axes": axes},
        )
        for axes in ("hill", "lvlh", "eci")
    ]
    for key in [key for key in runs[0].keys if key.startswith("orbit.robot")]:
        for other in runs[1:]:
            np.testing.assert_allclose(other[key][-1], runs[0][key][-1], atol=2e-12, err_msg=key)


def test_states_in_lvlh_are_what_the_columns_say(tmp_path):
    q, v = [5.0, 3.0, -4.0, 0.8, 0.0, 0.6, 0.0], [0.01, -0.03, 0.02, 0.2, 0.1, -0.3]
    run = free_run(
        tmp_path,
        ELLIPSE | {"true_anomaly_deg": 77.0},
        [],
        duration_s=1.0,
        initial={"frame": "lvlh", "joints": {"free": q}, "rates": {"free": v}},
    )
    names = [*(f"{axis}_m" for axis in "xyz"), *(f"q{part}" for part in "wxyz")]
    rates = [*(f"v{axis}_m_s" for axis in "xyz"), *(f"w{axis}_rad_s" for axis in "xyz")]
    np.testing.assert_allclose([run[f"orbit.robot_{name}"][0] for name in names], q, atol=1e-15)
    np.testing.assert_allclose([run[f"orbit.robot_{name}"][0] for name in rates], v, atol=1e-15)


def test_a_wrong_sign_of_the_rotation_fails(tmp_path, monkeypatch):
    # At rest on the V-bar with the rates of axes that turn the other way: 2 n d off.
    right = orbit_columns.world_state
    monkeypatch.setattr(orbit_columns, "world_state", lambda axes, spin, *state: right(axes, -spin, *state))
    run = free_run(tmp_path, LEO, [], duration_s=300.0, initial={"frame": "lvlh", "joints": {"free": [50, 0, 0, *EYE]}})
    assert np.abs(run["orbit.robot_z_m"][-1]) > 10.0


class Frozen(Field):
    """The field with the origin where it was at the start of a step."""

    kind = "frozen_orbit"

    class Config(StrictModel):
        """Keys of the field."""

        kind: str
        step_s: float
        torque: bool = True

    def __init__(self, config, bodies):
        self._step_s, self._torque = config.step_s, config.torque
        self._field: OrbitalField = Orbit.of(OrbitConfig(**LEO), "hill").field()

    def add_wrenches(self, time_s, bodies):
        frozen = np.floor(time_s / self._step_s + 1e-9) * self._step_s if self._step_s else time_s
        self._field.add_wrenches(frozen, bodies)
        if not self._torque:
            bodies.torque_N_m[:] = 0.0

    def get_state(self):
        """Nothing."""

    def set_state(self, state):
        """Nothing."""


def test_a_field_frozen_over_steps_has_order_one(tmp_path):
    q, v = hill_start((0.0, 10.0, 0.0))
    exact, errors = relative(origin_of(LEO), q[:3], v[:3], 1000.0), []
    for step_s in (4.0, 2.0):
        (tmp_path / str(step_s)).mkdir()
        keys = {"time_step_s": step_s, "control_period_s": step_s, "duration_s": 1000.0}
        keys["environment"] = {"fields": [{"kind": "frozen_orbit", "step_s": step_s}]}
        initial = {"joints": {"free": q}, "rates": {"free": [*map(float, v)]}}
        run = ffsm_mj.run(scene(tmp_path / str(step_s), ball(), {}, initial=initial, **keys), fields=[Frozen])
        errors.append(np.linalg.norm(place(run) - exact))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.1)
    assert errors[1] > 1e-4


def test_a_torque_that_is_left_out_is_seen(tmp_path):
    keys = {"time_step_s": 1.0, "control_period_s": 1.0, "duration_s": 1000.0}
    keys["environment"] = {"fields": [{"kind": "frozen_orbit", "step_s": 0.0, "torque": False}]}
    initial = {"joints": {"free": [0, 0, 0, np.cos(0.25), 0, 0, np.sin(0.25)]}, "rates": {"free": [0, 0, 0, 0, 0, RATE]}}
    run = ffsm_mj.run(scene(tmp_path, body((100.0, 400.0, 430.0)), {}, initial=initial, **keys), fields=[Frozen])
    turned = pitching(tmp_path / "with", (100.0, 400.0, 430.0), LEO, 0.5, step_s=1.0, duration_s=1000.0, spin=RATE)
    assert abs(turned["state.v_robot_free_wz_rad_s"][-1] - run["state.v_robot_free_wz_rad_s"][-1]) > 5e-4


class Backwards:
    """Enters the work of the stages of a step with the wrong sign."""

    def __init__(self, done, account):
        self.done, self.account = done, account

    def open(self):
        """Begin a step."""

    def close(self, duration_s):
        """End it."""
        self.account -= self.done


def test_the_jacobi_check_sees_a_work_that_is_wrong(tmp_path, monkeypatch):
    q, v = hill_start((0.0, 100.0, 50.0))
    right = free_run(tmp_path / "right", LEO, [(q, v)], duration_s=500.0)
    assert "Jacobi integral" in {check.name for check in right.checks()}
    assert not failing(right)
    monkeypatch.setattr("ffsm_mj.balance.balance.StageWork", Backwards)
    wrong = free_run(tmp_path / "wrong", LEO, [(q, v)], duration_s=500.0)
    assert "Jacobi integral" in {check.name for check in failing(wrong)}


def test_an_impact_in_orbit(tmp_path):
    # The note: balls of 200 and 20 kg meet at e = 0.4; the Jacobi integral jumps by the loss and drifts by rounding.
    keys = {
        "environment": {"orbit": LEO},
        "duration_s": 300.0,
        "time_step_s": 0.5,
        "control_period_s": 0.5,
        "initial": {
            "frame": "lvlh",
            "joints": {"ball/free": [3.0, 0, 0.3, *EYE]},
            "rates": {"ball/free": [-0.02, 0, 0, 0, 0, 0]},
        },
        "contacts": {"rules": [{"between": ["robot/ball", "ball/ball"], "restitution": 0.4, "mu": 0.3}]},
    }
    path = scene(tmp_path, ball(mass=200.0, radius=0.5), {"ball": ball("ball", mass=20.0, radius=0.5)}, **keys)
    run = ffsm_mj.run(path, out=tmp_path / "run")
    assert not failing(run)
    assert len(run.impacts) == 1
    J = run["energy.total_J"] + run["orbit.potential_J"] - RATE * run["momentum.total_L_z_N_m_s"]
    jump = J[-1] - J[0]
    assert jump == pytest.approx(run["balance.total_impact_energy_J"][-1], abs=5e-14)
    assert jump < -1e-4
    again = replay_log(ffsm_mj.load_run(tmp_path / "run").log)
    assert again.agrees
    assert not [check for check in again.checks() if not check.passes]


def test_a_grasp_in_orbit(tmp_path):
    run = ffsm_mj.run(grasping(tmp_path, environment={"orbit": LEO}, time_step_s=2e-3, control_period_s=2e-3))
    assert len(run.grasps) == 1
    assert not failing(run)


def test_without_gravitation_nothing_changes(tmp_path):
    """In the field of next to no mass a tumbling body moves as in none: tides are 1e-25 of its accelerations."""
    far = {"body": {"mu_km3_s2": 1e-12, "radius_km": 1.0}, "altitude_km": 400.0}
    initial = {"joints": {"free": [5, 0, 0, *EYE]}, "rates": {"free": [0.1, -0.2, 0.3, 0.4, 0.5, 0.6]}}
    runs = [
        free_run(tmp_path / name, orbit, [], duration_s=2.0, step_s=5e-3, robot=body((1.0, 4.0, 4.3)), initial=initial)
        for name, orbit in (("orbit", far), ("none", None))
    ]
    # MuJoCo's steps differ from those under forces in how they add up rotations: 1e-10 at 0.1 s, and h^4 of it here.
    np.testing.assert_allclose(runs[0].qpos, runs[1].qpos, rtol=0.0, atol=1e-13)
    assert np.abs(np.diff(runs[0].qpos, axis=0)).max() > 1e-3


def test_two_welded_halves_are_one_body(tmp_path):
    """A bar of some 12 m: without the force of second order, 6e-12 m/s^2, positions would differ by 1e-7 m after 300 s."""
    half = '<body name="half" pos="6 0 0"><inertial pos="0 0 0" mass="100" diaginertia="20 1210 1215"/></body>'
    parted = (
        '<mujoco><option gravity="0 0 0"/><worldbody><body name="base"><freejoint name="free"/>'
        f'<inertial pos="0 0 0" mass="100" diaginertia="20 1210 1215"/>{half}</body></worldbody></mujoco>'
    )
    # Steiner: each half is 3 m from the common mass centre.
    whole = (
        '<mujoco><option gravity="0 0 0"/><worldbody><body name="base"><freejoint name="free"/>'
        '<inertial pos="3 0 0" mass="200" diaginertia="40 4220 4230"/></body></worldbody></mujoco>'
    )
    start = ((20.0, -10.0, 5.0, *(np.array((0.8, 0.2, -0.4, 0.4)) / np.linalg.norm((0.8, 0.2, -0.4, 0.4)))), (0.0,) * 6)
    ends = [
        free_run(tmp_path / name, LEO, [start], duration_s=300.0, robot=model)
        for name, model in (("parted", parted), ("whole", whole))
    ]
    # Rounding of 300 steps of positions of up to 30 m; the motion itself is metres.
    np.testing.assert_allclose(ends[0].qpos[-1], ends[1].qpos[-1], rtol=0.0, atol=1e-11)
    assert np.linalg.norm(place(ends[1]) - place(ends[1], row=0)) > 1e-2


@pytest.mark.parametrize(
    ("environment", "fault"),
    [
        ({"orbit": {"altitude_km": -40.0}}, "environment.orbit.altitude_km: perigee 40 km below the surface"),
        ({"orbit": {"kind": "elliptic", "perigee_altitude_km": -10.0, "apogee_altitude_km": 300.0}},
         "environment.orbit.perigee_altitude_km: perigee 10 km below the surface"),
        ({"orbit": ELLIPSE | {"eccentricity": 1.0}}, "environment.orbit.eccentricity: is 1; a closed orbit"),
        ({"orbit": ELLIPSE | {"eccentricity": -0.1}}, "environment.orbit.eccentricity: is -0.1"),
        ({"orbit": {"altitude_km": 400000000.0}}, "environment.orbit.altitude_km: is 4e+08 km"),
        ({"orbit": {"altitude_km": 400.0, "period_min": 90.0}}, "one way and no more"),
        ({"orbit": {}}, "environment.orbit: 'kind: circular' takes altitude_km or radius_km or period_min"),
        ({"orbit": LEO | {"true_anomaly_deg": 3.0}}, "environment.orbit.true_anomaly_deg: is no key of 'kind: circular'"),
        ({"orbit": {"kind": "elliptic", "perigee_altitude_km": 500.0, "apogee_altitude_km": 300.0}}, "is below the perigee"),
        ({"orbit": LEO | {"j2": True}}, "environment.orbit.inclination_deg: is needed with j2: true"),
        ({"orbit": {"kind": "state", "position_km": [7000, 0, 0], "velocity_km_s": [0, 20, 0]}}, "escape velocity"),
        ({"orbit": LEO | {"body": {"mu_km3_s2": 1e5, "radius_km": 3000.0}, "j2": True, "inclination_deg": 9.0,
                          "argument_of_latitude_deg": 0.0}}, "environment.orbit.j2: the central body has no j2"),
        ({"world_axes": "eci"}, "environment.world_axes: has no effect without 'orbit'"),
        ({"epoch": "12:00:00Z"}, "environment.epoch: '12:00:00Z' is no date and time in UTC"),
        ({"epoch": "2027-03-01T12:00:00+02:00"}, "environment.epoch"),
    ],
)  # fmt: skip
def test_faults(tmp_path, environment, fault):
    with pytest.raises(InputError) as raised:
        ffsm_mj.run(scene(tmp_path, ball(), {}, environment=environment))
    assert fault in str(raised.value)


def test_models_that_fit_no_orbit(tmp_path):
    falling = ball().replace("0 0 0", "0 0 -9.81", 1)
    with pytest.raises(InputError, match=r"environment.orbit: the models have a uniform gravity beside it"):
        ffsm_mj.run(scene(tmp_path, falling, {}, environment={"orbit": LEO}, conservative=False))
    with pytest.raises(InputError, match=r"out of its joints: give it a free joint"):
        ffsm_mj.run(scene(tmp_path, ball(joints="xz"), {}, environment={"orbit": LEO}))
    with pytest.raises(InputError, match=r"initial.frame: needs 'environment.orbit'"):
        ffsm_mj.run(scene(tmp_path, ball(), {}, initial={"frame": "lvlh"}))


def test_notes(tmp_path):
    path = scene(tmp_path, ball(), {}, environment={"orbit": LEO}, initial={"joints": {"free": [20000, 0, 0, *EYE]}})
    lines = "\n".join(ffsm_mj.Scenario.load(path).describe())
    assert "orbit about earth: semi-major axis 6778.14 km, rate 0.00113137 rad/s, period 5553.6 s" in lines
    assert "V-bar (0, 1, 0), R-bar (-1, 0, 0) in world axes" in lines
    assert "external fields (orbit): their impulse and work enter the balance" in lines
    assert "bodies are 20 km from the origin of the orbit: gaps are rounded to 4e-12 m" in lines
    assert "not in m" not in lines
    in_m = {"environment.orbit.altitude_km": 400e3}  # 400 km in m
    assert "63.7 radii of the central body" in "\n".join(ffsm_mj.Scenario.load(path).with_overrides(in_m).describe())


def test_angular_momentum_from_the_field(tmp_path):
    # What the field gives about the centre of mass is what the bodies gain about it.
    initial = {
        "frame": "lvlh",
        "joints": {"free": [500.0, 3.0, -4.0, 0.8, 0.6, 0, 0]},
        "rates": {"free": [0, 0, 0, 0, 0, 0.01]},
    }
    run = free_run(tmp_path, LEO, [], duration_s=400.0, robot=body((100.0, 400.0, 430.0)), initial=initial)
    found = ffsm_mj.angular_momentum(run)
    assert np.linalg.norm(found["external_N_m_s"]) > 1e-3
    # Of r x F with both linear over rows of 1 s there is a twelfth of the product of their changes: 1e-9 in 400 rows.
    assert found["residual_N_m_s"] < 1e-8
