"""What no control law changes about the impact of the case study: effective masses, spin by the lever arm, the reach."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import pytest
from scipy.optimize import minimize

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import mass_matrix

TARGET_M = np.array([3.0, 0.0])
NORMAL = np.array([1.0, 0.0, 0.0])
IMPACT_S = 7.769


@dataclass(frozen=True)
class Contact:
    """Rows of the velocities of robot and box along the normal where the tip touches, and the impulse on the robot."""

    point: FloatArray
    robot: FloatArray
    box: FloatArray
    M: FloatArray
    impulse: float


@pytest.fixture
def contact(case_study, impact_state):
    model, data = case_study.mj, impact_state
    site = model.site("robot/tip")
    point, M = data.site_xpos[site.id].copy(), mass_matrix(model, data)
    rows = []
    for body in (int(model.site_bodyid[site.id]), case_study.objects[0].root):
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jac(model, data, jacobian, None, point, body)
        rows.append(NORMAL @ jacobian)
    apart = rows[0] - rows[1]
    impulse = float(-2.0 * (apart @ data.qvel) / (apart @ np.linalg.solve(M, apart)))
    return Contact(point, rows[0], rows[1], M, impulse)


def inverse(M, row):
    """What a unit impulse along a row changes of the velocity along it, 1/kg."""
    return row @ np.linalg.solve(M, row)


def test_effective_masses(contact):
    """T7, to its eight digits: with free joints, with locked ones, and of the arm alone; the last two add up."""
    M, robot, base, arm = contact.M, contact.robot, slice(0, 3), slice(3, 6)
    free, locked = inverse(M, robot), inverse(M[base, base], robot[base])
    box = inverse(M, contact.box)
    np.testing.assert_allclose([free, box, locked], [0.28958978, 0.24021440, 0.08521470], rtol=0, atol=5.1e-9)
    assert contact.impulse == pytest.approx(1.22238196, abs=5.1e-9)
    assert contact.impulse * (free + box) / (locked + box) == pytest.approx(1.99006, abs=5.1e-6)
    coupling = np.linalg.solve(M[base, base], M[base, arm])
    alone = inverse(M[arm, arm] - M[arm, base] @ coupling, robot[arm] - robot[base] @ coupling)
    assert alone == pytest.approx(0.204375, abs=5.1e-7)
    assert alone + locked == pytest.approx(free, rel=1e-12)
    assert abs(np.linalg.solve(M, robot)[2]) == pytest.approx(0.03134572, abs=5.1e-9)


def test_the_spin_is_that_of_the_lever_arm(case_study, impact_state, contact):
    """T8: whatever the configuration, L about the robot's centre of mass jumps by (p - c) x n I."""
    model, data, root = case_study.mj, impact_state, case_study.robot.root
    mujoco.mj_subtreeVel(model, data)
    before = data.subtree_angmom[root].copy()
    data.qvel[:] += np.linalg.solve(contact.M, contact.robot) * contact.impulse
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    jump = (data.subtree_angmom[root] - before)[2]
    lever = np.cross(contact.point - data.subtree_com[root], NORMAL)[2]
    assert jump == pytest.approx(lever * contact.impulse, abs=1e-14)
    assert abs(lever) == pytest.approx(0.15785, abs=5.1e-6)
    assert abs(jump) == pytest.approx(0.193, abs=5.1e-4)


def test_the_target_drifts_out_of_reach(case_study, impact_state, contact):
    """T9: the tip is at most 4.410369 m from the centre of mass, which drifts: no law comes closer to the target."""
    model, root = case_study.mj, case_study.robot.root
    centre, drift = impact_state.subtree_com[root][:2].copy(), contact.impulse * NORMAL[:2] / model.body_subtreemass[root]
    assert np.linalg.norm(drift) == pytest.approx(0.101865, abs=5.1e-7)
    data, tip = mujoco.MjData(model), model.site("robot/tip").id

    def nearness(q):
        data.qpos[3:6] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        return -float(np.linalg.norm(data.site_xpos[tip] - data.subtree_com[root]))

    finely = {"xatol": 1e-9, "fatol": 1e-14}
    starts = np.random.default_rng(0).uniform(-np.pi, np.pi, (6, 3))
    reach = -min(minimize(nearness, q, method="Nelder-Mead", options=finely).fun for q in starts)
    assert reach == pytest.approx(4.410369, abs=5.1e-7)
    floor = [np.linalg.norm(centre + drift * (t - IMPACT_S) - TARGET_M) - reach for t in (22.578, 25.0, 30.0)]
    # IMPACT_S and the times have three digits after the point: 1 ms of the drift.
    np.testing.assert_allclose(floor, [0.0, 0.2453, 0.7523], rtol=0, atol=1.02e-4 + 5.1e-5)
