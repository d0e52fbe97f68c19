"""Latches in the stages of a step, and the state that the log sees of a motion with a grasped object, in plain NumPy."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_mj._core.loops import LoopStage
from ffsm_mj.dynamics.loops.closed_loops import ClosedLoops
from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.tolerances import RANK
from tests.contact_models.grasp import scenes as capture
from tests.contact_models.grasp import two_hands as hands


@pytest.mark.parametrize("kind", ["rigid", "ball", "hinge", "slide", "cylindrical"])
def test_forces_of_latches(tmp_path, rng, kind):
    """Rows, rates, forces and drift of two latches, one of them dependent in part, at random states."""
    bench = hands.TwoHands(tmp_path, hands.SPATIAL, joints=("rigid", kind), objects=("target", "other"))
    model, data, latches = bench.system.mj, bench.data, [bench.latch("l"), bench.latch("r")]
    loops = ClosedLoops(model, data, latches)
    bound = [each.bind(model, data, range(model.nbody), range(model.nv)) for each in latches]
    for _ in range(10):
        mujoco.mj_integratePos(model, data.qpos, 1e-3 * rng.normal(size=model.nv), 1.0)
        data.qvel[:], data.ctrl[:] = rng.normal(size=model.nv), rng.normal(size=model.nu)
        mujoco.mj_forward(model, data)
        T, others = (np.ascontiguousarray(each) for each in loops.weighted().independent())
        stage, at = LoopStage(model, data, bound, data, RANK), loops.rows()
        stage.combine(T, others)
        data.qfrc_applied[:] = 1.0
        stage.push()
        pushed, data.qfrc_applied[:] = data.qfrc_applied - 1.0, 0.0
        R, gamma, M = T @ at.J, T @ at.gamma, mass_matrix(model, data)
        force = data.qfrc_passive - data.qfrc_bias + data.qfrc_actuator + 1.0
        y = np.linalg.solve(R @ np.linalg.solve(M, R.T), -R @ np.linalg.solve(M, force) - gamma)
        response = np.linalg.solve(M, R.T).T
        expected = {"J": at.J, "R": R, "gamma": gamma, "response": response, "y": y, "factor": np.eye(len(T))}
        for name, value in expected.items():
            # The combinations T make R M^-1 R^T one; the condition of M is some thousands.
            np.testing.assert_allclose(getattr(stage, name), value, rtol=0.0, atol=1e-11 * np.abs(value).max(), err_msg=name)
        np.testing.assert_allclose(pushed, y @ R, rtol=0.0, atol=1e-11 * np.abs(pushed).max())
        np.testing.assert_allclose(stage.errors(), T @ loops.errors(), rtol=0.0, atol=1e-13)
        drift = np.abs(T @ loops.errors()).max(), np.abs(R @ data.qvel).max()
        np.testing.assert_allclose(stage.drift(), drift, rtol=1e-12, atol=1e-13)
        assert stage.fits()


@pytest.mark.parametrize("models", [(capture.ARM, capture.TARGET), (capture.FLAT_ARM, capture.FLAT_TARGET)])
def test_the_logged_system_follows_what_moves(tmp_path, rng, models):
    """Free joint, and slides with a hinge that has turned a few times: pose and twist are those of the grasped object."""
    bench = capture.Bench(tmp_path, *models)
    bench.draw(rng)
    turned = models[0] is capture.FLAT_ARM
    if turned:
        bench.data.qpos[-1] = 40.0
        mujoco.mj_forward(bench.model, bench.data)
    bench.capture()
    moving, logged, twists = bench.grasped_motion, bench.data, np.zeros((2, 6))
    for _ in range(20):
        moving.step(1e-3)
    body = bench.system.objects[0].root
    root = moving.bodies[body]
    for model, data, number, twist in (
        (bench.model, logged, body, twists[0]),
        (moving.model, moving.data, root, twists[1]),
    ):
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, number, twist, 0)
    np.testing.assert_allclose(logged.xpos[body], moving.data.xpos[root], rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(logged.xmat[body], moving.data.xmat[root], rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(*twists, rtol=0.0, atol=1e-14)
    assert logged.time == moving.data.time
    if turned:
        assert abs(logged.qpos[-1] - 40.0) < np.pi
    product = np.empty(bench.model.nv)
    mujoco.mj_mulM(bench.model, logged, product, logged.qvel)
    np.testing.assert_allclose(bench.motion.momentum, product, rtol=0.0, atol=1e-14)
