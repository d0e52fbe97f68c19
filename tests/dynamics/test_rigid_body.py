"""Masses, momenta, Jacobians and the reduced model against independent computations."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_mj.dynamics.rigid_body import (
    base_jacobian,
    base_wrench,
    cross,
    free_components,
    kinetic_energy,
    mass_matrix,
    momentum_matrix,
    reduced_model,
)
from tests.scenes import ball, box, compile_paths, of_subtree


@pytest.fixture(scope="module")
def spatial(tmp_path_factory):
    """A free base with two crossed hinges, and a free box: nothing planar about it."""
    folder = tmp_path_factory.mktemp("spatial")
    (folder / "robot.xml").write_text("""<mujoco><option gravity="0 0 0"/><worldbody><body name="base">
      <inertial pos="0.1 -0.2 0.05" mass="7" diaginertia="0.9 1.1 1.3"/><freejoint name="free"/><geom size="0.2" mass="0"/>
      <body pos="0.5 0.1 0"><inertial pos="0.3 0 0" mass="2" diaginertia="0.02 0.2 0.2"/>
        <joint name="a" axis="0 0.6 0.8"/><geom size="0.1" mass="0"/>
        <body pos="0.7 0 0"><inertial pos="0.2 0.1 0" mass="1" diaginertia="0.03 0.05 0.07"/>
          <joint name="b" axis="1 0 0"/><geom size="0.1" mass="0"/><site name="tip" pos="0.4 0.2 0.1"/></body></body>
      </body></worldbody><actuator><motor joint="a"/><motor joint="b"/></actuator></mujoco>""")
    (folder / "box.xml").write_text(box())
    return compile_paths(folder / "robot.xml", {"box": folder / "box.xml"})


def random_state(system, rng):
    data = mujoco.MjData(system.mj)
    mujoco.mj_integratePos(system.mj, data.qpos, rng.uniform(-2, 2, system.mj.nv), 1.0)
    data.qvel[:] = rng.uniform(-1, 1, system.mj.nv)
    mujoco.mj_forward(system.mj, data)
    mujoco.mj_subtreeVel(system.mj, data)
    return data


@pytest.mark.parametrize("which", ["case_study", "spatial"])
def test_momentum_three_ways(which, request, rng):
    """Body by body, by the momentum matrix, and from the base rows of M qdot (paper (8)-(9))."""
    system = request.getfixturevalue(which)
    for _ in range(20):
        data = random_state(system, rng)
        h = mass_matrix(system.mj, data) @ data.qvel
        for tree in system.trees:
            bodies = of_subtree(system.mj, data, tree.root)
            tolerance = 1e-13 * (1 + np.abs(bodies).max()) * 10
            np.testing.assert_allclose(momentum_matrix(system.mj, data, tree.root) @ data.qvel, bodies, atol=tolerance)
            rows = base_wrench(base_jacobian(system.mj, data, tree), h[tree.base_dofs])
            free = free_components(system, tree)
            np.testing.assert_allclose(rows[free], bodies[free], atol=tolerance)


def test_paper_momentum_is_about_the_base(case_study, rng):
    """(8) gives L about the base's centre of mass, (9) moves it to the origin."""
    data = random_state(case_study, rng)
    h = mass_matrix(case_study.mj, data) @ data.qvel
    Px, Py, L_base = h[:3]
    x, y = data.qpos[:2]
    assert of_subtree(case_study.mj, data, case_study.robot.root)[5] == pytest.approx(L_base + x * Py - y * Px, rel=1e-12)


def test_mass_matrix_and_energy(spatial, rng):
    data = random_state(spatial, rng)
    M = mass_matrix(spatial.mj, data)
    np.testing.assert_array_equal(M, M.T)
    assert np.linalg.eigvalsh(M)[0] > 0
    # Independent: sum over bodies of m v^2 / 2 + w I w / 2.
    T = 0.0
    for body in range(1, spatial.mj.nbody):
        velocity = np.empty(6)
        mujoco.mj_objectVelocity(spatial.mj, data, mujoco.mjtObj.mjOBJ_BODY, body, velocity, 1)  # inertial frame, local
        T += 0.5 * spatial.mj.body_mass[body] * velocity[3:] @ velocity[3:]
        T += 0.5 * velocity[:3] @ (spatial.mj.body_inertia[body] * velocity[:3])
    assert kinetic_energy(M, data.qvel) == pytest.approx(T, rel=1e-13)


def test_cross_products_are_numpys_to_the_last_bit(rng):
    """Of vectors of any size: the same products and the same differences."""
    for v, w in rng.standard_normal((200, 2, 3)) * 10.0 ** rng.integers(-8, 8, (200, 2, 3)):
        np.testing.assert_array_equal(cross(v, w), np.cross(v, w))


def test_free_components(case_study, spatial, tmp_path):
    planar = [True, True, False, False, False, True]
    assert free_components(case_study, case_study.robot).tolist() == planar
    assert free_components(case_study, case_study.objects[0]).tolist() == planar
    assert free_components(spatial, spatial.robot).all()
    (tmp_path / "rail.xml").write_text(ball(joints="y"))
    rail = compile_paths(tmp_path / "rail.xml")
    assert free_components(rail, rail.robot).tolist() == [False, True, False, False, False, False]


@pytest.mark.parametrize("which", ["case_study", "spatial"])
def test_reduced_model_gives_the_true_output_acceleration(which, request, rng):
    """Ydd = drift + alpha M_c^-1 u against MuJoCo's own qacc, momentum not zero (paper (22)-(24), (29))."""
    system = request.getfixturevalue(which)
    model, robot = system.mj, system.robot.dofs
    site = system.index("site", "tip")
    for _ in range(20):
        data = random_state(system, rng)
        arm = np.array([j.dofs.start for j in system.robot.joints if j.dofs.start >= system.robot.base_dofs.stop])
        base = np.setdiff1d(np.arange(robot.stop), arm)
        jac, jac_dot = np.empty((3, model.nv)), np.empty((3, model.nv))
        mujoco.mj_jacSite(model, data, jac, None, site)
        mujoco.mj_jacDot(model, data, jac_dot, None, data.site_xpos[site], model.site_bodyid[site])
        M = mass_matrix(model, data)[robot, robot]
        reduced = reduced_model(
            M, data.qfrc_bias[robot].copy(), jac[:, robot], jac_dot[:, robot] @ data.qvel[robot], arm, base
        )
        u = rng.uniform(-1, 1, len(arm))
        data.qfrc_applied[arm] = u
        mujoco.mj_forward(model, data)
        expected = jac[:, robot] @ data.qacc[robot] + jac_dot[:, robot] @ data.qvel[robot]
        found = reduced.drift + reduced.alpha @ np.linalg.solve(reduced.M_c, u)
        np.testing.assert_allclose(found, expected, atol=1e-11 * (1 + np.abs(expected).max()))
