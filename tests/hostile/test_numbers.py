"""Extreme numbers that pass ``check``: the run ends by itself, with an outcome."""

from __future__ import annotations

import pytest

import ffsm_mj
from tests.hostile.mjcf_mutations import model, xml


@pytest.mark.long
def test_an_arm_that_spins_too_fast_to_follow(tmp_path):
    """21 000 rad/s turn a link three times within a step: halving the step looked for a touch in noise without end."""
    robot = model("ffsm_3dof.xml")
    inertial = robot.find(".//body[@name='link_1']/inertial")
    assert inertial is not None
    inertial.set("pos", "0.01 0 0")
    (tmp_path / "robot.xml").write_bytes(xml(robot))
    fast = {"initial.rates.joint_2": -21139.442972200002, "initial.rates.base_yaw": 4.540521756}
    short = {"duration_s": 0.06, "control_period_s": 0.02, "conservative": False}
    run = ffsm_mj.run("coasting", {**short, **fast, "robot.mjcf": str(tmp_path / "robot.xml")})
    assert run.outcome == "diverged"
    assert "robot/gripper - object/box changes too often within a step to be followed" in run.message
