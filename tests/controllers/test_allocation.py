"""Thrusters that together make a force."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import scipy.optimize
from ffsm_controllers.allocation import ThrusterAllocation, moments

from ffsm_mj.errors import ControllerError
from tests.conftest import MJCF
from tests.scenes import compile_paths


@pytest.fixture(scope="module")
def hardware():
    """Allocation of the body-fixed one-way thrusters of a turned robot, its data, and the force on the base per effort."""
    system = compile_paths(MJCF / "ffsm_3dof_hardware.xml", {"object": MJCF / "box_1m.xml"})
    data = mujoco.MjData(system.mj)
    data.qpos[2] = 0.7
    mujoco.mj_forward(system.mj, data)
    thrusters = np.array([i for i in range(system.mj.nu) if system.mj.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_SITE])
    return ThrusterAllocation(system, thrusters), data, moments(system.mj, data)[thrusters][:, system.robot.base_dofs].T


def test_where_nnls_goes_round_in_circles_small_shares_decide(hardware, rng, monkeypatch):
    """Shares need not be the same where thrusters are redundant; each pushes only, and their sum is as close to the force.

    The weight on small shares is 1e-7 of the columns, and costs its square over that of the smallest singular value, here
    above the columns' length: 1e-14 where the force can be made. A millionth is what the code promises.
    """
    allocation, data, effect = hardware
    forces = rng.uniform(-30.0, 30.0, (20, len(effect)))
    exact = [allocation.efforts(data, force) for force in forces]
    nnls, limits = scipy.optimize.nnls, []

    def circling(A, b, maxiter=None):
        limits.append(maxiter)
        if maxiter is None:
            raise RuntimeError("Maximum number of iterations reached.")
        return nnls(A, b, maxiter=maxiter)

    monkeypatch.setattr(scipy.optimize, "nnls", circling)
    for force, efforts in zip(forces, exact, strict=True):
        other = allocation.efforts(data, force)
        assert other.min() >= 0.0
        np.testing.assert_allclose(effect @ other, effect @ efforts, rtol=0, atol=1e-6 * np.linalg.norm(force))
    assert None in limits


def test_where_no_shares_are_found_the_controller_says_so(hardware, monkeypatch):
    allocation, data, effect = hardware

    def circling(*_, **__):
        raise RuntimeError("Maximum number of iterations reached.")

    monkeypatch.setattr(scipy.optimize, "nnls", circling)
    with pytest.raises(ControllerError, match="no shares of the thrusters"):
        allocation.efforts(data, np.ones(len(effect)))
