"""OSDRE: the factorisations reproduce the dynamics, the gain solves its equation, the invariances are as documented."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_controllers.osdre import riccati
from ffsm_controllers.osdre.law import Osdre, OsdreConfig
from ffsm_mj._core.riccati_planar import PlanarRiccati, turned
from ffsm_mj.controller_protocol import Command, ControllerContext, Observation, Task

WEIGHTS = {"Q": (1.0, 1.0, 0.5, 0.5), "R": (1.0, 1.0, 1.0)}


def law(system, target=(3.0, 0.0), **config):
    task = Task(system.index("site", "tip"), (0, 1), np.array(target))
    return Osdre(OsdreConfig(kind="osdre", **{**WEIGHTS, **config}), ControllerContext(system, task, 1e-3))


def command_at(system, controller, qpos, qvel):
    data = mujoco.MjData(system.mj)
    data.qpos[:], data.qvel[:] = qpos, qvel
    mujoco.mj_forward(system.mj, data)
    command = Command.off(system.mj.nu)
    controller.start(Observation(0.0, data))
    controller.control(Observation(0.0, data), command)
    return command


@pytest.fixture
def state(case_study, rng):
    return rng.uniform(-1.5, 1.5, case_study.mj.nq), rng.uniform(-0.5, 0.5, case_study.mj.nv)


def test_only_the_named_joints_are_driven(case_study, state):
    command = command_at(case_study, law(case_study), *state)
    assert command.powered.tolist() == [False, False, False, True, True, True]
    assert not command.effort[:3].any()


def shifted(qpos, by):
    moved = qpos.copy()
    moved[:2] += by
    moved[6:8] += by
    return moved


def test_velocity_is_translation_invariant_and_output_stack_is_not(case_study, state):
    """The absolute output in z makes ``output_stack`` depend on where the world's origin is; ``velocity`` does not."""
    by = np.array([0.7, -1.3])
    efforts = {}
    for kind in ("velocity", "output_stack"):
        here = command_at(case_study, law(case_study, parameterization=kind), *state)
        there = command_at(
            case_study,
            law(case_study, target=np.array([3.0, 0.0]) + by, parameterization=kind),
            shifted(state[0], by),
            state[1],
        )
        efforts[kind] = np.abs(here.effort - there.effort).max() / np.abs(here.effort).max()
    assert efforts["velocity"] < 1e-8  # the Riccati solution is verified to 1e-9
    assert efforts["output_stack"] > 1e-3


@pytest.mark.parametrize("kind", ["velocity", "output_stack"])
def test_factorisation_reproduces_the_output_dynamics(case_study, state, kind, monkeypatch):
    """A z + B u = zdot with MuJoCo's own acceleration, for both parameterizations and any momentum."""
    seen = {}

    class Kept(PlanarRiccati):
        def solve(self, A21, A22, S, axes):
            back = (axes[0], -axes[1])
            lower = [np.reshape(turned(block, back), (2, 2)) for block in (A21, A22)]
            seen["A"] = np.block([[np.zeros((2, 2)), np.eye(2)], lower])
            return super().solve(A21, A22, S, axes)

    monkeypatch.setattr(riccati, "PlanarRiccati", Kept)
    command = command_at(case_study, law(case_study, parameterization=kind), *state)
    model = case_study.mj
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = state
    data.ctrl[:] = command.effort
    mujoco.mj_forward(model, data)
    site = case_study.index("site", "tip")
    jac, jac_dot = np.empty((3, model.nv)), np.empty((3, model.nv))
    mujoco.mj_jacSite(model, data, jac, None, site)
    mujoco.mj_jacDot(model, data, jac_dot, None, data.site_xpos[site], model.site_bodyid[site])
    y, y_dot = data.site_xpos[site][:2], (jac @ data.qvel)[:2]
    acceleration = (jac @ data.qacc + jac_dot @ data.qvel)[:2]
    z = np.concatenate((y, y_dot))
    # B u = [0; alpha M_c^-1 u] is the change of acceleration that the torques make.
    data.ctrl[:] = 0.0
    mujoco.mj_forward(model, data)
    without = (jac @ data.qacc + jac_dot @ data.qvel)[:2]
    z_dot = seen["A"] @ z + np.concatenate((np.zeros(2), acceleration - without))
    np.testing.assert_allclose(z_dot, np.concatenate((y_dot, acceleration)), atol=1e-11 * (1 + np.abs(acceleration).max()))


def test_at_the_target_at_rest_nothing_is_asked(case_study, state):
    data = mujoco.MjData(case_study.mj)
    data.qpos[:] = state[0]
    mujoco.mj_forward(case_study.mj, data)
    tip = data.site_xpos[case_study.index("site", "tip")][:2]
    command = command_at(case_study, law(case_study, target=tip), state[0], np.zeros(case_study.mj.nv))
    np.testing.assert_allclose(command.effort, 0.0, atol=1e-12)


def test_full_weights_equal_diagonal_ones(case_study, state):
    full = law(case_study, Q=tuple(map(tuple, np.diag(WEIGHTS["Q"]).tolist())), R=tuple(map(tuple, np.eye(3).tolist())))
    diagonal = command_at(case_study, law(case_study), *state)
    np.testing.assert_array_equal(command_at(case_study, full, *state).effort, diagonal.effort)
