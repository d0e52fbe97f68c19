"""Inner surfaces of cones: motion on the developed cone, impacts against textbook rows, bounds, and bad input."""

from __future__ import annotations

import json
import math

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.notes import contact_notes, describe, initial_scene
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.cli.main import main
from ffsm_mj.contact_models.impact.time_of_impact import Detector
from ffsm_mj.errors import InputError
from ffsm_mj.log.drawing import shapes
from ffsm_mj.replay import replay_log
from tests.contact.test_half_space import GEOMS
from tests.replays import assert_passes, assert_replayed
from tests.scenes import HEAD, ball, box, scene
from tests.simulation.restored import is_rest_of, rest, told

ALPHA, R = math.radians(30.0), 0.1
SINE, COSINE = math.sin(ALPHA), math.cos(ALPHA)
BACK = f'<mujoco>{HEAD}<worldbody><geom name="back" size="0.05" pos="0 0 -0.3"/></worldbody></mujoco>'
FUNNEL = {"body": "world", "axis": [0.0, 0.0, 2.0], "half_angle_deg": 30.0, "length_m": 2.0}


def in_funnel(folder, robot, *, cone=None, restitution=0.0, mu=0.0, pose=None, **scenario):
    """A robot in a fixed cone along z whose apex is the origin of the object ``funnel``."""
    rules = [{"between": ["robot", "funnel"], "restitution": restitution, "mu": mu}]
    path = scene(
        folder,
        robot,
        {"funnel": BACK},
        fixed={"funnel": pose or {}},
        **{"contacts": {"rules": rules}, "control_period_s": 0.01, "time_step_s": 0.002, **scenario},
    )
    data = json.loads(path.read_text())
    data["objects"]["funnel"]["cones"] = [FUNNEL | (cone or {})]
    path.write_text(json.dumps(data))
    return path


def placed(rho, gap=0.0):
    """Centre of the sphere at an azimuth of 0, at a distance from the axis and with a gap."""
    return np.array([rho, 0.0, (R + gap + rho * COSINE) / SINE])


def developed(centres):
    """Centres in the plane of their cone, unrolled: it is parallel to the surface, so its apex is R / sin(alpha) higher."""
    rho = np.hypot(centres[:, 0], centres[:, 1])
    angle = SINE * np.unwrap(np.arctan2(centres[:, 1], centres[:, 0]))
    return rho[:, None] / SINE * np.column_stack((np.cos(angle), np.sin(angle)))


UP = np.array([SINE, 0.0, COSINE])
INWARD = np.array([-COSINE, 0.0, SINE])


@pytest.mark.parametrize("body", ["sphere", "end"])
def test_a_sphere_slides_along_a_straight_line_of_the_developed_cone(tmp_path, body):
    """Without friction a geodesic of the parallel cone at constant speed; RK4 errs by (0.002)^5 in a step."""
    velocity = -0.2 * UP + 0.3 * np.array([0.0, 1.0, 0.0])
    robot = ball("ball", radius=R)
    if body == "end":  # far above the lower end, the other one touches nothing
        robot = robot.replace('type="sphere" size="0.1"', 'type="capsule" size="0.1" fromto="0 0 0 0 0 0.2"')
    start = {"joints": {"robot/free": [*placed(0.5), 1, 0, 0, 0]}, "rates": {"robot/free": [*velocity, 0, 0, 0]}}
    run = ffsm_mj.run(in_funnel(tmp_path, robot, initial=start))
    assert_passes(run)
    centres, times = run.qpos[:, :3], np.linspace(0.0, 1.0, len(run.qpos))
    line = developed(centres[:1]) + np.outer(times, [-0.2, 0.3])
    assert developed(centres) == pytest.approx(line, abs=1e-12)
    assert run.qvel[-1, 3:] == pytest.approx(0.0, abs=1e-14)
    assert np.abs(centres[:, 2] * SINE - np.hypot(centres[:, 0], centres[:, 1]) * COSINE - R).max() < 1e-13
    assert_replayed(run)


def test_a_sphere_passes_close_to_the_axis(tmp_path):
    """At 5 mm it turns round the axis at 160 rad/s, half a turn in 20 ms: whole steps of 2 ms end 4e-5 m beside the line.

    Steps in which it travels 0.01 of its distance from the axis err by 1e-12 of that each, 300 of them at most by 1e-11 m.
    """
    away, beside, speed = 0.2 / SINE, 0.005 / SINE, 0.8
    angle = math.asin(beside / away)
    velocity = speed * (-math.cos(angle) * UP + math.sin(angle) * np.array([0.0, 1.0, 0.0]))
    start = {"joints": {"robot/free": [*placed(0.2), 1, 0, 0, 0]}, "rates": {"robot/free": [*velocity, 0, 0, 0]}}
    run = ffsm_mj.run(in_funnel(tmp_path, ball("ball", radius=R), initial=start))
    assert_passes(run)
    line = developed(placed(0.2)[None])[0] + speed * 1.0 * np.array([-math.cos(angle), math.sin(angle)])
    distance = np.hypot(*run.qpos[:, :2].T)
    assert distance.min() < 0.006
    assert distance[-1] / SINE == pytest.approx(math.hypot(*line), abs=1e-10)


def test_a_plastic_impact_goes_on_along_a_straight_line(tmp_path):
    """At e = 0 the velocity along the normal is lost and the rest is that of the line."""
    velocity = -0.2 * UP + 0.3 * np.array([0.0, 1.0, 0.0]) - 0.5 * INWARD
    far = placed(0.5) - 0.05 * velocity
    start = {"joints": {"robot/free": [*far, 1, 0, 0, 0]}, "rates": {"robot/free": [*velocity, 0, 0, 0]}}
    run = ffsm_mj.run(in_funnel(tmp_path, ball("ball", radius=R), initial=start))
    assert_passes(run)
    (impact,) = run.impacts
    assert impact.time_s == pytest.approx(0.05, abs=1e-13)
    assert impact.normal == pytest.approx(-INWARD, abs=1e-13)
    assert impact.impulse_N_s == pytest.approx(0.5, abs=1e-13)
    assert impact.point_m == pytest.approx(placed(0.5) - R * INWARD, abs=1e-13)
    line = developed(placed(0.5)[None])[0] + 0.95 * np.array([-0.2, 0.3])
    assert developed(run.qpos[:, :3])[-1] == pytest.approx(line, abs=1e-12)
    assert_replayed(run)


def test_turning_points_of_the_effective_potential(tmp_path):
    """Under gravity g along -z: L = rho^2 phi', E = rho'^2 / (2 sin^2) + L^2 / (2 rho^2) + g rho cot, per mass.

    RK4: at angular rates w of up to 4 rad/s a step of 2 ms errs by (w h)^5 / 120 of the state, some 1e-10 over 800 steps.
    """
    g, rho, side = 2.0, 0.5, 0.9
    robot = ball("ball", radius=R).replace("0 0 0", "0 0 -2", 1)
    start = {"joints": {"robot/free": [*placed(rho), 1, 0, 0, 0]}, "rates": {"robot/free": [0, side, 0, 0, 0, 0]}}
    run = ffsm_mj.run(in_funnel(tmp_path, robot, initial=start, conservative=False, duration_s=1.6))
    assert_passes(run)
    moment, cot = rho * side, COSINE / SINE
    energy = 0.5 * side**2 + g * rho * cot
    x, v = run.qpos[:, :3], run.qvel[:, :3]
    assert x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0] == pytest.approx(moment, abs=1e-9)
    distance = np.hypot(x[:, 0], x[:, 1])
    turning = np.roots([g * cot, -energy, 0.0, 0.5 * moment**2])
    lowest, highest = sorted(turning[turning > 0.0])
    # Sampled every 10 ms, within 5 ms of the turning point: rho'' < 3 m/s^2 there.
    assert distance.max() == pytest.approx(highest, abs=1e-9)
    assert distance.min() == pytest.approx(lowest, abs=3 * 0.005**2)
    assert distance.min() >= lowest - 1e-9


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_a_sphere_falls_along_the_axis_beside_it(tmp_path, restitution):
    """Contact where z sin(alpha) = rho cos(alpha) + R; the impulse acts along the normal alone."""
    start = {"joints": {"robot/free": [0.3, 0, 1.5, 1, 0, 0, 0]}, "rates": {"robot/free": [0, 0, -1.0, 0, 0, 0]}}
    run = ffsm_mj.run(in_funnel(tmp_path, ball("ball", radius=R), restitution=restitution, initial=start))
    assert_passes(run)
    impact = run.impacts[0]
    assert impact.time_s == pytest.approx(1.5 - placed(0.3)[2], abs=1e-13)
    after = np.array([0, 0, -1.0]) + (1.0 + restitution) * SINE * INWARD
    assert impact.qvel_after["robot/free"][:3] == pytest.approx(after, abs=1e-13)
    assert_replayed(run)


def test_friction_slows_a_sphere_without_turn_as_on_a_plane(tmp_path):
    """Down a generator the cone is a plane: gravity along it, less mu N, and 5 / 2 of that for the spin."""
    mu, g = 0.1, 2.0
    robot = ball("ball", radius=R).replace("0 0 0", "0 0 -2", 1)
    start = {"joints": {"robot/free": [*placed(0.8), 1, 0, 0, 0]}, "rates": {"robot/free": [0, 0, 0, 0, 0, 0]}}
    run = ffsm_mj.run(in_funnel(tmp_path, robot, mu=mu, initial=start, conservative=False, duration_s=0.3))
    assert_passes(run)
    slope, press = g * COSINE, g * SINE
    along = 0.5 * (slope - mu * press) * 0.3**2  # it slides: rolling would need mu > 2 / 7 cot(30 deg)
    assert run.qpos[-1, :3] == pytest.approx(placed(0.8) - along * UP, abs=1e-12)
    assert np.linalg.norm(run.qvel[-1, 3:]) == pytest.approx(2.5 * mu * press * 0.3 / R, abs=1e-11)
    assert_replayed(run)


TURN = (np.array([0.8, 0.3, -0.4, 0.2]) / math.sqrt(0.93)).tolist()
CORNER = {"joints": {"robot/free": [0.35, 0.02, 1.6, *TURN]}, "rates": {"robot/free": [0.1, 0, -0.8, 0.3, 0.5, 0]}}


def first_corner(start, half):
    """Time at which the first corner of a free box touches the cone, and that corner, by the exact motion and bisection."""
    turn, spin = np.array(start["joints"]["robot/free"][3:]), np.array(start["rates"]["robot/free"][3:])
    place, velocity = np.array(start["joints"]["robot/free"][:3]), np.array(start["rates"]["robot/free"][:3])
    corners = half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])

    def at(time):
        # A cube has equal moments of inertia: it turns at a constant rate, about an axis fixed in the body.
        quaternion, matrix = turn.copy(), np.empty(9)
        mujoco.mju_quatIntegrate(quaternion, spin, time)
        mujoco.mju_quat2Mat(matrix, quaternion)
        places = place + velocity * time + corners @ matrix.reshape(3, 3).T
        gaps = places[:, 2] * SINE - np.hypot(places[:, 0], places[:, 1]) * COSINE
        return gaps.min(), places[np.argmin(gaps)]

    low, high = 0.0, 1.5
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if at(middle)[0] > 0.0 else (low, middle)
    return high, at(high)[1]


@pytest.mark.parametrize("body", ["box", "mesh"])
def test_the_corner_of_a_box_meets_the_cone(tmp_path, body):
    """Vertices of a mesh are in single precision: 1e-8 of 0.1 m."""
    robot = box("box", half=(0.1, 0.1, 0.1))
    if body == "mesh":
        corners = " ".join(f"{x} {y} {z}" for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.1))
        asset = f'<asset><mesh name="cube" vertex="{corners}"/></asset><worldbody>'
        robot = robot.replace("<worldbody>", asset).replace('type="box" size="0.1 0.1 0.1"', 'type="mesh" mesh="cube"')
    run = ffsm_mj.run(in_funnel(tmp_path, robot, restitution=1.0, initial=CORNER, duration_s=1.5))
    assert_passes(run)
    time, corner = first_corner(CORNER, 0.1)
    hit, exact = run.impacts[0], 1e-12 if body == "box" else 1e-8
    assert hit.time_s == pytest.approx(time, abs=exact)
    assert hit.point_m == pytest.approx(corner, abs=exact)
    outward = np.array([corner[0], corner[1], 0.0]) / math.hypot(corner[0], corner[1])
    assert hit.normal == pytest.approx(COSINE * outward - SINE * np.array([0, 0, 1.0]), abs=10 * exact)
    assert hit.pair.startswith("box-cone vertex ")
    assert_replayed(run)


def test_two_corners_at_once(tmp_path):
    """An edge across a generator: both ends touch with normals of their own, and what is across the edge is symmetric."""
    start = {"joints": {"robot/free": [0.3, 0, 1.2, 1, 0, 0, 0]}, "rates": {"robot/free": [0, 0, -1.0, 0, 0, 0]}}
    run = ffsm_mj.run(in_funnel(tmp_path, box("box", half=(0.1, 0.2, 0.1)), restitution=1.0, initial=start, duration_s=0.7))
    assert_passes(run)
    one, other = run.impacts[:2]
    assert one.event == other.event
    assert one.time_s == pytest.approx(1.1 - math.hypot(0.4, 0.2) * COSINE / SINE, abs=1e-13)
    assert one.impulse_N_s == pytest.approx(other.impulse_N_s, rel=1e-12)
    assert np.array(one.normal) * [1, -1, 1] == pytest.approx(np.array(other.normal), abs=1e-13)
    assert one.qvel_after["robot/free"][1] == pytest.approx(0.0, abs=1e-14)


def test_a_rod_lies_along_a_generator_on_both_ends(tmp_path):
    """It slides down without friction as a point does, held at both ends."""
    turn = [math.cos(ALPHA / 2), 0, math.sin(ALPHA / 2), 0]
    rod = ball("rod", radius=R).replace('type="sphere" size="0.1"', 'type="capsule" size="0.1 0.3"')
    start = {"joints": {"robot/free": [*placed(0.6), *turn]}, "rates": {"robot/free": [*(-0.3 * UP), 0, 0, 0]}}
    run = ffsm_mj.run(in_funnel(tmp_path, rod, initial=start))
    assert_passes(run)
    assert run.qpos[-1, :3] == pytest.approx(placed(0.6) - 0.3 * UP, abs=1e-12)
    assert set(run.contacts[0].pairs) == {"rod-cone end 1", "rod-cone end 2"}
    assert_replayed(run)


def test_a_sphere_that_slides_to_the_axis_ends_the_run(tmp_path):
    """There it touches all round, and would stay."""
    start = {"joints": {"robot/free": [*placed(0.2), 1, 0, 0, 0]}, "rates": {"robot/free": [*(-0.4 * UP), 0, 0, 0]}}
    run = ffsm_mj.run(in_funnel(tmp_path, ball("ball", radius=R), initial=start, duration_s=1.5))
    assert run.outcome == "unsupported_contact"
    assert "touch all round the axis" in run.message
    assert float(run.message.split("t = ")[1].split()[0]) == pytest.approx(0.2 / SINE / 0.4, rel=1e-5)
    assert [check for check in all_checks(run) if not check.passes] == []


@pytest.mark.parametrize("restitution", [0.5, 1.0])
@pytest.mark.parametrize("gravity", ["0 0 0", "0 0 -2"])
def test_a_sphere_bounces_on_the_axis(tmp_path, restitution, gravity):
    """It touches all round, in four directions: each has the speed v sin(alpha), and e is that of the whole."""
    robot = ball("ball", radius=R).replace("0 0 0", gravity, 1)
    start = {"joints": {"robot/free": [0, 0, 0.5, 1, 0, 0, 0]}, "rates": {"robot/free": [0, 0, -0.5, 0, 0, 0]}}
    more = {"restitution": restitution, "initial": start, "conservative": gravity == "0 0 0"}
    run = ffsm_mj.run(in_funnel(tmp_path, robot, duration_s=0.7, **more))
    assert_passes(run)
    first = [impact for impact in run.impacts if impact.event == 0]
    assert len(first) == 4
    fall, g = 0.5 - R / SINE, -float(gravity.split()[2])
    speed = math.sqrt(0.25 + 2.0 * g * fall)
    assert first[0].time_s == pytest.approx((speed - 0.5) / g if g else fall / 0.5, abs=1e-12)
    after = np.array(first[0].qvel_after["robot/free"])
    assert after == pytest.approx([0, 0, restitution * speed, 0, 0, 0], abs=1e-12)
    assert sum(impact.impulse_N_s for impact in first) * SINE == pytest.approx((1.0 + restitution) * speed, abs=1e-12)
    assert_replayed(run)


def test_a_sphere_crosses_the_axis_in_an_impact(tmp_path):
    """On its way across the axis it touches all round: at e = 1 energy is kept, and it leaves every generator."""
    start = {"joints": {"robot/free": [-0.15, 0, 0.5, 1, 0, 0, 0]}, "rates": {"robot/free": [0.5, 0, -1.0, 0, 0, 0]}}
    run = ffsm_mj.run(in_funnel(tmp_path, ball("ball", radius=R), restitution=1.0, initial=start, duration_s=0.35))
    assert_passes(run)
    assert run.impacts[0].time_s == pytest.approx(0.3, abs=1e-9)
    assert {impact.event for impact in run.impacts[:4]} == {0}
    angles = np.linspace(0.0, 2.0 * math.pi, 73)
    normals = np.column_stack((-COSINE * np.cos(angles), -COSINE * np.sin(angles), np.full(73, SINE)))
    after = run.qvel[-1, :3]
    assert after @ after == pytest.approx(1.25, abs=1e-12)
    assert (normals @ after).min() >= -1e-12
    assert_replayed(run)


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_an_ellipsoid_of_revolution_bounces_on_the_axis(tmp_path, restitution):
    """It touches on a circle, where z sin(alpha) = hypot(a cos(alpha), c sin(alpha)): four points share m v (1 + e).

    Plastic, it would stay: the run ends and says what to change.
    """
    egg = ball("egg", radius=R).replace('type="sphere" size="0.1"', 'type="ellipsoid" size="0.1 0.1 0.15"')
    start = {"joints": {"robot/free": [0, 0, 0.6, 1, 0, 0, 0]}, "rates": {"robot/free": [0, 0, -0.5, 0, 0, 0]}}
    run = ffsm_mj.run(in_funnel(tmp_path, egg, restitution=restitution, initial=start))
    height = math.hypot(0.1 * COSINE, 0.15 * SINE) / SINE
    if restitution == 0.0:
        assert run.outcome == "unsupported_contact"
        assert "let it bounce (restitution)" in run.message
        assert float(run.message.split("t = ")[1].split()[0].strip(",")) == pytest.approx((0.6 - height) / 0.5, abs=1e-6)
        return
    assert_passes(run)
    assert [impact.time_s for impact in run.impacts] == pytest.approx([(0.6 - height) / 0.5] * 4, abs=1e-12)
    assert sum(impact.impulse_N_s for impact in run.impacts) * SINE == pytest.approx(0.5 * (1.0 + restitution), abs=1e-12)
    assert run.qvel[-1] == pytest.approx([0, 0, 0.5 * restitution, 0, 0, 0], abs=1e-12)
    place, along = 0.1**2 * COSINE / (height * SINE), 0.15**2 * SINE / (height * SINE)
    for impact in run.impacts:  # on the circle of contact
        assert math.hypot(*impact.point_m[:2]) == pytest.approx(place, abs=1e-12)
        assert impact.point_m[2] == pytest.approx(height - along, abs=1e-12)
    assert_replayed(run)


def pin(half, gravity=0.0):
    """A cylinder of radius R along z; its inertia about z is 0.008 kg m2, its mass 1 kg."""
    return f"""<mujoco><option gravity="0 0 {-gravity}"/><worldbody><body name="pin"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.008"/>
      <geom name="pin" type="cylinder" size="{R} {half}" mass="0"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_a_level_rim_meets_the_cone_all_round(tmp_path, restitution):
    """A cylinder that goes down along the axis: four points of its rim take m v (1 + e), each along its normal."""
    start = {"joints": {"robot/free": [0, 0, 1.0, 1, 0, 0, 0]}, "rates": {"robot/free": [0, 0, -0.8, 0, 0, 0]}}
    run = ffsm_mj.run(in_funnel(tmp_path, pin(0.2), restitution=restitution, initial=start))
    assert_passes(run)
    assert_replayed(run)
    time_s = (1.0 - 0.2 - R * COSINE / SINE) / 0.8
    assert [impact.time_s for impact in run.impacts] == pytest.approx([time_s] * 4, abs=1e-11)
    assert [impact.impulse_N_s * SINE for impact in run.impacts] == pytest.approx([0.2 * (1.0 + restitution)] * 4, abs=1e-12)
    assert run.qvel[-1] == pytest.approx([0, 0, 0.8 * restitution, 0, 0, 0], abs=1e-12)
    assert [record.mode for record in run.records["contact_beginnings"]] == ["level rim on cone"] * (restitution == 0.0)


def test_a_rim_that_is_not_quite_level_bounces_on_its_sides(tmp_path):
    """At 1e-7 rad its lower side touches 5 nm before the other one: impacts of one point each, at no loss."""
    turn = [math.cos(5e-8), math.sin(5e-8), 0, 0]
    start = {"joints": {"robot/free": [0, 0, 1.0, *turn]}, "rates": {"robot/free": [0, 0, -0.8, 0, 0, 0]}}
    run = ffsm_mj.run(in_funnel(tmp_path, pin(0.2), restitution=1.0, initial=start))
    assert_passes(run)
    assert len(run.impacts) > 1
    assert {impact.event for impact in run.impacts} == set(range(len(run.impacts)))


def test_a_rim_in_contact_is_not_located_at_every_step(tmp_path, monkeypatch):
    """Its other place is where a second minimum of the distance may come, far from the cone: a few of 1000 steps near it."""
    located, first_event = [], Detector.first_event
    monkeypatch.setattr(Detector, "first_event", lambda *arguments: located.append(1) or first_event(*arguments))
    tilt = math.radians(40.0)
    start = {
        "joints": {"robot/free": [0.3, 0, 1.3, math.cos(tilt / 2), 0, math.sin(tilt / 2), 0]},
        "rates": {"robot/free": [-0.2, 0.3, -0.9, 1.0, -0.5, 0.7]},
    }
    run = ffsm_mj.run(in_funnel(tmp_path, pin(0.15), mu=0.1, initial=start, time_step_s=1e-3))
    assert_passes(run)
    in_contact = run["contact.robot_funnel_points"] > 0
    assert 1e3 * in_contact.mean() > 300
    assert len(located) < 60


def test_a_disc_spins_down_in_a_cone(tmp_path):
    """Pressed by gravity it lies level, as its centre is lower than R tan(alpha) over the rim.

    Normal forces of m g / sin(alpha) and friction round the axis: I w' = -mu m g R / sin(alpha), until it sticks.
    """
    start = {
        "joints": {"robot/free": [0, 0, 0.03 + R * COSINE / SINE, 1, 0, 0, 0]},
        "rates": {"robot/free": [0, 0, 0, 0, 0, 2.0]},
    }
    funnel = in_funnel(tmp_path, pin(0.03, 3.0), mu=0.05, initial=start, conservative=False, duration_s=0.8)
    run = ffsm_mj.run(funnel)
    assert_passes(run)
    assert [check for check in replay_log(run.log).checks() if not check.passes] == []  # by points that turn with the rim
    rate = 0.05 * 3.0 * R / SINE / 0.008
    (sticks,) = run.records["contact_sticks"]
    assert sticks.time_s == pytest.approx(2.0 / rate, abs=1e-9)
    assert run["contact.robot_funnel_force_z_N"][-1] == pytest.approx(-3.0, abs=1e-9)
    assert abs(run.qvel[-1]).max() < 1e-11


def test_a_rim_that_is_curved_as_the_cone_ends_the_run(tmp_path):
    """Tilted by the half angle, a cylinder on the axis has its side in line with a generator, curved as the cone there."""
    pin = ball("pin").replace('type="sphere" size="0.1"', 'type="cylinder" size="0.1 0.2"')
    tilt = ALPHA + 1e-3
    turn = [math.cos(tilt / 2), 0, math.sin(tilt / 2), 0]
    along = np.array([math.sin(tilt), 0, math.cos(tilt)])
    start = {
        "joints": {"robot/free": [*(0.2 * along + np.array([0, 0, 0.6])), *turn]},
        "rates": {"robot/free": [0, 0, -0.6, 0, 0, 0]},
    }
    run = ffsm_mj.run(in_funnel(tmp_path, pin, initial=start, duration_s=1.5))
    assert run.outcome == "unsupported_contact", run.message


def test_a_corner_slides_out_over_the_mouth(tmp_path):
    """Its contact ends there, and nothing acts on it any more."""
    lone = box("box", half=(0.1, 0.1, 0.1))
    corner = math.atan(math.sqrt(2.0))
    turn = [math.cos(corner / 2), math.sin(corner / 2) / math.sqrt(2.0), -math.sin(corner / 2) / math.sqrt(2.0), 0]
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, np.array(turn))
    arms = 0.1 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) @ matrix.reshape(3, 3).T
    arm = arms[np.argmin(arms @ INWARD)]
    centre = 2.2 * UP - arm
    start = {"joints": {"robot/free": [*centre, *turn]}, "rates": {"robot/free": [*(0.5 * UP), 0, 0, 0]}}
    run = ffsm_mj.run(in_funnel(tmp_path, lone, initial=start))
    assert_passes(run)
    (contact,) = run.contacts
    assert contact.end_s == pytest.approx((2.0 / COSINE - 2.2) / 0.5, abs=1e-8)
    assert run.qvel[-1, :3] == pytest.approx(0.5 * UP, abs=1e-12)


def test_a_sphere_rolls_round_the_rim_of_the_mouth(tmp_path):
    """Pressed to the surface by gravity against its normal, it leaves over the rim as over an edge.

    Without friction its centre is on a circle of radius R about the rim: v^2 = v0^2 + 2 g R (1 - cos t), until the force on
    it, m (g cos t - v^2 / R), vanishes: cos t = (v0^2 / (g R) + 2) / 3.
    """
    g, v0 = 2.0, 0.2
    down = -g * INWARD
    robot = ball("ball", radius=R).replace("0 0 0", " ".join(map(str, down)), 1)
    start = {
        "joints": {"robot/free": [*(2.2 * UP + R * INWARD), 1, 0, 0, 0]},
        "rates": {"robot/free": [*(v0 * UP), 0, 0, 0]},
    }
    run = ffsm_mj.run(in_funnel(tmp_path, robot, initial=start, conservative=False, duration_s=1.5))
    assert_passes(run)
    (contact,) = run.contacts
    after = np.flatnonzero(np.arange(len(run.qpos)) * 0.01 > contact.end_s)[0]
    speed = np.linalg.norm(run.qvel[after, :3])
    rim = 2.0 / COSINE * UP

    def height(place):
        return (place - rim) @ INWARD

    assert 0.5 * speed**2 + g * height(run.qpos[after, :3]) == pytest.approx(0.5 * v0**2 + g * R, abs=1e-9)
    turned = math.acos((v0**2 / (g * R) + 2.0) / 3.0)
    left = g * R * (1.0 - math.cos(turned)) + 0.5 * v0**2
    # From there it falls freely: back from the next sample to the end of the contact.
    back = after * 0.01 - contact.end_s
    place = run.qpos[after, :3] - run.qvel[after, :3] * back + 0.5 * down * back**2
    assert height(place) == pytest.approx(R * math.cos(turned), abs=1e-7)
    assert 0.5 * np.linalg.norm(run.qvel[after, :3] - down * back) ** 2 == pytest.approx(left, abs=1e-7)


@pytest.mark.parametrize("shape", ["sphere", "box"])
def test_a_body_from_behind_ends_the_run(tmp_path, shape):
    """It passes the surface where that is open: from behind there is nothing, and an overlap would say nothing of it."""
    size = {"sphere": "0.05", "box": "0.05 0.05 0.05"}[shape]
    robot = ball("ball").replace('type="sphere" size="0.1"', f'type="{shape}" size="{size}"')
    start = {"joints": {"robot/free": [1.2, 0, 1.0, 1, 0, 0, 0]}, "rates": {"robot/free": [-1.0, 0, 0, 0, 0, 0]}}
    run = ffsm_mj.run(in_funnel(tmp_path, robot, initial=start))
    assert run.outcome == "unsupported_contact"
    assert "comes through the surface of the cone from behind" in run.message
    # A sphere where all of it is inside, a box where its first corner is; the last row is that of the tick before.
    slope = SINE / COSINE
    x_m = slope - 0.05 / COSINE if shape == "sphere" else 0.05 + math.sqrt((1.05 * slope) ** 2 - 0.05**2)
    assert 0.0 <= 1.2 - x_m - run.time[-1] <= 0.012


def test_a_body_behind_a_cone_is_refused_at_the_start(tmp_path):
    start = {"joints": {"robot/free": [SINE / COSINE - 0.03, 0, 1.0, 1, 0, 0, 0]}}
    with pytest.raises(InputError, match="a cone is seen from inside; its outside is made of geoms of its body"):
        ffsm_mj.run(in_funnel(tmp_path, ball("ball"), initial=start))


def test_in_over_the_mouth(tmp_path):
    """From outside, past the rim, to the surface: the first contact is exact, whatever the step."""
    start = {"joints": {"robot/free": [0.2, 0, 3.0, 1, 0, 0, 0]}, "rates": {"robot/free": [0.5, 0, -1.0, 0, 0, 0]}}
    times, ends = [], []
    for step in (0.01, 0.0025):
        folder = tmp_path / str(step)
        folder.mkdir()
        more = {"time_step_s": step, "initial": start, "duration_s": 2.5, "restitution": 1.0}
        run = ffsm_mj.run(in_funnel(folder, ball("ball", radius=R), **more))
        assert_passes(run)
        times.append([impact.time_s for impact in run.impacts])
        ends.append(run.qpos[-1, :3])
    # (3 - t) sin - (0.2 + t / 2) cos = R
    first = (3.0 * SINE - 0.2 * COSINE - R) / (SINE + 0.5 * COSINE)
    assert times[0][0] == pytest.approx(first, abs=1e-13)
    assert times[0] == pytest.approx(times[1], abs=1e-12)
    assert ends[0] == pytest.approx(ends[1], abs=1e-12)


def test_boosts_and_turns_of_everything_change_nothing(tmp_path):
    """The same motion in a cone on a body that floats, turned and moving: relative states agree."""
    turn = np.array([0.6, 0.2, -0.5, 0.0])
    turn[3] = math.sqrt(1.0 - turn @ turn)
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, turn)
    matrix = matrix.reshape(3, 3)
    boost, away = np.array([0.3, -0.2, 0.1]), np.array([1.0, 2.0, -1.0])
    velocity = -0.2 * UP + 0.3 * np.array([0.0, 1.0, 0.0]) - 0.3 * INWARD
    ends = []
    for moves in (False, True):
        folder = tmp_path / str(moves)
        folder.mkdir()
        rotate = matrix if moves else np.eye(3)
        there, along = (away, boost) if moves else (np.zeros(3), np.zeros(3))
        quaternion = turn.tolist() if moves else [1, 0, 0, 0]
        holder = box("holder", mass=4.0, half=(0.1, 0.1, 0.1)).replace(
            'name="holder" type', 'name="holder" contype="0" conaffinity="0" type'
        )
        path = scene(
            folder,
            ball("ball", radius=R),
            {"holder": holder},
            time_step_s=0.002,
            control_period_s=0.01,
            initial={
                "joints": {
                    "robot/free": [*(there + rotate @ placed(0.5, 0.05)), *quaternion],
                    "holder/free": [*there, *quaternion],
                },
                "rates": {"robot/free": [*(along + rotate @ velocity), 0, 0, 0], "holder/free": [*along, 0, 0, 0]},
            },
            contacts={"rules": [{"between": ["robot", "holder"], "restitution": 0.3, "mu": 0.2}]},
        )
        data = json.loads(path.read_text())
        data["objects"]["holder"]["cones"] = [FUNNEL | {"body": "holder"}]
        path.write_text(json.dumps(data))
        run = ffsm_mj.run(path)
        assert_passes(run)
        assert len(run.impacts) >= 1
        places = run.qpos[:, :3] - run.qpos[:, 7:10]
        ends.append((places @ rotate, run.qvel[:, 3:6], [impact.impulse_N_s for impact in run.impacts]))
        assert_replayed(run)
    (places, spins, impulses), (others, other_spins, other_impulses) = ends
    assert places == pytest.approx(others, abs=1e-12)
    assert spins == pytest.approx(other_spins, abs=1e-10)
    assert impulses == pytest.approx(other_impulses, abs=1e-12)


def test_a_round_ring_keeps_the_energy_that_facets_take(tmp_path):
    """One turn at e = 0 in a cone of 1 degree, nearly a cylinder: a ring of N facets keeps cos(2 pi / N)^(2 N) of it."""
    slope = math.radians(1.0)
    rho = 0.4
    height = (R + rho * math.cos(slope)) / math.sin(slope)
    start = {"joints": {"robot/free": [rho, 0, height, 1, 0, 0, 0]}, "rates": {"robot/free": [0, 1.0, 0, 0, 0, 0]}}
    cone = {"half_angle_deg": 1.0, "length_m": height + 5.0, "from_m": height - 5.0}
    run = ffsm_mj.run(in_funnel(tmp_path, ball("ball", radius=R), cone=cone, initial=start, duration_s=2.6))
    assert_passes(run)
    assert np.linalg.norm(run.qvel[-1, :3]) ** 2 == pytest.approx(1.0, abs=1e-10)  # 64 facets: 0.539106
    turned = np.unwrap(np.arctan2(run.qpos[:, 1], run.qpos[:, 0]))[-1]
    # The geodesic: tan(turned sin(slope)) = distance / (rho / sin(slope)).
    assert turned == pytest.approx(math.atan(2.6 * math.sin(slope) / rho) / math.sin(slope), abs=1e-9)
    assert turned > 2.0 * math.pi
    assert not run.impacts


@pytest.mark.parametrize(
    ("body", "wanted"),
    [
        pytest.param("cylinder", "rim", marks=pytest.mark.long),
        pytest.param("ellipsoid", "side", marks=pytest.mark.long),
        ("mesh", "vertex"),
        ("capsule", "end"),
    ],
)
@pytest.mark.parametrize("restitution", [0.0, 1.0])
def test_thrown_about_in_a_cone(tmp_path, body, wanted, restitution):
    """Energy, momenta, penetration, forces and geometry by the checks, which compute them again."""
    mesh = '<asset><mesh name="tip" vertex="0 0 .15 0 0 -.15 .1 0 0 -.1 0 0 0 .1 0 0 -.1 0"/></asset>'
    robot = f"""<mujoco>{HEAD}{mesh}<worldbody><body name="body"><freejoint name="free"/>
      <inertial pos="0.01 0 0.02" mass="1" diaginertia="0.01 0.012 0.008"/>
      <geom name="body" {GEOMS[body]} mass="0"/></body></worldbody></mujoco>"""
    start = {"joints": {"robot/free": [0.3, 0.1, 1.3, *TURN]}, "rates": {"robot/free": [-0.2, 0.3, -0.9, 1.0, -0.5, 0.7]}}
    run = ffsm_mj.run(in_funnel(tmp_path, robot, restitution=restitution, mu=0.1, initial=start, time_step_s=1e-3))
    assert_passes(run)
    assert run.impacts
    assert all(f"body-cone {wanted}" in impact.pair for impact in run.impacts)
    assert_replayed(run)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"half_angle_deg": 90.0}, "half_angle_deg"),
        ({"half_angle_deg": 0.0}, "half_angle_deg"),
        ({"half_angle_deg": -20.0}, "half_angle_deg"),
        ({"axis": [0, 0, 0]}, "axis: must have a direction; all its components are zero"),
        ({"length_m": -1.0}, "length_m"),
        ({"from_m": 2.0}, "from_m: must be less than length_m, which is 2"),
        ({"from_m": -0.1}, "from_m"),
        ({"body": "nose"}, "body: unknown body 'nose'"),
        ({"name": "back"}, "name: the model already has a geom 'back'"),
        ({"radius_m": 1.0}, "radius_m"),
    ],
)
def test_bad_input(tmp_path, changed, message):
    path = in_funnel(tmp_path, ball("ball", radius=R), cone=changed)
    with pytest.raises(InputError) as refused:
        prepare(path)
    (line,) = refused.value.lines
    assert "objects.funnel.cones" in line
    assert message in line, line
    assert line.startswith(f"{path}:1:")


def test_two_cones_of_one_name(tmp_path):
    path = in_funnel(tmp_path, ball("ball", radius=R))
    data = json.loads(path.read_text())
    data["objects"]["funnel"]["cones"] *= 2
    path.write_text(json.dumps(data))
    with pytest.raises(InputError, match="two cones are named 'cone'"):
        prepare(path)


def test_what_check_says(tmp_path, capsys):
    start = {"joints": {"robot/free": [0, 0, 1.0, 1, 0, 0, 0]}}
    assert main(["check", str(in_funnel(tmp_path, ball("ball", radius=R), initial=start))]) == 0
    line = next(line for line in capsys.readouterr().out.splitlines() if "funnel/cone" in line)
    assert "half angle 30 deg, from 0 to 2 m from the apex, mouth of radius 1.155 m; 1 geom may touch it" in line


def test_names_of_a_cone_in_rules(tmp_path):
    """Alone by its name, and ignored."""
    path = in_funnel(tmp_path, ball("ball", radius=R), initial={"joints": {"robot/free": [0, 0, 1.0, 1, 0, 0, 0]}})
    data = json.loads(path.read_text())
    for between, ignored, names in (
        (["ball", "funnel/cone"], [], ["ball-funnel/cone"]),
        (["ball", "funnel"], [], ["ball-back", "ball-cone"]),
        (["ball", "funnel"], [{"between": ["robot", "funnel/cone"], "reason": "far"}], ["ball-back"]),
    ):
        data["contacts"] = {"rules": [{"between": between}], "ignored": ignored}
        path.write_text(json.dumps(data))
        assembly = prepare(path).assemble()
        assert [pair.name for pair in assembly.pairs] == names
        assert not any("cone" in line for line in contact_notes(assembly.contacts, assembly.system))


def test_a_plane_meets_no_cone(tmp_path):
    """By default, of a robot that has one, over the ground."""
    ground = f'<mujoco>{HEAD}<worldbody><geom name="g" type="plane" size="0 0 1"/></worldbody></mujoco>'
    start = {"joints": {"robot/free": [0, 0, 1, 1, 0, 0, 0]}}
    path = scene(tmp_path, ball("ball"), {"ground": ground}, fixed={"ground": {}}, initial=start)
    data = json.loads(path.read_text())
    data["robot"]["cones"] = [FUNNEL | {"body": "ball"}]
    del data["contacts"]
    path.write_text(json.dumps(data))
    assert [str(pair) for pair in prepare(path).assemble().pairs] == ["robot/ball - ground/g"]
    data["contacts"] = {"rules": [{"between": ["robot/cone", "ground/g"]}]}
    path.write_text(json.dumps(data))
    with pytest.raises(InputError, match="geom 'ground/g' is no convex shape that fits inside a cone"):
        prepare(path)


def test_the_scene_of_a_viewer_has_the_gaps(tmp_path):
    """The signed distance and the nearest points of the pair, not those of the mesh that is drawn."""
    start = {"joints": {"robot/free": [*placed(0.5, 0.2), 1, 0, 0, 0]}}
    assembly = prepare(in_funnel(tmp_path, ball("ball", radius=R), initial=start)).assemble()
    pair = next(pair for pair in initial_scene(assembly, []).pairs if "cone" in pair.name)
    gap, ends = pair.nearest
    assert gap == pytest.approx(0.2, abs=1e-14)
    assert ends == pytest.approx(np.stack((placed(0.5, 0.2) - 0.3 * INWARD, placed(0.5, 0.2) - R * INWARD)), abs=1e-14)
    (drawn,) = (shape for shape in shapes(assembly.system) if shape.name == "cone")
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, drawn.quaternion)
    corners = drawn.vertices @ turn.reshape(3, 3).T + drawn.position
    assert np.hypot(corners[:, 0], corners[:, 1]) * COSINE == pytest.approx(corners[:, 2] * SINE, abs=1e-6)
    assert corners[:, 2].max() == pytest.approx(2.0, abs=1e-6)


@pytest.mark.parametrize("body", ["sphere", pytest.param("cylinder", marks=pytest.mark.long)])
def test_it_goes_on_from_a_saved_state(tmp_path, body):
    """In contact, bit for bit, in another simulator; that of the state itself goes on too."""
    robot = f"""<mujoco>{HEAD}<worldbody><body name="body"><freejoint name="free"/>
      <inertial pos="0.01 0 0.02" mass="1" diaginertia="0.01 0.012 0.008"/>
      <geom name="body" {GEOMS[body]} mass="0"/></body></worldbody></mujoco>"""
    start = {"joints": {"robot/free": [0.3, 0.1, 1.3, *TURN]}, "rates": {"robot/free": [-0.2, 0.3, -0.9, 1.0, -0.5, 0.7]}}
    path = in_funnel(tmp_path, robot, mu=0.1, initial=start)
    simulator = ffsm_mj.Simulator(path, {})
    simulator.reset()
    simulator.step(until=0.8)
    saved = simulator.get_state().to_bytes()
    assert b"OnCone" in saved
    while not simulator.ended:
        simulator.step()
    assert is_rest_of(told(simulator.close()), rest(path, {}, saved))


def test_notes_on_a_cone():
    """While the hard latch is closed, the bus and the cone are of one rigid body; the cone's picture is no hull."""
    lines = describe(prepare("probe-and-cone").assemble())
    assert not any("bus-cone" in line for line in lines if "convex hull" in line)
    (line,) = (line for line in lines if "while 'hard' is closed" in line)
    assert "bus-hull, bus-panel, bus-cone, head-hull and 2 more" in line


@pytest.mark.long
def test_a_replay_tells_the_sides_of_a_rim_by_their_points(tmp_path):
    """Which side a place is follows from the places before, of which a log has few: impact 3 was that of the other one."""
    robot = f"""<mujoco>{HEAD.replace("0 0 0", "0 0 -2")}<worldbody><body name="body"><freejoint name="free"/>
      <inertial pos="0.005 0 0.01" mass="1" diaginertia="0.01 0.012 0.008"/>
      <geom name="body" type="cylinder" size="0.1 0.15" mass="0"/></body></worldbody></mujoco>"""
    turn = np.array([0.0925069255140471, -0.161766004687774, -0.6281689598732155, 0.7554323174918424])
    place = [0.08694236741562315, 0.07559834146626095, 1.2245710085172405, *(turn / np.linalg.norm(turn)).tolist()]
    rates = [
        0.7956319041270241,
        -0.8170022434574413,
        -0.9233833651154761,
        -1.5515218924680023,
        1.0105092031010718,
        1.7363542260087632,
    ]
    start = {"joints": {"robot/free": place}, "rates": {"robot/free": rates}}
    more = {"initial": start, "restitution": 1.0, "conservative": False, "duration_s": 1.2}
    run = ffsm_mj.run(in_funnel(tmp_path, robot, cone={"half_angle_deg": 40.0}, **more))
    assert len(run.impacts) == 4
    assert replay_log(run.log).agrees
