"""Steps with forces in their stages against MuJoCo's own steps, where there is nothing to push."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_mj.dynamics.motion import Motion
from tests.conftest import MJCF
from tests.scenes import compile_paths, of_subtree


def tumbling(system, step):
    """The spatial robot and its object, all joints turning, at the start of a step before which the efforts change."""
    data = mujoco.MjData(system.mj)
    data.qvel[:] = 0.5 * np.sin(1.0 + np.arange(system.mj.nv))
    mujoco.mj_forward(system.mj, data)
    motion = Motion(system.mj, data)
    for effort in (0.2, -0.3):
        data.ctrl[:] = effort
        yield motion
        motion.step(step)


@pytest.mark.parametrize("step", [1e-3, 1e-2])
def test_without_a_force_a_step_is_mujocos(step):
    """To rounding of numbers of size 1, for rotations too: MuJoCo's scheme, only with a word in its stages.

    The efforts change just before a step; those of before in its first stage would leave 1e-3.
    """
    system = compile_paths(MJCF / "spacecraft_7dof.xml", {"object": MJCF / "satellite_defunct.xml"}, time_step_s=step)
    ends = []
    for pushes in ([], [lambda _: None]):
        for motion in tumbling(system, step):
            motion.push_with(pushes)
            assert type(motion.stepper).__name__ == ("ForcedStepper" if pushes else "FreeStepper")
        ends.append(np.concatenate((motion.data.qpos, motion.data.qvel)))
    np.testing.assert_allclose(*ends, rtol=0.0, atol=1e-14)


def test_a_force_is_gone_when_nobody_pushes_any_more():
    system = compile_paths(MJCF / "spacecraft_7dof.xml", {"object": MJCF / "satellite_defunct.xml"})
    motion = Motion(system.mj, mujoco.MjData(system.mj))

    def push(data):
        data.qfrc_applied[0] += 1.0

    motion.push_with([push])
    motion.step(1e-3)
    assert motion.data.qacc[0] > 0.0
    motion.push_with([])
    assert not motion.data.qfrc_applied.any()
    np.testing.assert_allclose(motion.data.qacc, 0.0, atol=1e-12)


def test_a_force_is_asked_for_once_a_stage_and_does_not_pile_up():
    """Four stages and the end of the step, at which derived quantities are brought up to date."""
    system = compile_paths(MJCF / "spacecraft_7dof.xml", {"object": MJCF / "satellite_defunct.xml"})
    motion, asked = Motion(system.mj, mujoco.MjData(system.mj)), []

    def push(data):
        asked.append(data.qpos.copy())
        data.qfrc_applied[0] += 1.0

    motion.push_with([push])
    for _ in range(3):
        asked.clear()
        motion.step(1e-3)
        assert len(asked) == 5
        x = [qpos[0] for qpos in asked]
        assert x[0] <= x[1] <= x[2] < x[3]
        assert motion.data.qfrc_applied.tolist() == [1.0] + [0.0] * (system.mj.nv - 1)


@pytest.mark.parametrize("pushes", [[], [lambda _: None]], ids=["free", "pushed"])
def test_the_angular_momentum_of_a_tumbling_body_drifts_with_the_fourth_power_of_the_step(pushes):
    """Rotations too: a scheme that adds up rates of rotation in each stage without their commutators is of order two."""
    drifts = []
    for step in (1e-2, 5e-3):
        system = compile_paths(MJCF / "spacecraft_7dof.xml", {"object": MJCF / "satellite_defunct.xml"}, time_step_s=step)
        (tree,) = system.objects
        data = mujoco.MjData(system.mj)
        data.qvel[-3:] = 3.0, -2.0, 4.0
        mujoco.mj_forward(system.mj, data)
        motion = Motion(system.mj, data)
        motion.push_with(pushes)
        before = of_subtree(system.mj, data, tree.root)[1]
        for _ in range(round(1.0 / step)):
            motion.step(step)
        drifts.append(np.abs(of_subtree(system.mj, data, tree.root)[1] - before).max() / np.abs(before).max())
    assert drifts[1] > 1e-12
    assert np.log2(drifts[0] / drifts[1]) >= 3.8
