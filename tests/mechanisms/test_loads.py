"""Logged loads of equality constraints: pins, welds, couplings and tendons, in closed form and as what moves the bodies."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from tests.mechanisms.models import WELDED, mechanism
from tests.mechanisms.test_grips import gripped
from tests.replays import proved

FORCE, TORQUE = ([f"{what}_{x}_{unit}" for x in "xyz"] for what, unit in (("force", "N"), ("torque", "N_m")))
ROPE = """<mujoco><option gravity="0 0 0"/><worldbody><body name="base"><freejoint name="base"/>
  <inertial pos="0 0 0" mass="3" diaginertia="1 1 1"/><site name="a"/>
  <body name="mass"><joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
  <inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/><site name="b"/></body></body></worldbody>
  <tendon><spatial name="rope"><site site="a"/><site site="b"/></spatial></tendon>
  <equality><tendon name="taut" tendon1="rope" polycoef=".5 0 0 0 0"/></equality></mujoco>"""


def test_the_tension_of_a_rope(tmp_path):
    """M10: masses of 3 and 2 kg turn about each other at 1.6 rad/s: mu r w^2 = 1.2 * .5 * 1.6^2 = 1.536 N."""
    run = ffsm_mj.run(mechanism(tmp_path, ROPE, {"x": 0.5}, {"x": 0.0, "y": 0.8}, time_step_s=5e-3, control_period_s=0.02))
    proved(run)
    # A tension shortens the rope. The state has the error of the steps, 5e-11.
    np.testing.assert_allclose(run["contact.robot_taut_force_N"], -1.536, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("drive", "load"), [('tendon="pull"', 0.0), ('joint="f1"', 2.0)])
def test_the_load_of_a_coupling(tmp_path, drive, load):
    """M6: fingers that a motor of 4 N closes on a box; the coupling carries what the finger without a motor needs."""
    run = gripped(tmp_path, drive=drive)
    assert abs(float(run["contact.robot_f2_equality_force_N"][-1])) == pytest.approx(load, abs=1e-10)


def momenta_of_child(path, run):
    """Linear momentum of the child, its angular momentum about its mass centre, and the welded point from there, by row."""
    model = prepare(path).system.mj
    data, child, found = mujoco.MjData(model), model.body("robot/child").id, []
    for qpos, qvel in zip(run.qpos, run.qvel, strict=True):
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_forward(model, data)
        J, turn = np.zeros((3, model.nv)), np.zeros((3, model.nv))
        mujoco.mj_jacBodyCom(model, data, J, turn, child)
        axes = data.ximat[child].reshape(3, 3)
        spin = axes @ (model.body_inertia[child] * (axes.T @ (turn @ qvel)))
        point = data.xpos[child] + data.xmat[child].reshape(3, 3) @ (0.05, 0.02, 0.0)
        found.append((model.body_mass[child] * J @ qvel, spin, point - data.xipos[child]))
    return np.array(found).transpose(1, 0, 2)


@pytest.mark.parametrize("name", ["joint", ""])
def test_the_load_of_a_weld_is_what_moves_the_body(tmp_path, name):
    """M8: slides and a ball joint exert nothing, so the weld alone changes the momenta of the child."""
    text = WELDED.replace('name="joint"', f'name="{name}"' if name else "")
    start = "contact.robot_joint" if name else "contact.robot_base_equality"
    om, centre, h = np.array([0.8, -1.1, 0.6]), np.array([0.8, 0.4, -0.2]) / 7.0, 2e-3
    rates = {"robot/base": [*-np.cross(om, centre), *om]}
    path = mechanism(tmp_path, text, {}, rates, control_period_s=h, time_step_s=h, duration_s=0.2)
    run = ffsm_mj.run(path)
    proved(run)
    force, torque = (np.stack([run[f"{start}_{key}"] for key in keys], axis=1) for keys in (FORCE, TORQUE))
    linear, spin, arm = momenta_of_child(path, run)
    # Central differences are off by h^2 / 6 of the third derivative: 7e-7 of some 2 N 1/s^2 and 1 N m 1/s^2.
    for load, momentum in ((force, linear), (torque + np.cross(arm, force), spin)):
        assert np.abs(load).max() > 0.01
        np.testing.assert_allclose(load[1:-1], (momentum[2:] - momentum[:-2]) / (2.0 * h), rtol=0, atol=3e-6)
