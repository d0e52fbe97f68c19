"""Fixed bodies: robot and objects hit them; they exchange external momentum and no energy."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.records.signals import COMPONENTS
from ffsm_mj.replay import replay_log
from tests.contact_models import scenes
from tests.replays import proved
from tests.scenes import HEAD, ball, box, scene


def slab(name, half="5 5 0.5"):
    """MJCF of a box fixed in the world of its file; its mass is irrelevant."""
    return f'<mujoco>{HEAD}<worldbody><geom name="{name}" type="box" size="{half}" mass="1e4"/></worldbody></mujoco>'


def external_impulse(run, subsystem):
    """Impulse of fixed bodies on a subsystem during the run: (P, L about the origin)."""
    return np.array([run[f"balance.fixed_on_{subsystem}_{component}"][-1] for component in COMPONENTS])


def bouncing(folder, **scenario):
    """The robot, a ball of 2 kg that slides in x and z, falls at 1 m/s on a floor whose top is at z = 0, 0.3 m below it."""
    return scene(
        folder,
        ball("ball", mass=2.0, joints="xz"),
        {"floor": slab("floor")},
        fixed={"floor": {"position_m": [0, 0, -0.5]}},
        **{
            "initial": {"joints": {"robot/z": 0.4}, "rates": {"robot/z": -1.0, "robot/x": 0.3}},
            "contacts": {"rules": [{"between": ["ball", "floor/floor"], "restitution": 0.7}]},
            **scenario,
        },
    )


def test_a_ball_on_a_fixed_floor(tmp_path):
    """Closed form: v = -e v along the normal, the tangential part unchanged; the floor gives (1 + e) m v, and no work."""
    run = proved(ffsm_mj.run(bouncing(tmp_path)))
    (hit,) = run.impacts
    # All numbers are below 4 in SI units: rounding is some 1e-16 of each, and a root good to 1e-14 m at 1 m/s.
    assert hit.time_s == pytest.approx(0.3, abs=1e-13)
    assert (hit.qvel_after["robot/z"], hit.qvel_after["robot/x"]) == (pytest.approx((0.7,), abs=1e-14), (0.3,))
    assert (hit.robot_geom, hit.object_geom) == ("robot/ball", "floor/floor")
    assert hit.impulse_N_s == pytest.approx(2.0 * 1.7, rel=1e-14)
    assert hit.energy_change_J == pytest.approx(-0.5 * 2.0 * (1 - 0.7**2), rel=1e-14)
    # Of everything that moves: not conserved, and the record says so. L about the origin: the hit is 0.09 m along x from it.
    assert hit.linear_momentum_change_N_s == pytest.approx(3.4, rel=1e-14)
    assert hit.angular_momentum_change_N_m_s == pytest.approx(3.4 * 0.09, rel=1e-12)
    # On the floor, about the origin of its frame.
    np.testing.assert_allclose(hit.angular_impulse_N_m_s, (0.0, 3.4 * 0.09, 0.0), atol=1e-12)
    np.testing.assert_allclose(external_impulse(run, "robot"), (0, 0, 3.4, 0, -3.4 * 0.09, 0), atol=1e-12)
    assert not external_impulse(run, "objects").any()
    assert not any(run[f"balance.contact_{component}"].any() for component in COMPONENTS)


def test_a_spinning_box_on_a_tilted_wall(tmp_path):
    """A corner hits obliquely: impulse (1 + e) u / (1/m + (r x n) I^-1 (r x n)), from poses and rates alone."""
    mass, half = 3.0, np.array((0.2, 0.3, 0.1))
    tilt = np.deg2rad(25.0)
    path = scene(
        tmp_path,
        ball("ball"),
        {"box": box("box", mass=mass, half=tuple(half)), "wall": slab("wall")},
        # Its top, turned about y, goes through the origin.
        fixed={
            "wall": {
                "position_m": [-0.5 * np.sin(tilt), 0.0, -0.5 * np.cos(tilt)],
                "quaternion": [np.cos(tilt / 2), 0.0, np.sin(tilt / 2), 0.0],
            }
        },
        initial={
            "joints": {"robot/free": [0, 9, 0, 1, 0, 0, 0], "box/free": [0.3, -0.4, 0.8, 0.8, 0.4, -0.2, 0.4]},
            "rates": {"box/free": [-0.2, 0.3, -1.1, 0.9, -0.7, 1.3]},
        },
        contacts={"rules": [{"between": ["wall/wall", "box/box"], "restitution": 0.6}]},
        stop_on_impact=True,
    )
    run = proved(ffsm_mj.run(path))
    (hit,) = run.impacts
    n, point = np.array(hit.normal), np.array(hit.point_m)
    np.testing.assert_allclose(n, (np.sin(tilt), 0.0, np.cos(tilt)), atol=1e-13)
    assert abs(n @ point) < 1e-12
    place = np.array(hit.qpos[-7:])
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, place[3:])
    turn = turn.reshape(3, 3)
    r, rates = point - place[:3], np.array(hit.qvel_before["box/free"])
    np.testing.assert_allclose(np.abs(turn.T @ r), half, atol=1e-12)  # a corner of it
    a, b, c = (2 * half) ** 2
    inverse = turn @ np.diag(12.0 / mass / np.array((b + c, a + c, a + b))) @ turn.T
    u = n @ (rates[:3] + np.cross(turn @ rates[3:], r))
    arm = np.cross(r, n)
    impulse = -1.6 * u / (1.0 / mass + arm @ inverse @ arm)
    # The inertias are some 0.1, condition 10: rounding is 1e-15 of the impulse, and point and pose are as good as MuJoCo's.
    assert hit.impulse_N_s == pytest.approx(impulse, rel=1e-12)
    after = np.array(hit.qvel_after["box/free"])
    np.testing.assert_allclose(after[:3], rates[:3] + impulse / mass * n, atol=1e-12)
    np.testing.assert_allclose(turn @ after[3:], turn @ rates[3:] + inverse @ arm * impulse, atol=1e-11)
    assert (hit.robot_geom, hit.object_geom) == ("", "")
    np.testing.assert_allclose(
        external_impulse(run, "objects"), np.concatenate((impulse * n, np.cross(point, impulse * n))), atol=1e-12
    )
    assert not external_impulse(run, "robot").any()


def between(folder, restitution, **scenario):
    """The robot, 2 kg, reaches a wall at x = 0.6 after 0.2 s with a free ball of 3 kg in contact behind it, at 1 m/s."""
    return scene(
        folder,
        ball("hand", mass=2.0, joints="x"),
        {"rock": ball("rock", mass=3.0, joints="x"), "wall": slab("wall", "0.5 1 1")},
        fixed={"wall": {"position_m": [1.1, 0, 0]}},
        **{
            "duration_s": 0.4,
            "initial": {"joints": {"robot/x": 0.3, "rock/x": 0.1}, "rates": {"robot/x": 1.0, "rock/x": 1.0}},
            "contacts": {
                "rules": [
                    {"between": ["hand", "rock/rock"], "restitution": restitution},
                    {"between": ["wall/wall", "hand"], "restitution": restitution},
                ]
            },
            **scenario,
        },
    )


def test_the_robot_between_an_object_and_a_wall_in_one_instant(tmp_path):
    """All stop at e = 0: the ball's 3 N s pass through the robot, and the wall takes 5 N s."""
    run = proved(ffsm_mj.run(between(tmp_path, 0.0)))
    on_rock, on_hand = run.impacts
    assert (on_rock.event, on_hand.event) == (0, 0)
    assert on_rock.time_s == pytest.approx(0.2, abs=1e-9)  # the gap of the two in touch is rounding of 1e-17 m
    assert (on_rock.impulse_N_s, on_hand.impulse_N_s) == (pytest.approx(3.0, abs=1e-12), pytest.approx(5.0, abs=1e-12))
    assert [run[f"state.v_{name}_x_m_s"][-1] for name in ("robot", "rock")] == pytest.approx([0.0, 0.0], abs=1e-13)
    assert external_impulse(run, "robot")[0] == pytest.approx(-5.0, abs=1e-12)
    assert not external_impulse(run, "objects").any()
    assert run["balance.contact_P_x_N_s"][-1] == pytest.approx(-3.0, abs=1e-12)
    by_party = [run[f"balance.{subsystem}_impact_energy_J"][-1] for subsystem in ("total", "robot", "objects")]
    assert by_party == pytest.approx([-2.5, -1.0, -1.5], abs=1e-12)


def both(folder, **scenario):
    """Robot (2 kg, e = 0.5) and ball (3 kg, e = 0.8), side by side at 1 m/s, hit a wall at x = 0.5 after 0.4 s."""
    return scene(
        folder,
        ball("hand", mass=2.0, joints="xz"),
        {"wall": slab("wall", "0.5 3 3"), "rock": ball("rock", mass=3.0)},
        fixed={"wall": {"position_m": [1.0, 0, 0]}},
        **{
            "initial": {
                "joints": {"rock/free": [0.0, 1.0, 0.0, 1, 0, 0, 0]},
                "rates": {"robot/x": 1.0, "rock/free": [1.0, 0, 0, 0.2, 0.1, 0.3]},
            },
            "contacts": {
                "rules": [
                    {"between": ["hand", "wall/wall"], "restitution": 0.5},
                    {"between": ["rock/rock", "wall/wall"], "restitution": 0.8},
                ]
            },
            **scenario,
        },
    )


def test_robot_and_object_hit_one_wall_at_once(tmp_path):
    """One wrench on each subsystem: -(1 + e) m v, with the ball's moment about the origin; nothing between the two."""
    run = proved(ffsm_mj.run(both(tmp_path)))
    assert [record.event for record in run.impacts] == [0, 0]
    np.testing.assert_allclose(external_impulse(run, "robot"), (-3.0, 0, 0, 0, 0, 0), atol=1e-13)
    np.testing.assert_allclose(external_impulse(run, "objects"), (-5.4, 0, 0, 0, 0, 5.4), atol=1e-13)
    assert not any(run[f"balance.contact_{component}"].any() for component in COMPONENTS)
    assert not run["balance.total_residual_P_y_N_s"].any()


def test_the_balance_continues_after_a_gap_in_the_log(tmp_path):
    """Samples before, at and after the impact are missing: the log gives the impulse there."""
    run = ffsm_mj.run(both(tmp_path))
    keep = np.r_[0:390, 420:1001]
    again = replay_log(replace(run.log, rows=run.log.rows[keep]))
    assert "missing from 0.389 to 0.42 s" in again.gaps
    assert again.agrees, again.worst
    assert all(check.passes for check in again.checks())


@pytest.mark.long
@pytest.mark.usefixtures("example_contact_models")
@pytest.mark.parametrize(
    ("subsystem", "geoms", "mass", "joint"),
    [("robot", ["ball", "wall/wall"], 2.0, "robot"), ("objects", ["wall/wall", "target/target"], 3.0, "target")],
)
def test_wrenches_of_a_spring_on_a_wall_are_external(tmp_path, subsystem, geoms, mass, joint):
    """A contact model names both bodies that it acts on; the part of the wall is found by its body."""
    path = scenes.spring(
        tmp_path / subsystem,
        others={"wall": slab("wall", "0.1 2 2")},
        fixed={"wall": {"position_m": [0.25 if subsystem == "robot" else 0.55, 0, 0]}},  # 0.05 m away
        duration_s=0.36,
        initial={
            "joints": {"target/free": [0.3, 0.5, 0.01, 1, 0, 0, 0]},
            "rates": {"robot/free": [0.9, 0, 0, 0, 0, 3.0], "target/free": [0.9, 0.1, 0, 0, 0, 0]},
        },
        contact_models=[{"kind": "spring", "geoms": geoms, "stiffness_N_m": 400.0}],
    )
    run = ffsm_mj.run(path)
    assert [check for check in all_checks(run) if not check.passes] == []
    speed = run[f"state.v_{joint}_free_vx_m_s"]
    assert speed[-1] == pytest.approx(-speed[0], rel=1e-6)  # it gives back what it took, to the order of the step
    # The balance follows the motion to 1e-9 (1 + scale), the tolerance of the checks.
    assert external_impulse(run, subsystem)[0] == pytest.approx(mass * (speed[-1] - speed[0]), abs=1e-8)
    assert not external_impulse(run, "objects" if subsystem == "robot" else "robot").any()
    assert not any(run[f"balance.contact_{component}"].any() for component in COMPONENTS)
