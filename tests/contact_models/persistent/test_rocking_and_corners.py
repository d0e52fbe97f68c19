"""Two contacts that chatter and rest, a third body that hits them, and a ball that slides over a corner."""

from __future__ import annotations

import json
import math

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.log.scenario import compile_log
from tests.contact.unions.scenes import fixed, free, geoms, on
from tests.random_scenes.drawing import draw
from tests.replays import assert_replayed, proved
from tests.scenes import HEAD, ball, scene

PRESS_N = 20.0


def rocking(folder, restitution, *, duration=1.5, **scenario):
    """A planar block of 2 kg, tilted by 0.1 rad, is pressed on a slab by a constant force; a ball of 1 kg may fall on it.

    The ball, at 2 m/s from where it takes 1 s, hits the left part of the block.
    """
    block = f"""<mujoco>{HEAD}<worldbody><body name="block"><joint name="x" type="slide" axis="1 0 0"/>
      <joint name="z" type="slide" axis="0 0 1"/><joint name="pitch" axis="0 1 0"/>
      <inertial pos="0 0 0" mass="2" diaginertia="0.05 0.05 0.05"/>
      <geom name="block" type="box" size="0.2 0.1 0.1" mass="0"/></body></worldbody>
      <actuator><motor name="press" joint="z"/></actuator></mujoco>"""
    slab = f"""<mujoco>{HEAD}<worldbody><geom name="slab" type="box" pos="0 0 -0.5" size="2 2 0.5"/></worldbody></mujoco>"""
    # kp 1e-6 at a target of 2e7 m below: 20 N, but for 1e-8 of it.
    press = {"kind": "pd", "joints": ["robot/z"], "kp": 1e-6, "kd": 0.0, "target": [-1e6 * PRESS_N]}
    return ffsm_mj.run(
        scene(
            folder,
            block,
            {"slab": slab, "ball": ball("ball", radius=0.05, joints="z").replace("<body ", '<body pos="0.1 0 0" ')},
            fixed={"slab": {}},
            duration_s=duration,
            time_step_s=2e-3,
            control_period_s=2e-3,
            initial={
                "joints": {"robot/z": 0.14, "robot/pitch": 0.1, "ball/z": 2.25},
                "rates": {"ball/z": -2.0},
            },
            contacts={
                "rules": [
                    {"between": ["block", "slab/slab"], "restitution": restitution},
                    {"between": ["block", "ball/ball"], "restitution": 0.5},
                ]
            },
            phases=[{"name": "press", "until": "end", "controller": press}],
            **scenario,
        )
    )


ON_SLAB = "contact.block_slab_slab"


@pytest.mark.long
@pytest.mark.parametrize("restitution", [0.3, 0.6])
def test_a_rocking_block_comes_to_rest_on_both_edges_and_is_hit_by_a_third_body(tmp_path, restitution):
    """Hits of both edges in turn, then rest on four corners; the ball's blow is passed on to the slab; rest again."""
    run = proved(rocking(tmp_path, restitution, duration=1.5))
    rocks = {impact.event for impact in run.impacts if impact.time_s < 1.0}
    assert 4 <= len(rocks) <= 40
    for before in (0.95, run.time[-1]):
        row = np.argmin(np.abs(run.time - before))
        assert (run[f"{ON_SLAB}_mode"][row], run[f"{ON_SLAB}_points"][row]) == (2.0, 4.0)
        assert run[f"{ON_SLAB}_force_N"][row] == pytest.approx(PRESS_N, rel=1e-6)
        assert abs(run["state.v_robot_pitch_rad_s"][row]) < 1e-9
    # The ball falls on what rests: one impact of three subsystems, and the slab takes an impulse in it.
    hit = [impact for impact in run.impacts if impact.event == next(i.event for i in run.impacts if "ball" in i.pair)]
    assert hit[0].time_s == pytest.approx(1.0, abs=1e-9)
    assert {impact.pair for impact in hit} == {"block-slab/slab", "block-ball/ball"}
    taken = {pair: sum(i.impulse_N_s for i in hit if i.pair == pair) for pair in ("block-slab/slab", "block-ball/ball")}
    assert taken["block-slab/slab"] > 0.5 * taken["block-ball/ball"] > 0.5
    assert run["balance.deepest_overlap_m"].max() <= 1e-9


@pytest.mark.long
def test_without_the_rule_a_rocking_block_chatters_on(tmp_path):
    """Eighty hits before the ball comes, of which the rule leaves less than forty."""
    run = rocking(tmp_path, 0.6, impact={"rest_interval_s": 0.0, "max_impacts": 80})
    assert run.outcome == "event_limit"
    assert run.time[-1] < 0.95


@pytest.mark.long
def test_a_ball_slides_over_a_corner(tmp_path):
    """From a face over an edge to the corner and beyond, pressed all the way; each change is at the bound of its feature."""
    block = f"""<mujoco>{HEAD}<worldbody><geom name="block" type="box" size="0.2 0.2 0.2"/></worldbody></mujoco>"""
    push = {"kind": "pd", "joints": ["robot/x", "robot/y", "robot/z"], "kp": 10.0, "kd": 6.0, "target": [0.5, 0.45, -0.5]}
    run = proved(
        ffsm_mj.run(
            scene(
                tmp_path,
                ball("ball", joints="xyz"),
                {"block": block},
                fixed={"block": {}},
                duration_s=1.2,
                initial={"joints": {"robot/x": 0.05, "robot/y": 0.07, "robot/z": 0.3}},
                contacts={"rules": [{"between": ["ball", "block/block"], "restitution": 0.0}]},
                phases=[{"name": "push", "until": "end", "controller": push}],
            )
        )
    )
    (begins,), changes = run.records["contact_beginnings"], run.records["contact_changes"]
    modes = [begins.mode, *(change.mode for change in changes)]
    assert modes[0] == "sphere on face"
    assert {"sphere on edge", "sphere on vertex"} <= set(modes)
    for change in changes:
        # It rolls off a face or an edge where its centre passes the end, and the normal goes on without a jump.
        at = np.array(change.qpos)
        assert np.abs(np.abs(at) - 0.2).min() < 1e-8
        nearest = np.clip(at, -0.2, 0.2)
        np.testing.assert_allclose(-np.array(change.normal), (at - nearest) / np.linalg.norm(at - nearest), atol=1e-8)
    ends = run.records["contact_endings"][0].time_s if run.records["contact_endings"] else np.inf
    held = (run.time > 0.0) & (run.time < ends)
    assert run["contact.ball_block_block_force_N"][held].min() > 0.0
    q = np.column_stack([run[f"state.q_robot_{axis}_m"] for axis in "xyz"])[held]
    apart = np.linalg.norm(q - np.clip(q, -0.2, 0.2), axis=1) - 0.1
    assert np.abs(apart).max() <= 1e-9
    assert run["balance.deepest_overlap_m"].max() <= 1e-9


def test_a_plate_slides_over_an_edge_corner_by_corner(tmp_path):
    """It is pressed with 2 N all the way, before and after each change: by corners, then by crossings of edges too."""
    block = f"""<mujoco>{HEAD}<worldbody><geom name="block" type="box" size="0.2 0.4 0.2"/></worldbody></mujoco>"""
    plate = f"""<mujoco>{HEAD}<worldbody><body name="plate"><inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>
    <joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
    <geom name="plate" type="box" size="0.1 0.15 0.05" euler="0 0 25" mass="0"/></body></worldbody>
    <actuator><motor name="x" joint="x"/><motor name="z" joint="z"/></actuator></mujoco>"""
    far = 1e6
    push = {"kind": "pd", "joints": ["x", "z"], "kp": [0.0, 2.0 / far], "kd": 0.0, "target": [0.0, -far]}
    run = proved(
        ffsm_mj.run(
            scene(
                tmp_path,
                plate,
                {"block": block},
                fixed={"block": {}},
                duration_s=0.6,
                initial={"joints": {"z": 0.25}, "rates": {"x": 0.5}},
                contacts={"rules": [{"between": ["plate", "block/block"], "restitution": 0.0}]},
                phases=[{"name": "push", "until": "end", "controller": push}],
            )
        )
    )
    changes = run.records["contact_changes"]
    assert len(changes) >= 3
    assert any(" + " in change.mode for change in changes)
    for change in changes:
        assert [change.force_before_N, change.force_after_N] == pytest.approx([2.0, 2.0], abs=1e-5)


def test_a_landing_that_a_step_passes_is_found(tmp_path):
    """Two meshes roll edge on edge; another vertex lands and lifts again within 5 ms, by 4 um where it is not stopped."""
    path = draw(552, tmp_path, whole=True)
    path.write_text(json.dumps(json.loads(path.read_text()) | {"duration_s": 0.235}))
    run = ffsm_mj.run(path)
    model = compile_log(run.log).mj
    data, pair = mujoco.MjData(model), (model.geom("robot/link2").id, model.geom("o1/o1").id)
    gaps = []
    for data.qpos[:] in run.qpos:
        mujoco.mj_kinematics(model, data)
        gaps.append(mujoco.mj_geomDistance(model, data, *pair, 1.0, None))
    assert sum(gap < 1e-7 for gap in gaps) > 30  # in contact most of the time
    assert min(gaps) > -1e-7  # vertices of meshes are known to single precision: 6e-8 m here


@pytest.mark.long
def test_a_contact_that_touches_elsewhere_without_an_approach_goes_on(tmp_path):
    """Two cylinders at an angle of 2e-4 rad: the contact runs from end to end in 20 us, and its drift is no separation."""
    path = draw(77, tmp_path, whole=True)
    path.write_text(json.dumps(json.loads(path.read_text()) | {"duration_s": 0.005}))
    run = ffsm_mj.run(path)
    assert_replayed(run)
    ends = [each.time_s for each in run.records["contact_endings"]]
    begins = [each.time_s for each in run.records["contact_beginnings"]]
    assert len(run.records["contact_changes"]) > 10
    assert [end for end in ends if any(0.0 <= begin - end < 1e-9 for begin in begins)] == []


def test_an_edge_that_stops_just_before_another_one_lets_that_one_lift(tmp_path):
    """A cube lands on one edge, with the other 0.9 nm higher and ten times as fast: both are struck, and the first lifts.

    The second is at rest and 0.9 nm too high: held, it is lowered by as much, about the middle of the cube, which turns hard
    (k = m a^2 / I = 0.05). The first is lowered by 0.9 nm (1 - k) / (1 + k) = 0.81 nm into the floor, more than a landing is
    deep, and leaves it at 9e-6 m/s within 0.1 ms. No step has passed a landing there.
    """
    half, g, slow, fast, lands, late = 0.1, 1e-4, 1e-6, 1e-5, 1e-3, 9e-10
    low, high = (speed * lands + 0.5 * g * lands**2 for speed in (slow, fast))
    tilt = (high + late - low) / (2.0 * half)
    gravity = f'<option gravity="0 0 {-g}"/>'
    cube = free(geoms((((-half,) * 3, (half,) * 3),)), mass=1.0, inertia=(0.2, 0.2, 0.2), gravity=gravity)
    floor = fixed(geoms((((-1.0, -1.0, -1.0), (1.0, 1.0, 0.0)),), "floor"), gravity=gravity)
    place = [0.0, 0.0, half + 0.5 * (low + high + late), math.cos(0.5 * tilt), 0.0, -math.sin(0.5 * tilt), 0.0]
    rates = [0.0, 0.0, -0.5 * (slow + fast), 0.0, 0.5 * (fast - slow) / half, 0.0]
    steps = dict.fromkeys(("time_step_s", "control_period_s"), 1e-5)
    run = proved(ffsm_mj.run(on(tmp_path, cube, floor, joints=place, rates=rates, duration_s=2e-3, **steps)))
    assert [impact.time_s for impact in run.impacts] == pytest.approx([lands] * 4, abs=1e-9)
    # Plastic at the fast edge alone: it stops, and gives the other (1 - k) / (1 + k) of its speed upwards.
    struck, share = fast + g * lands, 0.95 / 1.05
    assert max(impact.separation_speed_m_s for impact in run.impacts) == pytest.approx(
        share * struck - slow - g * lands, rel=1e-6
    )
