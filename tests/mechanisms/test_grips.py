"""Coupled fingers that close on a box: impacts and forces through the coupling, and grasps of mechanisms."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from tests.contact_models.limits import DRIVEN, driven_by
from tests.mechanisms.models import HEAD, box, four_bar, gripper, mechanism
from tests.mechanisms.test_motions import last
from tests.replays import proved


def gripped(folder, *, drive='tendon="pull"', mass=0.1, e=0.0):
    """M6: fingers at +-.04 pulled by 4 N close on a box at .005."""
    rules = [{"between": [finger, "box/box"], "restitution": e} for finger in ("f1", "f2")]
    path = mechanism(
        folder,
        gripper(drive),
        {"box/by": 0.005},
        {},
        objects={"box": box(mass)},
        contacts={"rules": rules},
        phases=DRIVEN,
        duration_s=0.1,
        control_period_s=1e-3,
    )
    return ffsm_mj.run(path, controllers=driven_by(lambda _: (4.0,)))


def impacts(run):
    """Time and impulse by pair of each impact, summed over its points."""
    found = {}
    for record in run.records["impacts"]:
        key = round(record.time_s, 12), record.pair.partition("-")[0]
        found[key] = found.get(key, 0.0) + record.impulse_N_s
    return found


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize(("drive", "coupling"), [('tendon="pull"', 0.0), ('joint="f1"', 2.0)])
def test_coupled_fingers_grip_a_box(tmp_path, drive, coupling):
    """M6: times and impulses in closed form, at rest off centre; 2 N each, wherever the motor pulls.

    The coupling carries what the finger without a motor needs.
    """
    run = gripped(tmp_path, drive=drive)
    proved(run)
    found = impacts(run)
    first, second = sorted({time for time, _ in found})
    assert first == pytest.approx(math.sqrt(0.0015), abs=1e-11)
    assert second == pytest.approx(0.047319450914, abs=1e-11)
    assert found[first, "f1"] == pytest.approx(0.050120960951, abs=1e-11)
    assert found[second, "f1"] == pytest.approx(0.033401965351, abs=1e-11)
    assert found[second, "f2"] == pytest.approx(0.094638901828, abs=1e-11)
    between = int(np.searchsorted(run.time, 0.043))
    assert run["contact.f1_box_box_force_N"][between] == pytest.approx(1.294117647059, abs=1e-10)
    for finger in ("f1", "f2"):
        assert run[f"contact.{finger}_box_box_force_N"][-1] == pytest.approx(2.0, abs=1e-10)
    assert last(run, "q_box_by_m")[0] == pytest.approx(0.000217391304, abs=1e-11)
    assert abs(float(run["contact.robot_f2_equality_force_N"][-1])) == pytest.approx(coupling, abs=1e-10)


def test_one_finger_at_a_wall_of_the_palm(tmp_path):
    """M6: what the motor does at both fingers, 4 N along their common opening, the wall at one of them takes."""
    wall = '<geom name="wall" type="box" size=".02 .005 .02" pos="0 .01 0" mass="0"/><site name="palm"/>'
    path = mechanism(
        tmp_path,
        gripper().replace('<site name="palm"/>', wall),
        {},
        {},
        objects={"box": box()},
        contacts={"rules": [{"between": ["f1", "wall"], "restitution": 0.0}]},
        phases=DRIVEN,
        duration_s=0.1,
        control_period_s=1e-3,
        initial={"joints": {"box/by": 9.0}},
    )
    run = ffsm_mj.run(path, controllers=driven_by(lambda _: (4.0,)))
    proved(run)
    (force,) = [key for key in run.keys if key.startswith("contact.f1") and key.endswith("force_N")]
    assert run[force][-1] == pytest.approx(4.0, abs=1e-10)
    assert abs(last(run, "v_robot_f2_m_s")[0]) < 1e-12


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("law", [{"force_N": 4.0}, {"action": "close", "bandwidth_rad_s": 60.0, "force_N": 4.0}])
def test_the_law_of_a_gripper_closes_coupled_fingers(tmp_path, law):
    """Its force is that at the joint that leads: both fingers press with half of it."""
    ends = {"joints": ["f1"], "closed_at": 0.04, "open_at": 0.0}
    path = mechanism(
        tmp_path,
        gripper('joint="f1"'),
        {},
        {},
        objects={"box": box()},
        contacts={"rules": [{"between": [finger, "box/box"], "restitution": 0.0} for finger in ("f1", "f2")]},
        phases=[{"name": "grip", "until": "end", "controller": {"kind": "gripper", **ends, **law}}],
        duration_s=0.2,
        control_period_s=1e-3,
    )
    run = ffsm_mj.run(path)
    proved(run)
    for finger in ("f1", "f2"):
        assert run[f"contact.{finger}_box_box_force_N"][-1] == pytest.approx(2.0, abs=1e-9)


def test_a_finger_that_would_have_to_pull_lets_go(tmp_path):
    """Of a box of 1 kg both contacts at rest would need -.0322 N s at the first finger: it opens instead."""
    run = gripped(tmp_path, mass=1.0)
    proved(run)
    found = impacts(run)
    second = max(time for time, _ in found)
    assert found[second, "f2"] > 0.02
    assert abs(found.get((second, "f1"), 0.0)) < 1e-12


def test_an_elastic_grip(tmp_path):
    """Elastic impacts of the first finger: energy of the whole is what the motor did."""
    run = gripped(tmp_path, e=1.0)
    proved(run)
    assert float(run["energy.total_J"][-1]) == pytest.approx(float(run["balance.work_J"][-1]), abs=1e-12)


def test_fingers_of_a_stiff_servo_hold_a_box_by_friction(tmp_path):
    """All points stick in implicit steps: a servo 1 cm past the box presses with kp/2 times that, and the box rests."""
    kp, kv = 400.0, 100.0  # 500 1/s with .2 kg of fingers: implicit at 1 ms
    servo = f'<position name="grip" tendon="pull" kp="{kp}" kv="{kv}"/>'
    hold = {"kind": "hold", "joints": ["f1", "f2"], "positions": [0.03, 0.03]}
    path = mechanism(
        tmp_path,
        gripper().replace('<motor name="grip" tendon="pull"/>', servo),
        {"box/by": 0.005},
        {"box/bx": 0.002},
        objects={"box": box()},
        contacts={"rules": [{"between": [finger, "box/box"], "restitution": 0.0, "mu": 0.5} for finger in ("f1", "f2")]},
        phases=[{"name": "all", "until": "end", "controller": hold}],
        duration_s=0.6,
        control_period_s=0.02,
        time_step_s=1e-3,
    )
    run = ffsm_mj.run(path)
    proved(run)
    for finger in ("f1", "f2"):
        # Both fingers are at rest at 2 cm, to the 1e-9 m within which a contact is closed: 2e-7 N.
        assert run[f"contact.{finger}_box_box_force_N"][-1] == pytest.approx(0.5 * kp * (0.03 - 0.02), abs=1e-6)
        assert run[f"contact.{finger}_box_box_slip_m_s"][-1] == 0.0


GRASP = {
    "robot_site": "hand",
    "object_site": "edge",
    "when": {"within": {"position_m": 0.5, "angle_rad": 3.2, "speed_m_s": 9, "rate_rad_s": 9}},
}


def holding(folder, *, equality='<connect name="pin" site1="pin" site2="end"/>', **scenario):
    """The coupler of a turning four-bar linkage takes a tumbling plate within bounds at once, and lets it go after .4 s."""
    text = four_bar().replace(
        '<site name="pin" pos=".35 0 0"/>', '<site name="pin" pos=".35 0 0"/><site name="hand" pos=".2 0 .1"/>'
    )
    plate = (
        f'<mujoco>{HEAD}<worldbody><body name="plate"><freejoint name="free"/>'
        '<inertial pos=".02 .01 0" mass="1.5" diaginertia=".02 .03 .04"/><site name="edge" pos="-.1 0 0"/>'
        '<body name="flap" pos=".1 0 0"><joint name="flap" axis="0 1 0"/>'
        '<inertial pos=".1 0 0" mass=".3" diaginertia=".001 .002 .002"/></body></body></worldbody></mujoco>'
    )
    off = {"kind": "off"}
    return mechanism(
        folder,
        text.replace('<connect name="pin" site1="pin" site2="end"/>', equality),
        {"crank": math.pi / 3, "plate/free": [0.4, 0.3, 0.1, 1, 0, 0, 0]},
        {
            "robot/base": [0.02, -0.01, 0, 0.1, 0, 0.1],
            "crank": 2.0,
            "plate/free": [0.1, 0, 0.2, 0.3, -0.2, 0.4],
            "flap": 0.5,
        },
        objects={"plate": plate},
        phases=[
            {"name": "hold", "for_s": 0.4, "arm": ["grasp"], "controller": off},
            {"name": "leave", "until": "end", "release": ["grasp"], "controller": off},
        ],
        **{"duration_s": 0.6, "control_period_s": 0.02, "grasps": {"grasp": GRASP}} | scenario,
    )


def test_a_mechanism_takes_an_object(tmp_path):
    """The plastic impulse keeps the loop closed: the velocities nearest in the metric of M with all rows at rest."""
    path = holding(tmp_path)
    run = ffsm_mj.run(path)
    proved(run)
    (capture,) = run.records["grasp_impulses"]
    (release,) = run.records["releases"]
    assert release.time_s == pytest.approx(0.4, abs=1e-12)
    system = prepare(path).system
    model, data = system.mj, mujoco.MjData(system.mj)
    before, after = (np.concatenate([v[j] for j in system.joints]) for v in (capture.qvel_before, capture.qvel_after))
    data.qpos[:], data.qvel[:] = capture.qpos, before
    mujoco.mj_forward(model, data)
    rows = [np.zeros((6, model.nv)) for _ in range(4)]
    point = data.site("plate/edge").xpos
    for J, body in zip(rows, ("plate/plate", "robot/coupler"), strict=False):
        mujoco.mj_jac(model, data, J[:3], J[3:], point, model.body(body).id)
    pin = data.site("robot/end").xpos
    for J, body in zip(rows[2:], ("robot/rocker", "robot/coupler"), strict=True):
        mujoco.mj_jac(model, data, J[:3], J[3:], pin, model.body(body).id)
    B, M = np.vstack((rows[0] - rows[1], (rows[2] - rows[3])[:3])), np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    rank = np.linalg.matrix_rank(B, tol=1e-9)
    space = np.linalg.svd(B)[2][rank:].T
    expected = space @ np.linalg.solve(space.T @ M @ space, space.T @ M @ before)
    np.testing.assert_allclose(after, expected, rtol=0, atol=1e-11)
    assert capture.mobility == model.nv - rank
    # The pin stays closed, held and free.
    for qpos in (capture.qpos, release.qpos, run.qpos[-1]):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        assert np.abs(data.site("robot/pin").xpos - data.site("robot/end").xpos).max() < 1e-10
    mass = sum(model.body_mass)
    assert max(capture.linear_momentum_change_N_s, capture.angular_momentum_change_N_m_s) < 1e-13 * mass


def test_the_load_of_a_grasp_of_a_mechanism_is_what_moves_the_object(tmp_path):
    """Its impulse, by Simpson's rule over the rows, is the change of the momentum of the object."""
    run = ffsm_mj.run(holding(tmp_path, control_period_s=2e-3))
    held = run["contact.grasp_closed"] == 1.0
    first, last_held = np.flatnonzero(held)[[0, -1]]
    rows = slice(first, last_held + 1 - (last_held - first) % 2)
    for axis in "xyz":
        force, momentum = run[f"contact.grasp_force_{axis}_N"][rows], run[f"momentum.objects_P_{axis}_N_s"][rows]
        weights = np.ones(len(force))
        weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
        assert float(weights @ force) * 2e-3 / 3.0 == pytest.approx(float(momentum[-1] - momentum[0]), abs=1e-8)


def test_a_load_limit_of_a_grasp_of_a_mechanism(tmp_path):
    """A planar loop has rows that depend on each other, but not on those of the grasp: its load is unique, and limited."""
    free = ffsm_mj.run(holding(tmp_path))
    limit = 0.9 * float(np.linalg.norm([free[f"contact.grasp_force_{axis}_N"] for axis in "xyz"], axis=0).max())
    run = ffsm_mj.run(holding(tmp_path, grasps={"grasp": GRASP | {"load_limit": {"force_N": limit}}}))
    proved(run)
    (release,) = run.records["releases"]
    assert release.reason == "load_limit"
    assert release.force_N >= limit * (1.0 - 1e-9)
