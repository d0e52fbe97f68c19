"""Reaction null space: the base stays, the tip moves."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_controllers.task_space.base_rotation import BaseRotation
from ffsm_mj.controller_protocol import ControllerContext
from ffsm_mj.task_model import JointModel
from tests.controllers.task_laws import PD, critically_damped, planar_run, reports, spatial_run
from tests.scenes import HEAD, compile_paths

GIMBAL = f"""<mujoco>{HEAD}<worldbody><body name="base">
  <joint name="roll" axis="1 0 0"/><joint name="pitch" axis="0 1 0"/><joint name="yaw" axis="0 0 1"/>
  <inertial pos="0.1 0 0" mass="5" diaginertia="0.3 0.4 0.5"/><geom name="hull" size="0.1" mass="0"/>
  <body name="upper" pos="0.25 0 0"><joint name="shoulder" axis="0 0 1"/>
    <inertial pos="0.25 0 0" mass="1" diaginertia="0.01 0.02 0.02"/><geom name="upper" size="0.05" mass="0"/>
    <body name="lower" pos="0.5 0 0"><joint name="elbow" axis="0 1 0"/><site name="tip" pos="0.5 0 0"/>
      <inertial pos="0.25 0 0" mass="0.8" diaginertia="0.01 0.02 0.02"/><geom name="lower" size="0.05" mass="0"/>
  </body></body></body></worldbody>
  <actuator><motor name="shoulder" joint="shoulder"/><motor name="elbow" joint="elbow"/></actuator></mujoco>"""
"""A base on three hinges one after the other, whose angular velocity changes without any rate changing."""

RNS = {"kind": "rns", "position": PD, "joint_damping_N_m_s_rad": 2.0}


def test_the_base_of_the_case_study_does_not_turn():
    """T3: 8.28e-7 rad/s at 2 ms, of first order in the period, as the held torque is; computed torque turns it by 0.0856."""
    target = {"task.target_m": [7.4, 2.0]}
    rates, off = [], []
    for period_s in (0.016, 0.008):
        run = planar_run({"kind": "rns", "position": PD}, period_s, 6.0, **target)
        rates.append(np.abs(run["state.v_robot_base_yaw_rad_s"]).max())
        off.append(np.abs(run.tip_error() - critically_damped(run)).max())
        assert reports(run)["largest_base_rate_rad_s"] == pytest.approx(rates[-1], rel=1e-9)
    assert rates[1] == pytest.approx(4.0 * 8.28e-7, rel=2e-3)
    assert rates[0] / rates[1] == pytest.approx(2.0, rel=0.01)
    assert off[1] == pytest.approx(8.0 * 3.8e-5, rel=0.03)
    turned = planar_run({"kind": "task_ct", "position": PD}, 0.008, 6.0, **target)
    assert np.ptp(turned["state.q_robot_base_yaw_rad"]) == pytest.approx(0.0856, abs=1e-4)


@pytest.mark.parametrize("offset_m", [(0.1, -0.15, 0.12), (-0.2, 0.1, 0.1)])
def test_nor_does_that_of_seven_joints(offset_m):
    """Three rows of the tip and three of the base for seven joints: exact but for the period, one motion is left."""
    rates, off = [], []
    for period_s in (0.02, 0.01):
        run = spatial_run(RNS, period_s, 3.0, offset_m)
        rates.append(reports(run)["largest_base_rate_rad_s"])
        off.append(np.abs(run.tip_error() - critically_damped(run)).max())
    assert rates[1] < 2e-6
    np.testing.assert_allclose([rates[0] / rates[1], off[0] / off[1]], 2.0, rtol=0.03)
    turned = spatial_run({**RNS, "kind": "task_ct"}, 0.02, 3.0, offset_m)
    base = np.linalg.norm([turned[f"state.v_robot_base_w{axis}_rad_s"] for axis in "xyz"], axis=0)
    assert base.max() > 2e-3


def test_the_base_drifts_and_answers_as_finite_differences_say(tmp_path):
    """Angular velocity a moment before and after, coasting and with efforts: of second order in the moment."""
    path = tmp_path / "gimbal.xml"
    path.write_text(GIMBAL)
    system = compile_paths(path)
    joints = JointModel(ControllerContext(system, None, 0.01))
    base = BaseRotation(system, joints)
    assert base.size == 3
    rng = np.random.default_rng(2)
    qpos, qvel, efforts = rng.normal(size=5), rng.normal(size=5), np.array([0.3, -0.2])

    def rates_after(step_s, u):
        """Angular velocity after a step, which may be negative: everything turned round."""
        data = mujoco.MjData(system.mj)
        data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, np.sign(step_s) * qvel, u
        system.mj.opt.timestep = abs(step_s)
        mujoco.mj_step(system.mj, data)
        mujoco.mj_forward(system.mj, data)
        joints.update(data)
        base.update(data)
        return np.sign(step_s) * base.rates

    for u in (np.zeros(2), efforts):
        found = (rates_after(1e-4, u) - rates_after(-1e-4, u)) / 2e-4
        data = mujoco.MjData(system.mj)
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_forward(system.mj, data)
        joints.update(data)
        base.update(data)
        np.testing.assert_allclose(base.drift + base.B @ u, found, rtol=0, atol=1e-6)
    np.testing.assert_allclose(base.W, base.B @ joints.M_c, rtol=0, atol=1e-12)


def test_the_arm_takes_the_momentum_of_the_base():
    """A base that turns comes to rest by its own gains, at the rate that they say, while the tip goes to its target."""
    spinning = {"initial.rates": {"base": [0.0, 0.0, 0.0, -0.01, 0.01, 0.01]}}
    law = {**RNS, "base": {"kp_1_s2": 0.0, "kd_1_s": 1.0}}
    run = spatial_run(law, 0.02, 3.0, (-0.2, 0.1, 0.1), **spinning)
    rate = run["controller.rns_base_rate_rad_s"]
    assert reports(run)["least_task_share"] == 1.0
    # Held torques: of first order in the period, 0.02 s of 1 1/s, over 2 e.
    assert np.abs(rate - rate[0] * np.exp(-run.time)).max() < 0.02 / (2.0 * np.e) * 1.1 * rate[0]
    free = spatial_run(RNS, 0.02, 3.0, (-0.2, 0.1, 0.1), **spinning)["controller.rns_base_rate_rad_s"]
    assert np.abs(free - free[0]).max() < 1e-3 * free[0]


def test_near_an_algorithmic_singularity_it_is_damped_and_says_so():
    """T3: towards (3, 0) one is on the way; undamped, rates grow to 1e8. The base is left alone all the same."""
    run = planar_run({"kind": "rns", "position": PD, "singular_mass_kg": 50.0}, 0.02, 8.0)
    told = reports(run)
    assert run.outcome == "completed"
    assert told["near_singularity_s"] > 0.1
    assert told["note"].startswith("near a singularity for")
    assert told["least_task_share"] < 0.01
    assert np.abs(run.qvel).max() < 10.0
    assert told["largest_base_rate_rad_s"] < 0.05
    assert np.nanmin(run["controller.task_share"]) == told["least_task_share"]
