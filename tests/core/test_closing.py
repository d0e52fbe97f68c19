"""Relative motion of two sites and the bounds on it: against rotations of SciPy, and against the motion itself."""

from __future__ import annotations

from itertools import pairwise

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ffsm_mj._core.closing import ClosingBounds, SiteMotion

TWO_BODIES = """<mujoco><option timestep="1e-3" gravity="0 0 0" integrator="RK4"/><worldbody>
  <body><freejoint/><geom size="0.1 0.2 0.3" type="box"/><site pos="0.1 -0.2 0.3" euler="20 40 70"/></body>
  <body pos="1 0 0"><freejoint/><geom size="0.3 0.2 0.1" type="box"/><site pos="0.3 0.1 0"/></body>
</worldbody></mujoco>"""
STEP_S = 1e-3


@pytest.fixture
def bodies(rng):
    model = mujoco.MjModel.from_xml_string(TWO_BODIES)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = rng.normal(size=model.nq), rng.normal(size=model.nv)
    mujoco.mj_forward(model, data)
    return model, data, SiteMotion(model, 1, 2, 0, 1)


def test_offset_and_rotation(bodies):
    """The rotation turns the axes of the hand into those of the handle; numbers of 1 round to 1e-15."""
    _, data, sites = bodies
    motion = sites.at(data)
    offset, rotation = motion.vectors[:2]
    there, hand = (Rotation.from_matrix(data.site_xmat[site].reshape(3, 3)) for site in (1, 0))
    np.testing.assert_allclose(offset, data.site_xpos[1] - data.site_xpos[0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(rotation, (there * hand.inv()).as_rotvec(), rtol=0, atol=1e-14)
    assert motion.norms == pytest.approx(np.linalg.norm(motion.vectors, axis=1), rel=1e-15)


def test_velocities_are_rates_of_the_pose_seen_from_the_link(bodies):
    """In axes of the link, in which its own motion is none: central differences are off by the square of the step, 1e-6."""
    model, data, sites = bodies
    velocity, spin = (np.array(part) for part in sites.at(data).vectors[2:])
    axes = data.xmat[1].reshape(3, 3).copy()
    seen = []
    for sense in (-1.0, 1.0):
        moved = mujoco.MjData(model)
        moved.qpos[:] = data.qpos
        mujoco.mj_integratePos(model, moved.qpos, data.qvel, sense * STEP_S)
        mujoco.mj_forward(model, moved)
        link = moved.xmat[1].reshape(3, 3)
        seen.append((link.T @ (moved.site_xpos[1] - moved.xpos[1]), link.T @ moved.site_xmat[1].reshape(3, 3)))
    (before, turned_before), (after, turned_after) = seen
    np.testing.assert_allclose(axes @ (after - before) / (2.0 * STEP_S), velocity, rtol=0, atol=1e-5)
    turn = Rotation.from_matrix(turned_after @ turned_before.T).as_rotvec()
    np.testing.assert_allclose(axes @ turn / (2.0 * STEP_S), spin, rtol=0, atol=1e-5)


@pytest.mark.parametrize("stated", [(0.5, None, None, None), (None, 0.2, None, None), (0.5, 0.2, 1.0, 2.0)])
def test_largest_ratio_its_rate_and_what_no_step_undercuts(bodies, stated):
    """Along a free motion: the ratio is the largest one, its rate is that of the ratio, and it dips where it is said to."""
    model, data, sites = bodies
    bounds, motions, ratios = ClosingBounds(stated), [], []
    for _ in range(200):
        motions.append(sites.at(data))
        of_norms = [norm / bound for norm, bound in zip(motions[-1].norms, stated, strict=True) if bound is not None]
        ratios.append(bounds.ratio(motions[-1].norms))
        assert ratios[-1] == max(of_norms)
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
    if stated[2] is None:  # no acceleration is asked for: the rate of the ratio follows from the motion
        rates = [bounds.rate(motion, [[0.0] * 3] * 2) for motion in motions]
        # Central differences, which are off by the square of the step.
        assert rates[1:-1] == pytest.approx(np.gradient(ratios, STEP_S)[1:-1], abs=1e-4)
    tight = ClosingBounds([None if bound is None else 1e-6 for bound in stated])
    assert not any(tight.may_dip(*ends, STEP_S) for ends in pairwise(motions))
    loose = ClosingBounds([None if bound is None else 1e6 for bound in stated])
    assert all(loose.may_dip(*ends, STEP_S) for ends in pairwise(motions))
