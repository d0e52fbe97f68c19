"""Several grasps at once: the first one as a child body, further ones as latches that are held by rows in every stage."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_mj.contact_models.grasp.loops import closing_pose, loop_latch
from ffsm_mj.dynamics.rigid_body import mass_matrix, momentum_matrix
from tests.contact_models.grasp.two_hands import PLANAR, SPATIAL, TwoHands

AMPLITUDES, PLACES = np.array((2.0, -1.5, 0.6, -2.0, 1.2, 0.5)), np.arange(6)


def torques(time_s):
    return AMPLITUDES * np.sin(3.0 * time_s + PLACES)


def relative(bench, other):
    """Largest difference of the states of two scenes."""
    return np.abs(bench.everything() - other.everything()).max()


@pytest.mark.parametrize(("axes", "rank", "loss_J"), [(PLANAR, 9, 0.990770191464), (SPATIAL, 12, 1.356026672503)])
def test_two_closings_at_one_instant_in_either_order(tmp_path, axes, rank, loss_J):
    """The published loss and rank, P and L kept; then the same motion under torques, to truncation of the fourth order."""
    benches = {}
    for step_s in (4e-3, 2e-3):
        for order in ("lr", "rl"):
            bench = benches[order, step_s] = TwoHands(tmp_path, axes, step_s)
            energy, momentum = bench.energy(), bench.momentum()
            found, loss = bench.close(*order)
            assert found == rank
            assert loss == pytest.approx(loss_J, abs=1e-12)
            assert energy - bench.energy() == pytest.approx(loss, abs=1e-13)
            np.testing.assert_allclose(bench.momentum(), momentum, rtol=0, atol=2e-13)
            bench.run(0.2, torques)
            # Torques are internal: this is truncation, at joint rates up to 8 rad/s.
            np.testing.assert_allclose(bench.momentum(), momentum, rtol=0, atol=1e-6 if step_s > 3e-3 else 1e-7)
    coarse, fine = (relative(benches["lr", h], benches["rl", h]) for h in (4e-3, 2e-3))
    assert coarse < 1e-6
    assert coarse / fine > 10.0 or coarse < 1e-12  # slow motions agree to rounding


def test_without_torques_energy_is_constant_and_loops_stay_closed(tmp_path):
    """2 s: the energy drifts by truncation alone, as P and L do; errors of the rows are projected beyond 1e-11 m."""
    bench = TwoHands(tmp_path, SPATIAL)
    bench.close()
    energy, momentum = bench.energy(), bench.momentum()
    bench.run(2.0)
    assert bench.energy() == pytest.approx(energy, abs=1e-11)
    np.testing.assert_allclose(bench.momentum(), momentum, rtol=0, atol=1e-11)
    assert np.abs(bench.integrator.motion.loops.errors()).max() < 2e-11


@pytest.mark.parametrize("axes", [PLANAR, SPATIAL])
def test_loads_are_the_force_balance_of_the_object(tmp_path, axes):
    """Both loads together are the rate of the object's momentum, by MuJoCo's inverse dynamics of the logged system."""
    bench = TwoHands(tmp_path, axes)
    bench.close()
    bench.run(0.05, torques)
    loads, data, model = bench.loads(), bench.data, bench.system.mj
    bench.integrator.motion.path.on_event_located()  # the accelerations under these forces
    needed = np.empty(model.nv)
    mujoco.mj_rne(model, data, 1, needed)
    dofs = bench.system.objects[0].dofs
    body = bench.system.objects[0].root
    found = np.zeros(model.nv)
    for side in "lr":
        point = data.site_xpos[bench.system.index("site", bench.grasps[side].object_site)]
        mujoco.mj_applyFT(model, data, loads[side][:3], loads[side][3:], point, body, found)
    np.testing.assert_allclose(found[dofs], needed[dofs], rtol=0, atol=1e-10 * (1.0 + np.abs(loads["l"]).max()))
    assert bench.loops.is_unique() is (axes is SPATIAL)


def test_the_first_of_two_is_released_and_the_other_one_becomes_the_tree(tmp_path):
    """The state is continuous, no rows are left, and the motion is that of one grasp from the same state."""
    bench = TwoHands(tmp_path, SPATIAL)
    bench.close("l", "r")
    bench.run(0.05, torques)
    before, momentum = bench.everything(), bench.momentum()
    bench.loops.open("r")
    bench.grasped_motion["r"].hold()
    bench.integrator.bind(bench.grasped_motion["r"])
    # The pose of the object follows from that of the hand, and its rates from the twist: equal up to drift.
    np.testing.assert_allclose(bench.everything(), before, rtol=0, atol=1e-10)
    assert bench.integrator.motion.loops is None
    assert bench.loops.closed == ()
    assert not bench.loops.active
    energy, bench.data.ctrl[:] = bench.energy(), 0.0
    bench.run(0.2)
    assert bench.energy() == pytest.approx(energy, abs=1e-12)
    np.testing.assert_allclose(bench.momentum(), momentum, rtol=0, atol=1e-10)


def test_the_second_of_two_is_released(tmp_path):
    """From then on the motion is that of the first grasp alone, bit for bit."""
    bench, alone = TwoHands(tmp_path / "two", SPATIAL), TwoHands(tmp_path / "one", SPATIAL)
    bench.close("l", "r")
    bench.run(0.02, torques)
    bench.loops.open("r")
    bench.integrator.restart()
    alone.data.qpos[:], alone.data.qvel[:] = bench.data.qpos, bench.data.qvel
    alone.data.time = bench.data.time
    mujoco.mj_forward(alone.system.mj, alone.data)
    held = alone.grasped_motion["l"]
    held.hold()
    held.model.body_pos[held.root] = bench.grasped_motion["l"].model.body_pos[held.root]
    held.model.body_quat[held.root] = bench.grasped_motion["l"].model.body_quat[held.root]
    alone.integrator.bind(held)
    held.sync_from_system()
    for each in (bench, alone):
        each.run(0.05, torques)
    np.testing.assert_allclose(bench.everything(), alone.everything(), rtol=0, atol=1e-13)


def test_each_hand_holds_an_object_of_its_own(tmp_path):
    """The second object is a tree of its own: what the latch gives to it is entered, and is the change of its momentum."""
    bench = TwoHands(tmp_path, SPATIAL, objects=("target", "other"))
    bench.close()
    model, data = bench.system.mj, bench.data
    other = bench.system.objects[1]
    own = lambda: momentum_matrix(model, data, other.root) @ data.qvel  # noqa: E731
    before, energy = own(), _energy_of(bench, other)
    given, work = np.zeros(6), 0.0
    for _ in range(100):
        bench.data.ctrl[:] = torques(data.time)
        bench.integrator.advance(bench.step_s)
        for exchange in bench.integrator.exchanges(bench.step_s):
            given, work = given + exchange.impulse, work + exchange.energy_J[2]
            assert abs(exchange.energy_J[0]) < 1e-9  # of a projection
    np.testing.assert_allclose(own() - before, given, rtol=0, atol=1e-10)
    assert _energy_of(bench, other) - energy == pytest.approx(work, abs=1e-10)
    assert np.abs(given).max() > 0.01


def _energy_of(bench, tree):
    M = mass_matrix(bench.system.mj, bench.data)
    v = np.zeros(len(M))
    v[tree.dofs] = bench.data.qvel[tree.dofs]
    return 0.5 * float(v @ M @ v)


@pytest.mark.parametrize("kind", ["ball", "hinge", "slide", "cylindrical"])
def test_a_further_grasp_with_freedom_moves_as_a_first_one(tmp_path, kind):
    """Rigid first and free second, by rows, against free first, by joints, and rigid second: one motion."""
    one, other = (TwoHands(tmp_path, SPATIAL, joints=("rigid", kind)) for _ in range(2))
    ranks = one.close("l", "r"), other.close("r", "l")
    assert ranks[0][0] == ranks[1][0]
    assert ranks[0][1] == pytest.approx(ranks[1][1], abs=1e-12)
    for each in (one, other):
        each.run(0.1, torques)
    assert relative(one, other) < 1e-9


def test_boosted_and_turned(tmp_path):
    """A scene at another velocity and in another orientation: joints move alike, loads turn with it."""
    plain, moved = (TwoHands(tmp_path, SPATIAL) for _ in range(2))
    R, quaternion = np.empty(9), np.array((0.5, 0.1, -0.7, 0.3))
    quaternion /= np.linalg.norm(quaternion)
    mujoco.mju_quat2Mat(R, quaternion)
    R = R.reshape(3, 3)
    data = moved.data
    for name in ("robot/free", "target/free"):
        joint = moved.system.joints[name]
        q, v = data.qpos[joint.qpos], data.qvel[joint.dofs]
        turned = np.empty(4)
        mujoco.mju_mulQuat(turned, quaternion, q[3:].copy())
        q[:3], q[3:], v[:3] = R @ q[:3], turned, R @ v[:3] + (0.3, -0.2, 0.1)
    mujoco.mj_forward(moved.system.mj, data)
    for each in (plain, moved):
        each.close()
        each.run(0.1, torques)
    np.testing.assert_allclose(moved.data.qpos[7:13], plain.data.qpos[7:13], rtol=0, atol=1e-9)
    here, there = plain.loads(), moved.loads()
    for side in "lr":
        np.testing.assert_allclose(there[side].reshape(2, 3), here[side].reshape(2, 3) @ R.T, rtol=0, atol=1e-6)


def test_a_latch_from_logged_numbers_is_the_same_bit_by_bit(tmp_path):
    """Closed in a run, and set closed in another scene at a logged state: equal forces."""
    bench, again = TwoHands(tmp_path, SPATIAL), TwoHands(tmp_path, SPATIAL)
    bench.close_first("l")
    pose = closing_pose(bench.system, bench.data, bench.grasps["r"])
    bench.close_further("r")
    again.close_first("l")
    again.loops.set_closed({"r": loop_latch(again.system, again.grasps["r"], pose)})
    again.grasped_motion["l"].go_to(bench.grasped_motion["l"].data.qpos, bench.grasped_motion["l"].data.qvel)
    again.integrator.restart()
    for each in (bench, again):
        each.run(0.02, torques)
    np.testing.assert_array_equal(bench.everything(), again.everything())
