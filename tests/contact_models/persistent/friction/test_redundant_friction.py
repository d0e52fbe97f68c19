"""Patches of points that share a load, wedges, and what starts to slip: published digits."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ffsm_mj
from tests.contact_models.persistent.friction.scenes import final, heat, load, loaded, slips, steps, yaw
from tests.contact_models.persistent.test_closed_forms import wedge
from tests.replays import proved
from tests.scenes import ball, box, scene

PLATE_HALF, BLOCK_HALF = (1.0, 1.0, 0.05), (0.2, 0.1, 0.05)


def pushed_off_centre(folder, step):
    """A block of 1 kg on a free plate of 3 kg, pressed by 2 N at its centre and pushed by 0.9 t beside it, all inside."""
    inside = {"on": "block/block", "reaction": "robot/plate", "axes": "robot/plate"}
    return scene(
        folder,
        box("plate", mass=3.0, half=PLATE_HALF),
        {"block": box("block", mass=1.0, half=BLOCK_HALF)},
        initial={"joints": {"block/free": [0.1, 0.05, 0.1, 1, 0, 0, 0]}},
        contacts={"rules": [{"between": ["plate", "block/block"], "restitution": 0.0, "mu": 0.3}]},
        contact_models=loaded(
            inside | {"force_N": [[0, 0, -2]]},
            inside | {"force_N": [[0, 0, 0], [0, 0.9, 0]], "at_m": [0.2, 0, 0]},
        ),
        **steps(step, 0.6),
    )


def corner_slips(run):
    """Speeds at the block's lower corners relative to the plate at the end, m/s, (4,)."""
    poses = {name: (final(run, f"q_{name}_free"), final(run, f"v_{name}_free")) for name in ("robot", "block")}

    def turned(name, vector):
        result = np.empty(3)
        mujoco.mju_rotVecQuat(result, np.array(vector, dtype=float), poses[name][0][3:])
        return result

    def velocity(name, point):
        pose, rates = poses[name]
        return rates[:3] + np.cross(turned(name, rates[3:]), point - pose[:3])

    found = []
    for x in (-0.2, 0.2):
        for y in (-0.1, 0.1):
            point = poses["block"][0][:3] + turned("block", (x, y, -0.05))
            found.append(np.linalg.norm(velocity("block", point) - velocity("robot", point)))
    return np.array(found)


@pytest.mark.long
@pytest.mark.parametrize("step", [8e-3, 4e-3, 2e-3, 1e-3, 5e-4])
def test_a_block_turns_off_on_a_free_plate(tmp_path, step):
    """It holds as long as any forces at its corners would; then it slides and turns about a point beside it."""
    run = proved(ffsm_mj.run(pushed_off_centre(tmp_path, step)))
    assert slips(run)[0] == pytest.approx(0.423158259833, abs=1e-8)
    allowed = 1e-7 * (step / 4e-3) ** 4 + 1e-8
    assert sorted(corner_slips(run)) == pytest.approx(
        sorted([0.014323610, 0.009197310, 0.050241500, 0.049026860]), abs=allowed
    )
    assert heat(run) == pytest.approx(0.00108451029, abs=allowed)
    assert yaw(run, "q_block_free") == pytest.approx(0.00673856544, abs=allowed)
    for component in ("P_x_N_s", "P_y_N_s", "L_z_N_m_s"):
        assert np.abs(run[f"momentum.total_{component}"]).max() < 1e-12


def in_a_v(folder, half_angle, mu, force_angle, *, more=(), duration=0.008):
    """A free ball of 1 kg in a V about z, pushed by 1 N at an angle to its axis (0: into the V)."""
    beta, alpha = np.deg2rad(half_angle), np.deg2rad(force_angle)
    return scene(
        folder,
        ball("ball", mass=1.0),
        {"left": wedge("left", 90 - half_angle), "right": wedge("right", half_angle - 90)},
        fixed={"left": {}, "right": {}},
        initial={"joints": {"robot/free": [0, 0, 0.1 / np.sin(beta), 1, 0, 0, 0]}},
        contacts={
            "rules": [{"between": ["ball", f"{side}/{side}"], "restitution": 0.0, "mu": mu} for side in ("left", "right")]
        },
        contact_models=loaded(load("robot/ball", "left/left", force_N=[[np.sin(alpha), 0, -np.cos(alpha)], *more])),
        **steps(4e-3, duration),
    )


@pytest.mark.long
@pytest.mark.parametrize(("half_angle", "mu", "limit"), [(30, 0.5, 60.0), (45, 0.5, 45.0), (60, 0.5, 30.0), (60, 1.5, 30.0)])
def test_a_ball_in_a_v_is_held_up_to_the_normal_of_a_face(tmp_path, half_angle, mu, limit):
    """Below tan(beta) the faces cannot hold the ball between them: it leaves one where nothing presses it there."""
    for angle, moves in ((limit - 1e-3, False), (limit + 1e-3, True)):
        folder = tmp_path / str(angle)
        folder.mkdir()
        run = proved(ffsm_mj.run(in_a_v(folder, half_angle, mu, angle)))
        # 1e-3 degrees are 1.7e-5 of 1 N along the face for 0.008 s, of which a rolling ball has 5/7.
        assert bool(np.abs(final(run, "v_robot_free")[:3]).max() > 1e-8) is moves


@pytest.mark.long
@pytest.mark.parametrize("angle", [0.0, 59.0, 61.0, 120.0])
def test_a_wedged_ball_is_held_whatever_pulls(tmp_path, angle):
    """Above tan(beta) forces between the faces hold the ball against loads that would lift it off one of them."""
    run = proved(ffsm_mj.run(in_a_v(tmp_path, 30, 0.8, angle)))
    assert np.abs(final(run, "v_robot_free")).max() < 1e-12


@pytest.mark.parametrize(("mu", "stays"), [(0.8, True), (0.5, False)])
def test_a_ball_pressed_into_a_v_stays_when_pulled_out_if_it_is_wedged(tmp_path, mu, stays):
    """The load turns round at 0.01 s: opening solves the problem as well, but present modes that are valid are kept."""
    path = in_a_v(tmp_path, 30, mu, 0.0, more=[[0, 0, 100]], duration=0.02)
    run = proved(ffsm_mj.run(path))
    assert bool(np.abs(final(run, "v_robot_free")).max() < 1e-12) is stays
