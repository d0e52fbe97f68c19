"""Parts of what a force or torque sensor reads: contact, grasp and tool, by their own definitions."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.dynamics.rigid_body import cross
from ffsm_mj.errors import InputError
from ffsm_mj.log.scenario import compile_log
from ffsm_mj.records.events import ImpactRecord
from tests.contact_models.grasp.scenes import FLAT_ARM, FLAT_TARGET, OFF
from tests.replays import assert_passes, assert_replayed
from tests.scenes import scene
from tests.sensing.test_grasps import caught

PARTS = ("contact", "grasp", "tool")
KINDS = {"force": "N", "torque": "N_m"}


def wrists(site, **timing):
    """Force and torque at a site, whole and in parts."""
    of_site = {kind: {"kind": kind, "of": site} | timing for kind in KINDS}
    parts = {f"{kind}_{part}": one | {"part": part} for kind, one in of_site.items() for part in PARTS}
    return of_site | parts


def columns(run, sensor, what, unit):
    return np.column_stack([run[f"sensor.{sensor}_{what}_{x}_{unit}"] for x in "xyz"])


def momenta(log, hit, bodies, site):
    """Jump of the momentum of bodies in an impact and of their angular momentum about a site, in its axes."""
    system = compile_log(log)
    model, data, jump = system.mj, mujoco.MjData(system.mj), 0.0
    for sign, rates in ((-1.0, hit.qvel_before), (1.0, hit.qvel_after)):
        data.qpos[:], data.qvel[:] = hit.qpos, np.concatenate([rates[name] for name in system.joints])
        mujoco.mj_forward(model, data)
        place, axes = data.site_xpos[model.site(site).id], data.site_xmat[model.site(site).id].reshape(3, 3)
        for name in bodies:
            body, twist = model.body(name).id, np.empty(6)
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, twist, 0)  # of its inertial frame
            turn = data.ximat[body].reshape(3, 3)
            p = model.body_mass[body] * twist[3:]
            spin = turn @ (model.body_inertia[body] * (turn.T @ twist[:3]))
            jump = jump + sign * np.array((p, spin + cross(data.xipos[body] - place, p)))
    return jump @ axes, place, axes


@pytest.fixture(scope="module")
def held(tmp_path_factory):
    """A target is caught; at about 0.25 s a stone hits it in the hand."""
    load = {"load": {"kind": "force", "of": "handle"}, "load_torque": {"kind": "torque", "of": "handle"}}
    return ffsm_mj.run(caught(tmp_path_factory.mktemp("held"), sensors=wrists("grip") | load))


def test_while_a_target_is_held_its_load_and_the_inertia_of_the_hand_are_told_apart(held):
    """The load, by sensors on the object's side, and the momentum of the hand, by differences of the states.

    Commands of the servo step at a row by up to a fiftieth of the load: a difference to both sides has the mean of the
    forces before and after, off by half of that.
    """
    system = compile_log(held.log)
    model, data = system.mj, mujoco.MjData(system.mj)
    whole = {kind: columns(held, kind, "true", unit) for kind, unit in KINDS.items()}
    part = {(k, p): columns(held, f"{k}_{p}", "true", unit) for k, unit in KINDS.items() for p in PARTS}
    load, load_torque = columns(held, "load", "true", "N"), columns(held, "load_torque", "true", "N_m")
    hand = model.body("robot/hand").id
    grip, handle = (model.site(name).id for name in ("robot/grip", "target/handle"))
    for row in (150, 180, 210):
        assert held["contact.grasp_closed"][row] == 1.0
        assert held["sensor.force_sampled_s"][row] == pytest.approx(held.time[row], abs=1e-12)
        data.qpos[:] = held.qpos[row]
        mujoco.mj_kinematics(model, data)
        axes, of_handle = (data.site_xmat[site].reshape(3, 3) for site in (grip, handle))
        arm, force = data.site_xpos[handle] - data.site_xpos[grip], of_handle @ load[row]
        torque = of_handle @ load_torque[row] + np.cross(arm, force)
        assert np.allclose(axes @ part["force", "grasp"][row], force, atol=1e-12)
        assert np.allclose(axes @ part["torque", "grasp"][row], torque, atol=1e-12)
        assert np.linalg.norm(force) > 0.1
        p = []
        for near in (row - 1, row + 1):
            data.qpos[:], data.qvel[:] = held.qpos[near], held.qvel[near]
            mujoco.mj_forward(model, data)
            mujoco.mj_subtreeVel(model, data)
            p.append(model.body_mass[hand] * data.subtree_linvel[hand])
        of_inertia = (p[1] - p[0]) / (held.time[row + 1] - held.time[row - 1])
        assert np.allclose(axes @ part["force", "tool"][row], of_inertia, rtol=0.0, atol=0.01 * np.linalg.norm(of_inertia))
        for kind in KINDS:
            assert not part[kind, "contact"][row].any()
            assert np.allclose(sum(part[kind, p][row] for p in PARTS), whole[kind][row], atol=1e-14)
    assert_replayed(held)
    assert_passes(held)


def test_an_impact_on_what_is_held_comes_through_the_grasp(held):
    """None of it is a contact of the hand, which takes what changes its momentum and passes on the rest."""
    hit = next(e for e in held.log.events if isinstance(e, ImpactRecord) and "stone/stone" in e.geoms)
    row = int(np.searchsorted(held.time, hit.time_s))
    jump, place, axes = momenta(held.log, hit, ["robot/hand"], "robot/grip")
    of_held, *_ = momenta(held.log, hit, ["target/target"], "robot/grip")
    sign = 1.0 if hit.geoms[1] == "target/target" else -1.0
    impulse = sign * hit.impulse_N_s * np.array(hit.normal)
    through = of_held - np.array((impulse, np.cross(np.array(hit.point_m) - place, impulse))) @ axes
    for i, (kind, unit) in enumerate((("force", "N_s"), ("torque", "N_m_s"))):
        told = {part: columns(held, f"{kind}_{part}", "impulse", unit)[row] for part in PARTS}
        assert not told["contact"].any()
        assert np.allclose(told["grasp"], through[i], atol=1e-13)
        assert np.allclose(told["tool"], jump[i], atol=1e-13)
    assert np.linalg.norm(through[0]) > 0.1


def test_an_impact_on_the_tool_is_a_contact_and_its_inertia(tmp_path):
    """A target hits the hand: its impulse, less the change of the hand's momentum, comes through the wrist."""
    run = ffsm_mj.run(
        scene(
            tmp_path,
            FLAT_ARM,
            {"target": FLAT_TARGET},
            duration_s=0.3,
            initial={"joints": {"target/x": 1.08}, "rates": {"target/x": -0.31}},
            contacts={"rules": [{"between": ["hand", "target/target"], "restitution": 0.5}]},
            sensors=wrists("grip"),
            phases=[{"name": "meet", "until": "end", "controller": OFF}],
        )
    )
    hit = next(e for e in run.log.events if isinstance(e, ImpactRecord))
    jump, place, axes = momenta(run.log, hit, ["robot/hand"], "robot/grip")
    impulse = (-1.0 if hit.geoms[1] == "target/target" else 1.0) * hit.impulse_N_s * np.array(hit.normal)
    of_contact = np.array((impulse, np.cross(np.array(hit.point_m) - place, impulse))) @ axes
    row = int(np.searchsorted(run.time, hit.time_s))
    for i, (kind, unit) in enumerate((("force", "N_s"), ("torque", "N_m_s"))):
        told = {part: columns(run, f"{kind}_{part}", "impulse", unit)[row] for part in PARTS}
        assert np.allclose(told["contact"], -of_contact[i], atol=1e-15)
        assert np.allclose(told["tool"], jump[i], atol=1e-14)
        assert not told["grasp"].any()
        assert np.allclose(columns(run, kind, "impulse", unit)[row], jump[i] - of_contact[i], atol=1e-14)
    assert_replayed(run)


def test_a_contact_that_lasts_is_a_contact_and_its_inertia():
    """The arm of ``push`` presses on its box; the sample of a row is that before its new efforts, which change little."""
    tip = {f"tip_{part}": {"kind": "force", "of": "tip", "part": part} for part in PARTS}
    run = ffsm_mj.run("push", {"duration_s": 10.2, "sensors": tip})
    pressing = run["contact.gripper_box_force_N"] > 1e-3
    assert pressing.sum() > 20
    of_contact = np.linalg.norm(columns(run, "tip_contact", "true", "N"), axis=1)
    rows = np.flatnonzero(pressing)[2:]
    assert np.allclose(of_contact[rows], run["contact.gripper_box_force_N"][rows], rtol=0.01, atol=1e-3)
    assert not columns(run, "tip_grasp", "true", "N").any()


@pytest.mark.parametrize(
    ("sensor", "words"),
    [
        ({"kind": "gyro", "of": "grip", "part": "tool"}, "'part' needs 'kind: force' or 'kind: torque'"),
        ({"part": "tool"}, "'part' needs 'kind: force' or 'kind: torque'"),
        ({"kind": "force", "of": "grip", "part": "inertia"}, "'contact', 'grasp' or 'tool'"),
    ],
)
def test_a_part_of_what_is_no_wrench_is_refused(tmp_path, sensor, words):
    with pytest.raises(InputError, match=words):
        ffsm_mj.run(scene(tmp_path, FLAT_ARM, {"target": FLAT_TARGET}, sensors={"wrist": sensor}))
