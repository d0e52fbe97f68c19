"""Planes: gaps in closed form, and runs on a plane as on a wide block whose upper face is the plane."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.contact.broad_phase import BroadPhase
from ffsm_mj.contact.pairs import ContactPair
from tests.replays import assert_replayed
from tests.scenes import HEAD, scene

MESH = '<asset><mesh name="tip" vertex="0 0 .15 0 0 -.15 .1 0 0 -.1 0 0 0 .1 0 0 -.1 0"/></asset>'
GEOMS = {
    "sphere": 'size="0.1"',
    "capsule": 'type="capsule" size="0.05 0.1"',
    "cylinder": 'type="cylinder" size="0.1 0.15"',
    "ellipsoid": 'type="ellipsoid" size="0.1 0.2 0.15"',
    "box": 'type="box" size="0.1 0.2 0.15"',
    "mesh": 'type="mesh" mesh="tip"',
}
GROUND = {
    "plane": '<geom name="g" type="plane" size="0 0 1"/>',
    "block": '<geom name="g" type="box" size="2 2 1" pos="0 0 -1"/>',
}
TURN = [0.9, 0.3, -0.3, 0.1]


def body(shape: str, gravity: str) -> str:
    head = HEAD.replace("0 0 0", gravity)
    return f"""<mujoco>{head}{MESH}<worldbody><body name="body"><freejoint name="free"/>
      <geom name="body" {GEOMS[shape]} mass="2"/></body></worldbody></mujoco>"""


def on_ground(folder, shape, ground, pose, *, order=("robot", "ground"), restitution=1.0, gravity="0 0 0", **changes):
    """A scenario with a body over the ground, which has a pose."""
    folder.mkdir(exist_ok=True)
    flat = f"<mujoco>{HEAD}<worldbody>{GROUND[ground]}</worldbody></mujoco>"
    rules = {"rules": [{"between": order, "restitution": restitution}]}
    return scene(folder, body(shape, gravity), {"ground": flat}, fixed={"ground": pose}, contacts=rules, **changes)


def support(shape, direction):
    """Support function of a geom in its own axes, by the textbook."""
    x, y, z = direction
    return {
        "sphere": 0.1,
        "capsule": 0.05 + 0.1 * abs(z),
        "cylinder": 0.1 * np.hypot(x, y) + 0.15 * abs(z),
        "ellipsoid": np.linalg.norm([0.1 * x, 0.2 * y, 0.15 * z]),
        "box": 0.1 * abs(x) + 0.2 * abs(y) + 0.15 * abs(z),
        "mesh": max(0.15 * abs(z), 0.1 * abs(x), 0.1 * abs(y)),
    }[shape]


@pytest.mark.parametrize("order", [("robot", "ground"), ("ground", "robot")])
@pytest.mark.parametrize("shape", GEOMS)
def test_the_gap_over_a_plane_is_the_height_less_the_support(tmp_path, rng, shape, order):
    """At any pose and on either side; rounding of 1 m, and of a mesh its single precision."""
    start = {"joints": {"free": [0, 0, 9, 1, 0, 0, 0]}}
    system = prepare(on_ground(tmp_path, shape, "plane", {"quaternion": TURN}, order=order, initial=start)).system
    model, data = system.mj, mujoco.MjData(system.mj)
    names = {"robot": "robot/body", "ground": "ground/g"}
    pair = ContactPair(system, "pair", names[order[0]], names[order[1]], 1.0)
    sphere = BroadPhase(model, [pair])
    up = np.empty(3)
    mujoco.mju_rotVecQuat(up, np.array([0.0, 0, 1]), np.array(TURN))
    for _ in range(30):
        place, turn = rng.uniform(-0.5, 0.5, 3), rng.normal(size=4)
        data.qpos[:] = [*place, *turn / np.linalg.norm(turn)]
        mujoco.mj_forward(model, data)
        local = data.body("robot/body").xmat.reshape(3, 3).T @ -up
        expected = up @ place - support(shape, local)
        near = pair.proximity(model, data)
        tolerance = 1e-8 if shape == "mesh" else 2e-15
        assert near.gap == pytest.approx(expected, abs=tolerance)
        assert pair.gap(model, data, 10.0) == pytest.approx(expected, abs=tolerance)
        assert near.normal == pytest.approx(-up if order[0] == "robot" else up, abs=1e-15)
        assert sphere.gaps(data)[0] <= expected + tolerance
    assert pair.gap(model, data, -9.0) == -9.0


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize("restitution", [0.0, 0.6, 1.0])
@pytest.mark.parametrize("shape", GEOMS)
def test_a_plane_is_the_face_of_a_wide_block(tmp_path, shape, restitution):
    """Thrown at it, a body bounces, comes to rest and rolls alike: other arithmetic, so rounding through the impacts."""
    runs = []
    for ground in GROUND:
        path = on_ground(
            tmp_path / ground,
            shape,
            ground,
            {"position_m": [0, 0, 0.1]},
            gravity="0 0 -2" if restitution < 1.0 else "0 0 0",
            conservative=restitution == 1.0,
            restitution=restitution,
            initial={
                "joints": {"free": [0, 0, 0.4, 0.9, 0.3, 0.3, 0.1]},
                "rates": {"free": [0.2, 0.1, -0.6, 0.3, -0.4, 0.5]},
            },
            duration_s=0.8,
        )
        runs.append(ffsm_mj.run(path))
    plane, block = runs
    assert plane.outcome == block.outcome == "completed", plane.message
    assert len(plane.impacts) == len(block.impacts) > 0
    assert plane.impacts[0].time_s == pytest.approx(block.impacts[0].time_s, abs=1e-12)
    scale = 1e-6 if shape == "mesh" else 1e-8
    assert plane.qpos[-1] == pytest.approx(block.qpos[-1], abs=scale)
    assert [check for check in all_checks(plane) if not check.passes] == []
    assert_replayed(plane)
