"""Ledgers: external impulses booked exactly, wrong bookkeeping noticed, order of the quadrature."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.books.midpoint import hermite_midpoint
from ffsm_mj.plant.ledger import Ledger
from ffsm_mj.records.columns import Row
from ffsm_mj.records.signals import COMPONENTS, PARTIES
from tests.scenes import HEAD, ball, compile_paths, scene

TUMBLER = f"""<mujoco>{HEAD}<worldbody><body name="bus">
  <inertial pos="0.05 -0.02 0.01" mass="3" diaginertia="0.2 0.3 0.35"/><freejoint name="free"/><geom size="0.1" mass="0"/>
  <site name="nozzle" pos="0.3 0.2 -0.1" euler="20 50 -10"/></body></worldbody>
  <actuator><motor name="jet" site="nozzle" gear="0 0 1 0 0 0"/></actuator></mujoco>"""


def held_jet(folder, step, *, seconds=1.0):
    """Residuals after a body-fixed thruster pushes a tumbling body."""
    (folder / "robot.xml").write_text(TUMBLER)
    system = compile_paths(folder / "robot.xml", time_step_s=step)
    data = mujoco.MjData(system.mj)
    data.qvel[:] = (0.2, -0.1, 0.3, 1.0, -2.0, 1.5)
    data.ctrl[:] = 2.0
    mujoco.mj_forward(system.mj, data)
    ledger = Ledger(system, data, np.empty(system.mj.nv))
    for _ in range(round(seconds / step)):
        ledger.open()
        mujoco.mj_step(system.mj, data)
        mujoco.mj_forward(system.mj, data)
        ledger.close(step)
    energy, momentum = residuals(ledger, system, data)
    return max(abs(energy[0]), np.abs(momentum[0]).max())


def residuals(ledger, system, data):
    """What the books do not explain of energies (3,) and momenta (3, 6) now."""
    mujoco.mj_mulM(system.mj, data, ledger.momentum, data.qvel)
    ledger.note()
    row, layout = ledger.table()[-1], Row(ledger.columns).layout
    energies = [f"ledger.{party}_energy_residual_J" for party in PARTIES]
    momenta = [f"ledger.{party}_residual_{component}" for party in PARTIES for component in COMPONENTS]
    return row[layout.places(energies)], row[layout.places(momenta)].reshape(3, 6)


def test_body_fixed_thruster_is_booked_to_fourth_order(tmp_path):
    """Simpson with a Hermite midpoint: 16 times less per halving; a trapezoid would fall by 4."""
    coarse, fine = held_jet(tmp_path, 0.02), held_jet(tmp_path, 0.01)
    assert coarse / fine > 2**3.7
    assert held_jet(tmp_path, 0.001) < 1e-9


def test_hermite_midpoint_is_fourth_order(tmp_path):
    """Against half a step of the integrator itself, on the rotation group."""
    (tmp_path / "robot.xml").write_text(TUMBLER)
    errors = []
    for step in (0.04, 0.02):
        system = compile_paths(tmp_path / "robot.xml", time_step_s=step)
        model = system.mj
        start, middle, end = (mujoco.MjData(model) for _ in range(3))
        for data, h in ((middle, step / 2), (end, step)):
            data.qvel[:] = (0.2, -0.1, 0.3, 1.0, -2.0, 1.5)
            model.opt.timestep = h / 40
            for _ in range(40):
                mujoco.mj_step(model, data)
        start.qvel[:] = (0.2, -0.1, 0.3, 1.0, -2.0, 1.5)
        q, v = hermite_midpoint(model, start.qpos, start.qvel, end.qpos, end.qvel, step)
        difference = np.empty(model.nv)
        mujoco.mj_differentiatePos(model, difference, 1.0, middle.qpos, q)
        errors.append((np.abs(difference).max(), np.abs(v - middle.qvel).max()))
    assert errors[0][0] / errors[1][0] > 2**3.7
    assert errors[0][1] / errors[1][1] > 2**2.7  # one order less for the rate


def test_world_force_on_a_base_joint(tmp_path):
    """A held force on a slide: P = F t, work = F x, exactly."""
    path = scene(
        tmp_path,
        ball("ball", mass=2.0, joints="x"),
        {},
        phases=[{"name": "push", "until": "end", "controller": {"kind": "pd", "joints": ["x"], "kp": 0.0, "kd": 0.5}}],
        initial={"rates": {"robot/x": 3.0}},
    )
    run = ffsm_mj.run(path)
    assert run["ledger.external_P_x_N_s"][-1] == pytest.approx(2.0 * (run["state.v_robot_x_m_s"][-1] - 3.0), rel=1e-12)
    assert run["ledger.external_P_x_N_s"][-1] < -0.5
    assert all(law.holds for law in run.laws(1e-12))


def test_a_wrong_account_is_noticed(tmp_path):
    """The ledgers can fail: a velocity changed behind their back shows up as a residual of that size."""
    (tmp_path / "robot.xml").write_text(TUMBLER)
    system = compile_paths(tmp_path / "robot.xml")
    data = mujoco.MjData(system.mj)
    mujoco.mj_forward(system.mj, data)
    ledger = Ledger(system, data, np.empty(system.mj.nv))
    data.qvel[0] = 1e-6
    mujoco.mj_forward(system.mj, data)
    _, momentum = residuals(ledger, system, data)
    assert momentum[0, 0] == pytest.approx(3e-6, rel=1e-9)
