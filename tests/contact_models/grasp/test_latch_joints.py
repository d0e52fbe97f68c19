"""Latches that leave some relative motion free: closing, motion and load, against rows that know nothing of joints."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_mj.contact_models.grasp.grasped_motion import check_grasped_system
from ffsm_mj.contact_models.grasp.latch_joints import axis_angle_rad, relative_twist_rows
from ffsm_mj.contact_models.grasp.load import InterfaceLoad
from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.model.grasp import LatchJoint
from tests.contact_models.grasp.scenes import FLAT_ARM, FLAT_TARGET, Bench

AXIS = (2.0 / 7.0, -3.0 / 7.0, 6.0 / 7.0)
LATCHES = {
    "ball": LatchJoint("ball"),
    "hinge": LatchJoint("hinge", AXIS),
    "slide": LatchJoint("slide", AXIS),
    "cylindrical": LatchJoint("cylindrical", AXIS),
}
STOPPED = {"ball": 3, "hinge": 5, "slide": 5, "cylindrical": 4}

BODY = """<mujoco><option gravity="0 0 0"/><worldbody><body name="{body}">
  <inertial pos="0 0 0" mass="{mass}" diaginertia="{inertia}"/><freejoint name="free"/><site name="{site}" pos="{pos}"/>
  </body></worldbody></mujoco>"""
HEAVY = BODY.format(body="hand", mass=100, inertia="18 20 22", site="grip", pos="1.2 0.1 0")
LIGHT = BODY.format(body="target", mass=90, inertia="12 15 10", site="handle", pos="-0.6 0.05 0.1")


@pytest.mark.parametrize(
    ("joint", "loss_J"),
    [
        (LatchJoint(), 0.133018946430),
        (LatchJoint("ball"), 0.120288813362),
        (LatchJoint("hinge", (1.0, 0.0, 0.0)), 0.120304795054),
        (LatchJoint("cylindrical", (1.0, 0.0, 0.0)), 0.007492985776),
    ],
    ids=["rigid", "ball", "hinge", "cylindrical"],
)
def test_losses_of_two_satellites(tmp_path, joint, loss_J):
    """Digits of an independent evaluation of u^T (J M^-1 J^T)^-1 u / 2, given to 12 decimals."""
    bench = Bench(tmp_path, HEAVY, LIGHT, joint=joint)
    target = bench.system.joint("target/free")
    bench.data.qpos[target.qpos] = 1.8, 0.05, -0.1, 1.0, 0.0, 0.0, 0.0
    bench.data.qvel[:] = 0.05, 0.0, 0.01, 0.0, 0.0, 0.01, -0.02, 0.03, 0.0, 0.06, -0.02, 0.04
    mujoco.mj_forward(bench.model, bench.data)
    energy = bench.energy()
    assert bench.capture().loss_J == pytest.approx(loss_J, rel=0.0, abs=6e-13)
    assert energy - bench.energy() == pytest.approx(loss_J, rel=0.0, abs=6e-13)


@pytest.mark.parametrize("kind", LATCHES)
def test_closing_stops_what_the_latch_stops_and_no_more(tmp_path, rng, kind):
    """P and L are kept, the loss is that of the formula, and the state survives the change of coordinates, to rounding."""
    bench = Bench(tmp_path, joint=LATCHES[kind])
    for _ in range(50):
        bench.draw(rng)
        momentum, energy = bench.momentum(), bench.energy()
        found = bench.impulse()
        bench.data.qvel[:] += found.change
        mujoco.mj_forward(bench.model, bench.data)
        after, twist = bench.data.qvel.copy(), bench.twist()
        bench.grasped_motion.hold()
        assert found.rank == STOPPED[kind]
        scale = 1.0 + np.abs(after).max()
        np.testing.assert_allclose(bench.data.qvel, after, rtol=0, atol=1e-13 * scale)
        np.testing.assert_allclose(bench.twist(), twist, rtol=0, atol=1e-13 * scale)
        assert np.abs(bench.grasped_motion.joints.stopped(bench.data) @ twist).max() <= 1e-13 * scale
        assert np.linalg.norm(twist) > 1e-3  # the free part goes on
        assert np.abs(bench.momentum() - momentum).max() <= 1e-14 * (1.0 + bench.moduli())
        # Masses of 8 kg and moments of 0.01 kg m^2: M is solved to some hundred roundings.
        assert abs(energy - bench.energy() - found.loss_J) <= 1e-13 * energy


@pytest.mark.parametrize("kind", LATCHES)
def test_accelerations_and_load_are_those_of_rows(tmp_path, rng, kind):
    """The free system under the forces that leave the stopped components no acceleration, at random states.

    The joint reaction has no component along what is free: that is rounding of the largest term.
    """
    bench = Bench(tmp_path, joint=LATCHES[kind])
    for _ in range(20):
        bench.draw(rng)
        bench.capture()
        bench.data.ctrl[:] = rng.normal(size=2)
        bench.grasped_motion.step(1e-3)
        bench.grasped_motion.path.on_event_located()
        acceleration, force = rows_in_a_stage(bench)
        scale = 1.0 + np.abs(acceleration).max()
        np.testing.assert_allclose(bench.data.qacc, acceleration, rtol=0, atol=1e-10 * scale)
        load = InterfaceLoad(bench.grasped_motion, bench.sites.point(bench.data), bench.data).now()
        np.testing.assert_allclose(load, force, rtol=0, atol=1e-10 * (1.0 + np.abs(force).max()))
        stopped = bench.grasped_motion.joints.stopped(bench.data)
        np.testing.assert_allclose(stopped.T @ (stopped @ load), load, rtol=0, atol=1e-11 * (1.0 + np.abs(load).max()))


def rows_in_a_stage(bench):
    """Accelerations of the free system with a latch by rows, and the force and moment of the rows on the object.

    The rate of a component c that is fixed in the link a, at the object's site P: c . (a_b - a_a at P) - 2 c . (w_a x u)
    along, with u the relative velocity at P, and c . (alpha_b - alpha_a) - c . (w_a x w_ab) about.
    """
    model, data, sites = bench.model, bench.data, bench.sites
    point, stopped = sites.point(data), bench.grasped_motion.joints.stopped(data)
    J, rate = relative_twist_rows(model, data, sites.link, sites.root, point), np.zeros((6, model.nv))
    for body, sign in ((sites.root, 1.0), (sites.link, -1.0)):
        part = np.empty((6, model.nv))
        mujoco.mj_jacDot(model, data, part[:3], part[3:], point, body)
        rate += sign * part
    turning, twist = np.empty((3, model.nv)), J @ data.qvel
    mujoco.mj_jacBody(model, data, None, turning, sites.link)
    spin = turning @ data.qvel
    curving = np.concatenate((-2.0 * np.cross(spin, twist[:3]), -np.cross(spin, twist[3:])))
    rows, gamma = stopped @ J, stopped @ (rate @ data.qvel + curving)
    M = mass_matrix(model, data)
    mujoco.mj_fwdActuation(model, data)
    free = np.linalg.solve(M, data.qfrc_actuator + data.qfrc_passive - data.qfrc_bias)
    response = np.linalg.solve(M, rows.T)
    force = -np.linalg.solve(rows @ response, rows @ free + gamma)
    return free + response @ force, stopped.T @ force


@pytest.mark.parametrize("kind", LATCHES)
def test_the_latch_holds_exactly_and_nothing_is_lost(tmp_path, kind):
    """One second with every joint moving: no drift across the latch, P, L and T kept to the truncation of order four."""
    bench = Bench(tmp_path, joint=LATCHES[kind], time_step_s=1e-3)
    bench.draw(np.random.default_rng(5), speed=0.5)
    bench.capture()
    momentum, energy, held = bench.momentum(), bench.energy(), bench.grasped_motion
    offset, turn = relative_pose(bench)
    coordinates = held.data.qpos[-1], held.joints._coordinates(bench.data)[-1][-1]
    assert coordinates[0] == pytest.approx(coordinates[1], abs=1e-14)
    for _ in range(1000):
        held.step(1e-3)
    after, turned = relative_pose(bench)
    axis = np.array(AXIS)
    along = np.cross(axis, after - offset) if "slide" in LATCHES[kind].joints else after - offset
    assert np.abs(along).max() < 1e-14 * 100
    if kind == "slide":
        np.testing.assert_allclose(turned, turn, rtol=0, atol=1e-14 * 100)
        assert np.linalg.norm(after - offset) > 0.05
    elif kind != "ball":  # the axis of a is fixed in b too
        np.testing.assert_allclose(turned.T @ axis, turn.T @ axis, rtol=0, atol=1e-14 * 100)
    else:
        assert np.abs(turned - turn).max() > 0.05
    assert np.abs(bench.momentum() - momentum).max() < 1e-11
    assert abs(bench.energy() - energy) < 1e-11


def relative_pose(bench):
    """Position of the object's site from the robot's and attitude of the object, in the robot's site."""
    frame = bench.data.site_xmat[bench.sites.robot].reshape(3, 3)
    offset = bench.data.site_xpos[bench.sites.object] - bench.data.site_xpos[bench.sites.robot]
    return frame.T @ offset, frame.T @ bench.data.xmat[bench.sites.root].reshape(3, 3)


@pytest.mark.parametrize("kind", LATCHES)
def test_any_later_state_gives_the_same_joints(tmp_path, rng, kind):
    """A run that goes on from a sample attaches the object there: the same reference, the same coordinates, to rounding."""
    bench = Bench(tmp_path, joint=LATCHES[kind])
    bench.draw(rng)
    bench.capture()
    held, written = bench.grasped_motion, ("body_pos", "body_quat", "jnt_pos", "jnt_axis")
    for _ in range(200):
        held.step(1e-3)
    before = {name: getattr(held.model, name).copy() for name in written}
    state = held.data.qpos.copy(), held.data.qvel.copy()
    held.hold()
    for name in written:
        np.testing.assert_allclose(getattr(held.model, name), before[name], rtol=0, atol=2e-13)
    np.testing.assert_allclose(held.data.qpos, state[0], rtol=0, atol=2e-13)
    np.testing.assert_allclose(held.data.qvel, state[1], rtol=0, atol=1e-12)


def test_axes_that_differ_are_told_and_the_robots_counts(tmp_path, rng):
    bench = Bench(tmp_path, joint=LATCHES["hinge"])
    bench.draw(rng)
    bench.capture()
    frames = (bench.data.site_xmat[site].reshape(3, 3) for site in (bench.sites.robot, bench.sites.object))
    one, other = (frame @ AXIS for frame in frames)
    assert axis_angle_rad(bench.data, bench.sites, LATCHES["hinge"]) == pytest.approx(np.arccos(one @ other), abs=1e-12)
    np.testing.assert_allclose(bench.grasped_motion.data.xaxis[-1], one, rtol=0, atol=1e-14)
    np.testing.assert_allclose(bench.grasped_motion.data.xanchor[-1], bench.sites.point(bench.data), rtol=0, atol=1e-14)


def test_a_plane_has_a_hinge_across_it_and_no_ball(tmp_path):
    """What a latch leaves free must be motion that the object's own joints have."""
    across = Bench(tmp_path, FLAT_ARM, FLAT_TARGET, joint=LatchJoint("hinge", (0.0, 0.0, 1.0)))
    check_grasped_system(across.system, across.held_system, across.grasp)
    across.draw(np.random.default_rng(1))
    assert across.capture().rank == 2
    for joint in (LatchJoint("ball"), LatchJoint("hinge", (1.0, 0.0, 0.0)), LatchJoint("slide", (0.0, 0.0, 1.0))):
        bench = Bench(tmp_path, FLAT_ARM, FLAT_TARGET, joint=joint)
        with pytest.raises(LookupError, match="cannot take the poses"):
            check_grasped_system(bench.system, bench.held_system, bench.grasp)


def test_defaults_of_the_objects_file_are_not_for_the_latch(tmp_path):
    """Its joints have no friction, spring, limit or inertia of their own."""
    own = '<default><joint damping="3" armature="2" stiffness="5" range="-1 1" limited="true" ref="0.4"/></default>'
    target = LIGHT.replace("<worldbody>", f"{own}<worldbody>")
    bench = Bench(tmp_path, HEAVY, target, joint=LATCHES["cylindrical"])
    model = bench.grasped_motion.model
    assert not any(values.any() for values in (model.dof_damping, model.dof_armature, model.jnt_stiffness))
    assert not any(values[-2:].any() for values in (model.jnt_limited, model.qpos0))


GRASPS = 100
SPACE, PLANE = (), (FLAT_ARM, FLAT_TARGET)


@pytest.mark.parametrize(("models", "rank"), [(SPACE, 6), (PLANE, 3)], ids=["space", "plane"])
def test_what_a_capture_keeps_and_what_it_loses(tmp_path, rng, models, rank):
    """Momenta, no relative twist, energy by the formula, whatever the state; tolerances are rounding of the terms."""
    bench = Bench(tmp_path, *models)
    for _ in range(GRASPS):
        bench.draw(rng)
        momentum, energy = bench.momentum(), bench.energy()
        found = bench.capture()
        assert found.rank == rank
        # What the joints of a plane bear is no momentum of the system.
        kept = slice(None) if rank == 6 else [0, 1, 5]
        assert np.abs(bench.momentum() - momentum)[kept].max() <= 1e-14 * (1.0 + bench.moduli())
        assert np.abs(bench.twist()).max() <= 1e-13 * (1.0 + np.abs(bench.data.qvel).max())
        assert found.loss_J >= 0.0
        assert abs(energy - bench.energy() - found.loss_J) <= 1e-14 * energy


def test_rows_of_a_plane_are_solved_with_least_norm(tmp_path, rng):
    """Force and moment out of the plane are borne by joints: of least norm there are none."""
    bench = Bench(tmp_path, *PLANE)
    bench.draw(rng)
    assert np.abs(bench.impulse().impulses[[2, 3, 4]]).max() <= 1e-15
