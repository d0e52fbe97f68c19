"""Motion over seams does not depend on the observer, the step, restarts or other runs."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from tests.contact.unions.drawing import cut
from tests.contact.unions.judge import sound
from tests.contact.unions.scenes import fixed, free, geoms, on
from tests.contact.unions.test_slides import BALL, CUBE, HALVES, place
from tests.contact.unions.test_steps import STILL
from tests.random_scenes.dice import Dice, numbers
from tests.scenes import scene
from tests.simulation.restored import goes_on, is_rest_of, told
from tests.simulators import closed_simulators  # noqa: F401

PLATE = cut(Dice(5, "plate"), [((-0.5, -0.5, -0.1), (0.5, 0.5, 0.0))], 6)
ACROSS = {"joints": [-0.25, 0.01, 0.1, math.cos(0.2), 0, 0, math.sin(0.2)], "rates": [1, 0, 0, 0, 0, 0], "mu": 0.1}
"""Case 3 of the slides: the seam is below the box from 0.1 to 0.6 s."""


def rotated(q, v):
    out = np.empty(3)
    mujoco.mju_rotVecQuat(out, np.array(v, dtype=float), np.array(q, dtype=float))
    return out


def product(p, q):
    out = np.empty(4)
    mujoco.mju_mulQuat(out, np.array(p, dtype=float), np.array(q, dtype=float))
    return out


def landed(folder, turn=(1.0, 0.0, 0.0, 0.0), boost=(0.0, 0.0, 0.0), shift=(0.0, 0.0, 0.0)):
    """A cube lands on a floating plate of six pieces, slides and turns on it; its run, and its path in axes of the plate."""
    q = np.array(turn) / np.linalg.norm(turn)

    def state(position, quaternion, velocity, rate):
        return [*(rotated(q, position) + shift), *product(q, quaternion)], [*(rotated(q, velocity) + boost), *rate]

    cube = state((-0.05, 0.02, 0.15), (math.cos(0.2), 0, 0, math.sin(0.2)), (0.6, 0.2, -0.5), (0.2, 0.1, 1.0))
    plate = state((0, 0, 0), (1, 0, 0, 0), (0, 0, 0.1), (0.05, -0.1, 0.02))
    path = scene(
        folder,
        free('<geom name="g" type="box" size=".1 .1 .1" mass="0"/>', gravity=STILL),
        {"plate": free(geoms(PLATE), name="plate", mass=8.0, inertia=(0.7, 0.7, 1.3), gravity=STILL)},
        duration_s=0.5,
        time_step_s=1e-3,
        initial={
            "joints": {"robot/free": [*map(float, cube[0])], "plate/free": [*map(float, plate[0])]},
            "rates": {"robot/free": [*map(float, cube[1])], "plate/free": [*map(float, plate[1])]},
        },
        contacts={"rules": [{"name": "hit", "between": ["robot", "plate"], "restitution": 0.5, "mu": 0.3}]},
    )
    run = sound(ffsm_mj.run(path))
    states = {
        name: (
            np.stack([run[f"state.q_{name}_free_{x}_m"] for x in "xyz"], axis=1),
            np.stack([run[f"state.q_{name}_free_q{x}"] for x in "wxyz"], axis=1),
        )
        for name in ("robot", "plate")
    }
    (centre, _), (origin, attitude) = states["robot"], states["plate"]
    relative = [rotated(a * (1, -1, -1, -1), c - o) for c, o, a in zip(centre, origin, attitude, strict=True)]
    return run, np.array(relative)


@pytest.mark.parametrize(
    "view",
    [
        {"boost": (1.0, -0.5, 0.3)},
        {"turn": (0.3, -0.5, 0.7, 0.4)},
        {"turn": (0.8, 0.1, 0.5, -0.2), "boost": (-0.3, 0.2, 0.9), "shift": (-5.0, 8.0, 3.0)},
    ],
    ids=["boosted", "turned", "turned, boosted and moved"],
)
def test_a_landing_on_pieces_looks_the_same_from_everywhere(tmp_path, view):
    """Time of the first impact, and the path in axes of the plate, 0.5 m in 0.5 s, to 1e-9 m."""
    here, path = landed(tmp_path)
    there, other = landed(tmp_path, **view)
    assert len(here.impacts) == len(there.impacts) > 0
    assert there.impacts[0].time_s == pytest.approx(here.impacts[0].time_s, abs=1e-11)
    np.testing.assert_allclose(other, path, atol=1e-9)


def test_a_turned_floor_of_pieces(tmp_path):
    """Pose of a fixed object, gravity and state turned together: planes of the file are no longer those of the world."""
    q = np.array((0.8, 0.1, 0.5, -0.2)) / np.linalg.norm((0.8, 0.1, 0.5, -0.2))
    plain = ffsm_mj.run(on(tmp_path, CUBE, fixed(geoms(HALVES)), **ACROSS))
    gravity = f'<option gravity="{numbers(rotated(q, (0, 0, -9.81)))}"/>'
    geom = '<geom name="g" type="box" size=".1 .1 .1" mass="0"/>'
    joints, rates = ACROSS["joints"], ACROSS["rates"]
    path = on(
        tmp_path,
        free(geom, gravity=gravity),
        fixed(geoms(HALVES), gravity=gravity),
        joints=[*rotated(q, joints[:3]), *product(q, joints[3:])],
        rates=[*rotated(q, rates[:3]), *rates[3:]],
        mu=0.1,
        pose={"quaternion": q.tolist()},
    )
    run = sound(ffsm_mj.run(path))
    assert len(run.impacts) == len(plain.impacts) == 0
    before, after = (np.stack([each[f"state.q_robot_free_{x}_m"] for x in "xyz"], axis=1) for each in (plain, run))
    np.testing.assert_allclose(after, [rotated(q, point) for point in before], atol=1e-10)


@pytest.mark.parametrize("body", [CUBE, BALL], ids=["box", "ball"])
@pytest.mark.parametrize("step_s", [1e-3, 2e-2])
def test_half_and_ten_times_the_step(tmp_path, body, step_s):
    """Uniform deceleration is integrated exactly at any step, and no event depends on it."""
    keys = {**ACROSS, "mu": 0.3} if body is BALL else ACROSS
    usual = ffsm_mj.run(on(tmp_path, body, fixed(geoms(HALVES)), **keys))
    run = sound(ffsm_mj.run(on(tmp_path, body, fixed(geoms(HALVES)), **keys, time_step_s=step_s, control_period_s=step_s)))
    assert len(run.impacts) == len(usual.impacts) == 0
    assert place(run)[-1] == pytest.approx(place(usual)[-1], abs=1e-11)
    assert [len(records) for records in run.records.values()] == [len(records) for records in usual.records.values()]


@pytest.mark.parametrize("at_s", [0.0, 0.1, 0.3, 0.45])
def test_a_run_goes_on_from_the_middle_of_a_seam(tmp_path, at_s):
    """Bit for bit: nothing about pieces is remembered that the state does not have."""
    path = on(tmp_path, CUBE, fixed(geoms(HALVES)), **ACROSS, duration_s=0.6)
    assert is_rest_of(*goes_on(path, at_s))


def test_two_runs_at_once(tmp_path):
    """They step by turns, on floors that differ, and say what each says alone."""
    for name in "ab":
        (tmp_path / name).mkdir()
    paths = [
        on(tmp_path / "a", CUBE, fixed(geoms(HALVES)), **ACROSS, duration_s=0.4),
        on(tmp_path / "b", CUBE, fixed(geoms(PLATE)), **ACROSS, duration_s=0.4),
    ]
    alone = [told(ffsm_mj.run(path)) for path in paths]
    simulators = [ffsm_mj.Simulator(path) for path in paths]
    for simulator in simulators:
        simulator.reset()
    while not all(simulator.ended for simulator in simulators):
        for simulator in simulators:
            simulator.step()
    for simulator, expected in zip(simulators, alone, strict=True):
        both = told(simulator.close())
        np.testing.assert_array_equal(both["rows"], expected["rows"])
        assert both["events"] == expected["events"]


@pytest.mark.parametrize("order", [1, -1])
def test_the_gap_of_a_union_is_that_of_its_nearest_piece(tmp_path, order):
    """A tilted ellipsoid over one of two boxes: z - |D R^T e_z| with its half axes D, whichever box comes first.

    Boxes around it and the other box are nearer than it is to the box below it: both distances are asked for.
    """
    half, angle, height = np.array([0.05, 0.02, 0.1]), 0.6, 0.2
    body = free(f'<geom name="g" type="ellipsoid" size="{numbers(half)}" mass="0"/>')
    joints = [0.08, 0.0, height, math.cos(angle / 2.0), 0.0, math.sin(angle / 2.0), 0.0]
    path = on(tmp_path / "run", body, fixed(geoms(HALVES[::order])), joints=joints, duration_s=0.004)
    gap = height - np.linalg.norm(half * [-math.sin(angle), 0.0, math.cos(angle)])
    assert ffsm_mj.run(path)["contact.hit_gap_m"][0] == pytest.approx(gap, abs=1e-12)


@pytest.mark.parametrize("tilt", [4e-8, 4e-7, 4e-6])
def test_the_gap_of_a_piece_beside_the_lowest_edge(tmp_path, tilt):
    """A cube, turned by 0.3 rad, stands on a lower edge on one of two boxes: its gap to the other is that over the seam.

    Faces that are level to 1e-6 rad face each other, but their separation is that of the edge, which is over the first box.
    """
    yaw, x_m = 0.3, 0.03
    c, s = math.cos(yaw / 2.0), math.sin(yaw / 2.0)
    turn = [c, 0.5 * tilt * s, -0.5 * tilt * c, s]  # about z, then about its own -y
    joints = [x_m, 0.0, 0.1 * (1.0 + tilt), *turn]
    assembly = prepare(on(tmp_path, CUBE, fixed(geoms(HALVES)), joints=joints)).assemble()
    model, data = assembly.system.mj, assembly.data
    (union,) = assembly.pairs
    mujoco.mj_forward(model, data)
    gaps = [union.piece_pair(k).alone(model, data).gap for k in range(2)]
    # The seam, x = 0, leaves the cube on its side at y = -0.1, at this distance from the edge in axes of the cube.
    over_m = 0.1 - (x_m + 0.1 * math.sin(yaw)) / math.cos(yaw)
    # Second order of the tilt: 0.1 m of it squared is 1.6e-12 m at most.
    assert gaps == pytest.approx([0.0, over_m * tilt], abs=2e-12)


def test_geoms_that_end_their_contact_do_not_depend_on_the_way(tmp_path):
    """A cube over both boxes is named with the first of them, whichever was the nearest before."""
    assembly = prepare(on(tmp_path, CUBE, fixed(geoms(HALVES)), joints=[0, 0, 0.1, 1, 0, 0, 0])).assemble()
    model, data = assembly.system.mj, assembly.data
    (union,) = assembly.pairs
    named = []
    for before_m in (-0.3, 0.3):
        for x_m in (before_m, 0.0):
            data.qpos[0] = x_m
            mujoco.mj_forward(model, data)
            named.append(union.geoms_among(model, data, ()))
    assert [of[1] for of in named] == ["floor/b0", "floor/b0", "floor/b1", "floor/b0"]
