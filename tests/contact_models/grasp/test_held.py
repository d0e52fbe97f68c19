"""What moves while an object is held: against Pinocchio, against other ways to hold, and back to the free system."""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from ffsm_mj._core.state_transfer import StateTransfer
from ffsm_mj.contact_models.grasp.grasped_motion import check_grasped_system
from ffsm_mj.contact_models.grasp.latch_joints import relative_twist_rows
from ffsm_mj.contact_models.grasp.load import InterfaceLoad
from ffsm_mj.contact_models.impact import rest_rule
from ffsm_mj.dynamics.rigid_body import mass_matrix
from tests.contact_models.grasp.scenes import ARM, FLAT_ARM, FLAT_TARGET, TARGET, Bench
from tests.model.test_pinocchio import oracle, to_pinocchio

STATES = 500
KEPT = 1e-11
"""Of P, L and T over ten seconds; the tuned weld leaves 7e-11."""


def composite(bench):
    """Pinocchio's model of the robot with the object on its link, the pose taken from the free system."""
    model, data, grasp = bench.model, bench.data, bench.grasp
    alone = mujoco.MjModel.from_xml_string(ARM)
    robot, of_body = oracle(alone)
    robot.gravity.setZero()
    link, root = model.body(grasp.link).id, model.body(grasp.root).id
    poses = [pin.SE3(data.xmat[b].reshape(3, 3).copy(), data.xpos[b].copy()) for b in (link, root)]
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[root])
    axes = turn.reshape(3, 3)
    inertia = pin.Inertia(
        float(model.body_mass[root]), model.body_ipos[root].copy(), axes @ np.diag(model.body_inertia[root]) @ axes.T
    )
    robot.appendBodyToJoint(of_body[alone.body("hand").id], inertia, poses[0].actInv(poses[1]))
    return alone, robot


def test_pinocchio_agrees(tmp_path, rng):
    """Mass matrix, momenta and forward dynamics of the joined body on random states and poses, to 1e-12."""
    bench = Bench(tmp_path)
    for _ in range(STATES):
        bench.draw(rng)
        bench.capture()
        alone, joined = composite(bench)
        held, n = bench.grasped_motion, alone.nv
        q, v, X = to_pinocchio(alone, np.array(held.data.qpos), np.array(held.data.qvel))
        around, M = joined.createData(), mass_matrix(held.model, held.data)
        expected = X.T @ pin.crba(joined, around, q) @ X
        np.testing.assert_allclose(M, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
        momentum = pin.computeCentroidalMomentum(joined, around, q, v)
        centre = pin.centerOfMass(joined, around, q)
        about_origin = np.concatenate((momentum.linear, momentum.angular + np.cross(centre, momentum.linear)))
        np.testing.assert_allclose(bench.momentum(), about_origin, rtol=0, atol=1e-12 * (1.0 + bench.moduli()))
        torques = np.zeros(n)
        torques[6:] = rng.normal(size=n - 6)
        held.data.qfrc_applied[:] = torques
        mujoco.mj_forward(held.model, held.data)
        a = pin.aba(joined, around, q, v, torques)
        a[:3] = X[:3, :3].T @ (a[:3] + np.cross(v[3:6], v[:3]))  # of the origin, in world axes
        held.data.qfrc_applied[:] = 0.0
        scale = 1.0 + np.abs(M).max() * np.abs(a).max() + np.abs(held.data.qfrc_bias).max()
        np.testing.assert_allclose(M @ held.data.qacc, M @ a, rtol=0, atol=1e-12 * scale)


def test_the_free_system_is_where_the_object_is(tmp_path, rng):
    """Pose, twist and accelerations of the object in the system that is logged are those of a part of the link."""
    for models in ((ARM, TARGET), (FLAT_ARM, FLAT_TARGET)):
        bench = Bench(tmp_path, *models)
        bench.draw(rng)
        if models[0] is FLAT_ARM:
            bench.data.qpos[-1] = 40.0  # some turns: a hinge does not jump back
            mujoco.mj_forward(bench.model, bench.data)
        bench.capture()
        before = np.array(bench.data.qpos)
        for _ in range(50):
            bench.grasped_motion.step(1e-3)
        root, held = bench.sites.root, bench.grasped_motion
        np.testing.assert_allclose(bench.data.xpos[root], held.data.xpos[held.root], atol=1e-14)
        np.testing.assert_allclose(bench.data.xmat[root], held.data.xmat[held.root], atol=1e-14)
        assert np.abs(bench.twist()).max() < 1e-13
        assert np.abs(bench.data.qpos - before).max() < 1.0
        held.path.on_event_located()
        rates = np.array(bench.data.qvel)
        held.step(1e-6)
        np.testing.assert_allclose((bench.data.qvel - rates) / 1e-6, bench.data.qacc, rtol=0, atol=2e-4)


@pytest.mark.long
@pytest.mark.parametrize("step_s", [1e-2, 4e-3, 1e-3])
def test_ten_seconds_held_against_six_rows_in_the_stages(tmp_path, step_s):
    """The child model and MuJoCo's own steps of the free system with six rows of forces: one path, momenta and energy kept.

    The child model's error at a step h is 16/15 of its change from h to h/2 (order four). That of the rows is taken for no
    greater than twice it, and so many steps may each add one rounding of a coordinate of 1.
    """
    bench, finer, other = (_tumbling(tmp_path, h) for h in (step_s, 0.5 * step_s, step_s))
    path, kept = _flown(bench, lambda: bench.grasped_motion.step(step_s), step_s)
    halved, _ = _flown(finer, lambda: finer.grasped_motion.step(0.5 * step_s), 0.5 * step_s)
    mujoco.set_mjcb_control(lambda _, data: _hold_alone(other, data))
    try:
        constrained, also_kept = _flown(other, lambda: mujoco.mj_step(other.model, other.data), step_s)
    finally:
        mujoco.set_mjcb_control(None)
    assert max(kept) < KEPT, kept
    assert max(also_kept) < KEPT, also_kept
    own = np.abs(path - halved[1::2]).max()
    tolerance = 3.0 * 16.0 / 15.0 * own + len(path) * np.finfo(float).eps
    assert own < 1e-11
    assert np.abs(path).max() > 1.0
    np.testing.assert_allclose(constrained, path, rtol=0, atol=tolerance)


def _tumbling(folder, step_s, speed=0.1):
    """An arm whose joints turn with a tumbling target in its hand."""
    bench = Bench(folder, time_step_s=step_s)
    bench.data.qpos[bench.system.joint("target/free").qpos] = (0.97, 0.02, 0.03, 0.9, 0.1, -0.2, np.sqrt(0.14))
    bench.data.qvel[:] = speed * np.sin(np.arange(1.0, bench.model.nv + 1.0))
    mujoco.mj_forward(bench.model, bench.data)
    bench.capture()
    return bench


def _flown(bench, step, step_s):
    """Coordinates after each step of ten seconds, and how far P, L and T are from where they were."""
    momentum, energy, path = bench.momentum(), bench.energy(), np.empty((round(10.0 / step_s), bench.model.nq))
    for row in path:
        step()
        row[:] = bench.data.qpos
    mujoco.mj_forward(bench.model, bench.data)  # MuJoCo's step ends before its derived quantities
    return path, (*np.abs(bench.momentum() - momentum).tolist(), abs(bench.energy() - energy))


def _hold_alone(bench, data):
    """The six rows and no other force."""
    data.qfrc_applied[:] = 0.0
    _hold(bench, data)


def _hold(bench, data):
    """Six rows in a stage: the forces that leave no relative acceleration of the two."""
    model, sites = bench.model, bench.sites
    point = sites.point(data)
    J, rate = relative_twist_rows(model, data, sites.link, sites.root, point), np.zeros((6, model.nv))
    for body, sign in ((sites.root, 1.0), (sites.link, -1.0)):
        part = np.empty((6, model.nv))
        mujoco.mj_jacDot(model, data, part[:3], part[3:], point, body)
        rate += sign * part
    smooth = np.empty((1, model.nv))
    mujoco.mj_solveM(model, data, smooth, (data.qfrc_passive - data.qfrc_bias)[None])
    response = np.empty_like(J)
    mujoco.mj_solveM(model, data, response, J)
    force = -np.linalg.solve(response @ J.T, J @ smooth[0] + rate @ data.qvel)
    data.qfrc_applied[:] += J.T @ force


def test_the_load_is_what_holds_the_object(tmp_path, rng):
    """Its force and torque are those of the six rows, which know nothing of Newton and Euler."""
    bench = Bench(tmp_path)
    for _ in range(20):
        bench.draw(rng)
        bench.capture()
        point = bench.sites.point(bench.data)
        load = InterfaceLoad(bench.grasped_motion, point, bench.data).now()
        model, data, sites = bench.model, bench.data, bench.sites
        J = relative_twist_rows(model, data, sites.link, sites.root, point)
        mujoco.mj_forward(model, data)
        data.qfrc_applied[:] = 0.0
        _hold(bench, data)
        force = np.linalg.lstsq(J.T, data.qfrc_applied, rcond=None)[0]
        data.qfrc_applied[:] = 0.0
        np.testing.assert_allclose(load, force, atol=1e-10 * (1.0 + np.abs(force).max()))


def test_what_cannot_follow_is_refused(tmp_path):
    """An object that slides in a plane cannot go where an arm in space brings it; one that is aligned has another frame."""
    bench = Bench(tmp_path, ARM, FLAT_TARGET)
    with pytest.raises(LookupError, match="joints of 'target/target' cannot take the poses"):
        check_grasped_system(bench.system, bench.held_system, bench.grasp)
    bench = Bench(tmp_path, ARM, TARGET.replace('<freejoint name="free"/>', '<freejoint name="free" align="true"/>'))
    with pytest.raises(LookupError, match="moved to its mass centre"):
        check_grasped_system(bench.system, bench.held_system, bench.grasp)
    for models in ((ARM, TARGET), (FLAT_ARM, FLAT_TARGET)):
        bench = Bench(tmp_path, *models)
        check_grasped_system(bench.system, bench.held_system, bench.grasp)


def test_joints_that_are_not_read_off_are_searched_for(tmp_path, rng):
    """Skewed slides take the poses that the plane's robot brings them to, by Newton's method."""
    skewed = FLAT_TARGET.replace('axis="0 1 0"', 'axis="1 1 0"')
    bench = Bench(tmp_path, FLAT_ARM, skewed)
    bench.draw(rng)
    bench.capture()
    assert bench.grasped_motion.placing.reading is None
    assert type(bench.grasped_motion.followed) is StateTransfer
    for _ in range(20):
        bench.grasped_motion.step(1e-3)
    np.testing.assert_allclose(
        bench.data.xpos[bench.sites.root], bench.grasped_motion.data.xpos[bench.grasped_motion.root], atol=1e-13
    )
    assert np.abs(bench.twist()).max() < 1e-12


def test_forces_of_contacts_are_no_part_of_what_presses_after_an_impact(tmp_path):
    """The acceleration at other velocities is that under what depends on the state alone, whatever acted before."""
    bench = Bench(tmp_path)
    bench.draw(np.random.default_rng(18))
    bench.capture()
    bench.grasped_motion.hold()
    moving, rates = bench.grasped_motion.data, 2.0 * np.array(bench.grasped_motion.data.qvel)

    def damper(data):
        data.qfrc_applied[:] -= 0.7 * data.qvel

    def contact(data):
        data.qfrc_applied[:] += 5.0

    bench.grasped_motion.push_with([damper], [contact])
    found = []
    for pushed in (0.0, 3.0):
        moving.qfrc_applied[:] = pushed
        with rest_rule._without_contacts(bench.grasped_motion, rates):
            found.append(np.array(moving.qacc))
        assert (moving.qfrc_applied == pushed).all()
    np.testing.assert_array_equal(*found)
    moving.qvel[:], moving.qfrc_applied[:] = rates, -0.7 * rates
    mujoco.mj_forward(bench.grasped_motion.model, moving)
    np.testing.assert_array_equal(found[0], moving.qacc)
