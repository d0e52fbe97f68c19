"""The compiled OSDRE laws: (32) with the matrices written out, and SciPy's solution of the Riccati equation."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

from ffsm_controllers.osdre.riccati import planar_riccati
from ffsm_mj._core.osdre import BlockLaw, PlanarLaw, TipKinematics
from ffsm_mj._core.riccati_doubling import Doubling
from ffsm_mj._core.riccati_planar import ACCEPTED_RESIDUAL
from ffsm_mj.dynamics.rigid_body import mass_matrix
from tests.core.arms import ARM, MOTORS, moving
from tests.scenes import compile_paths

R = np.diag([1.0, 2.0, 0.5])
DAMPING = 0.3
TARGET = np.array([3.0, 0.0, -1.0])


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    path = tmp_path_factory.mktemp("arm") / "robot.xml"
    path.write_text(ARM.format(options="", joint="", rest=MOTORS))
    return compile_paths(path)


def by_the_book(system, data, axes, Q, whole_stack):
    """Torques (32), alpha M_c^-1 and the distance from the target."""
    model, site, axes, p = system.mj, system.index("site", "tip"), list(axes), len(axes)
    jacobian, rate = np.zeros((2, 3, model.nv))
    mujoco.mj_jacSite(model, data, jacobian, None, site)
    mujoco.mj_jacDot(model, data, rate, None, data.site_xpos[site], int(model.site_bodyid[site]))
    W = np.linalg.solve(mass_matrix(model, data), jacobian[axes].T).T
    drift = rate[axes] @ data.qvel - W @ (data.qfrc_bias - data.qfrc_passive)
    y, y_dot, B2 = data.site_xpos[site][axes], jacobian[axes] @ data.qvel, W[:, 6:9]
    stack = np.concatenate((y, y_dot)) if whole_stack else y_dot
    lower = np.outer(drift, np.linalg.pinv(stack[:, None])[0])
    A, B = np.zeros((2 * p, 2 * p)), np.vstack((np.zeros((p, 3)), B2))
    A[:p, p:], A[p:, 2 * p - len(stack) :] = np.eye(p), lower
    K, error = solve_continuous_are(A, B, Q, R), y - TARGET[:p]
    return -np.linalg.solve(R, B.T @ K @ np.concatenate((error, y_dot))), B2, np.linalg.norm(error)


def along_a_motion(arm, law, axes, Q, whole_stack):
    """Ticks along a motion of an arm that moves in all directions, and at rest in its second half."""
    model, data = arm.mj, law[1]
    for tick in range(40):
        if tick == 20:
            data.qvel[:] = 0.0
            mujoco.mj_forward(model, data)
        law[0].tick()
        torques, B2, distance = by_the_book(arm, data, axes, Q, whole_stack)
        assert law[0].report[1] <= ACCEPTED_RESIDUAL
        # What SciPy leaves of the equation, some 1e-12 of its largest term, times the condition of S, some hundreds.
        np.testing.assert_allclose(law[0].effort, torques, rtol=0.0, atol=1e-8 * np.abs(torques).max())
        assert law[0].report[0] == pytest.approx(distance, rel=1e-12)
        assert law[0].report[-1] == pytest.approx(np.linalg.svd(B2)[1][-1], rel=1e-10)
        yield B2
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)


def assert_damped(laws, B2, rates):
    """The second law has the torques of the first, and a damping that the output does not feel."""
    laws[1].tick()
    damping = DAMPING * (rates - np.linalg.pinv(B2) @ (B2 @ rates))
    np.testing.assert_allclose(laws[1].effort, laws[0].effort - damping, rtol=0.0, atol=1e-11 * (1.0 + np.abs(rates).max()))


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize("whole_stack", [True, False])
@pytest.mark.parametrize("axes", [(0, 1), (1, 0), (0, 2), (2, 0), (2, 1)])
def test_two_outputs(arm, rng, axes, whole_stack):
    model, data, Q = arm.mj, moving(arm, rng), np.diag([1.0, 1.0, 0.5, 0.5])
    picked = np.eye(model.nv)[6:9]
    kinematics = TipKinematics(model, data, arm.index("site", "tip"), axes)
    driven = np.vstack((picked, np.linalg.solve(R, picked)))
    laws = [
        PlanarLaw(kinematics, data, planar_riccati(Q), driven, axes, TARGET[:2].tolist(), whole_stack, np.zeros(3), damping)
        for damping in (0.0, DAMPING)
    ]
    for B2 in along_a_motion(arm, (laws[0], data), axes, Q, whole_stack):
        assert_damped(laws, B2, data.qvel[6:9])


@pytest.mark.parametrize("whole_stack", [True, False])
@pytest.mark.parametrize("axes", [(2,), (0, 1), (0, 1, 2), (2, 0, 1)])
def test_any_number_of_outputs(arm, rng, axes, whole_stack):
    model, data, p = arm.mj, moving(arm, rng), len(axes)
    picked, Q = np.eye(model.nv)[6:9], np.eye(2 * p)
    kinematics = TipKinematics(model, data, arm.index("site", "tip"), axes)
    driven = np.vstack((picked, np.linalg.solve(R, picked)))
    laws = [
        BlockLaw(kinematics, data, Doubling(Q), driven, axes, TARGET[:p].tolist(), whole_stack, np.zeros(3), damping)
        for damping in (0.0, DAMPING)
    ]
    for B2 in along_a_motion(arm, (laws[0], data), axes, Q, whole_stack):
        assert_damped(laws, B2, data.qvel[6:9])


def test_doubling_refuses_other_sizes():
    with pytest.raises(ValueError, match="blocks of another size than 3"):
        Doubling(np.eye(6)).solve(np.eye(2), np.eye(2), np.eye(2))


def test_a_tip_that_is_not_there_is_refused(arm, rng):
    with pytest.raises(ValueError, match="no site 99"):
        TipKinematics(arm.mj, moving(arm, rng), 99, (0, 1))
