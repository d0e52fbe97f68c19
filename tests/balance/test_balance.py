"""Balance: external impulses are exact, wrong entries fail a check, order of the quadrature."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.balance.balance import Balance
from ffsm_mj.balance.external import BaseMotors, thrusters
from ffsm_mj.balance.quadrature import hermite_midpoint
from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.records.columns import Row
from ffsm_mj.records.signals import COMPONENTS, SUBSYSTEMS
from tests.scenes import FLOATING_BASES, HEAD, ball, compile_paths, scene

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
    balance = Balance(system, data, np.empty(system.mj.nv))
    fly(system, data, balance, step, seconds=seconds)
    energy, momentum = residuals(balance, system, data)
    return max(abs(energy[0]), np.abs(momentum[0]).max())


def sampled(balance):
    """Values of the columns now, as one row."""
    (columns,) = balance.columns
    columns.on_sample(math.nan)
    return columns.table(columns.live[None])[0]


def residuals(balance, system, data):
    """What the balance do not explain of energies (3,) and momenta (3, 6) now."""
    mujoco.mj_mulM(system.mj, data, balance.momentum, data.qvel)
    row, layout = sampled(balance), Row(balance.columns).layout
    energies = [f"balance.{subsystem}_energy_residual_J" for subsystem in SUBSYSTEMS]
    momenta = [f"balance.{subsystem}_residual_{component}" for subsystem in SUBSYSTEMS for component in COMPONENTS]
    return row[layout.places(energies)], row[layout.places(momenta)].reshape(3, 6)


def test_body_fixed_thruster_is_entered_to_fourth_order(tmp_path):
    """Simpson with a Hermite midpoint: 16 times less per halving; a trapezoid would fall by 4."""
    coarse, fine = held_jet(tmp_path, 0.02), held_jet(tmp_path, 0.01)
    assert coarse / fine > 2**3.7
    assert held_jet(tmp_path, 0.001) < 1e-9


LINK = """<body name="link" pos="0.3 -0.1 0.2"><joint name="shoulder" axis="0.2 1 0.4"/>
  <inertial pos="0.2 0.1 0" mass="0.8" diaginertia="0.02 0.03 0.03"/><site name="elbow" pos="0.3 0.1 -0.2" euler="70 10 30"/>
  </body>"""
BASES = {
    **FLOATING_BASES,
    "skewed": '<joint name="a" type="slide" axis="1 1 0"/><joint name="b" type="slide" axis="0 1 1"/>',
    "turning": '<joint name="yaw" axis="0 0 1"/><joint name="boom" type="slide" axis="1 0 0"/>',
}
JETS = {
    "base": '<motor site="nozzle" gear="0.5 -1 2 0.3 0.2 -0.4"/><motor site="hatch" gear="-1 0.4 0.2 0 0 0"/>',
    "link": '<motor site="elbow" gear="0.3 -1 0.5 0.1 0 0.2"/>',
    "both": '<motor site="nozzle" gear="0.5 -1 2 0.3 0.2 -0.4"/><motor site="elbow" gear="0.3 -1 0.5 0.1 0 0.2"/>',
    "reference": '<motor site="nozzle" refsite="elbow" gear="0.5 -1 2 0 0 0"/><motor site="hatch" gear="-1 0.4 0.2 0 0 0"/>',
    "tendon": '<motor tendon="cord" gear="0.7"/><motor site="elbow" gear="0.3 -1 0.5 0.1 0 0.2"/>',
}


def tug(folder, base, jets, step):
    """A base of some kind with a link, under held jets here and there; one of its jets saturates."""
    (folder / "tug.xml").write_text(f"""<mujoco>{HEAD}<worldbody><site name="anchor" pos="1 1 1"/><body name="bus">
      <inertial pos="0.05 -0.02 0.01" mass="3" diaginertia="0.2 0.3 0.35"/>{BASES[base]}<geom size="0.1" mass="0"/>
      <site name="nozzle" pos="0.3 0.2 -0.1" euler="20 50 -10"/><site name="hatch" pos="-0.4 0.1 0.1"/>{LINK}</body>
      </worldbody>
      <tendon><spatial name="cord"><site site="anchor"/><site site="hatch"/></spatial></tendon>
      <actuator>{JETS[jets]}<motor joint="shoulder"/></actuator></mujoco>""")
    system = compile_paths(folder / "tug.xml", time_step_s=step)
    system.mj.actuator_ctrllimited[0], system.mj.actuator_ctrlrange[0] = 1, (-0.5, 0.5)
    data = mujoco.MjData(system.mj)
    data.qvel[:] = np.array((0.2, -0.1, 0.3, 1.5, -3.0, 2.0, 1.0))[-system.mj.nv :]
    data.ctrl[:] = (1.0, -0.8, 0.3)[: system.mj.nu]
    mujoco.mj_forward(system.mj, data)
    return system, data


def fly(system, data, balance, step, *, seconds):
    """Integrate one step with constant efforts, and enter their work in the balance."""
    for _ in range(round(seconds / step)):
        balance.open()
        mujoco.mj_step(system.mj, data)
        mujoco.mj_forward(system.mj, data)
        balance.close(step)


@pytest.mark.long
@pytest.mark.parametrize("jets", JETS)
@pytest.mark.parametrize("base", BASES)
def test_what_pushes_is_entered_to_fourth_order(tmp_path, base, jets):
    """Whatever the base leaves free and whatever pushes where: 16 times less per halving, a millionth at the usual step."""
    left = []
    for step in (0.02, 0.01, 0.001):
        system, data = tug(tmp_path, base, jets, step)
        balance = Balance(system, data, np.empty(system.mj.nv))
        fly(system, data, balance, step, seconds=0.2)
        energy, momentum = residuals(balance, system, data)
        left.append(max(np.abs(energy).max(), np.abs(momentum).max()))
    assert left[0] / left[1] > 2**3.5 or left[0] < 1e-11  # a linear motion is exact
    assert left[2] < 1e-9


@pytest.mark.parametrize("base", sorted(set(BASES) - {"turning"}))
def test_thrusters_are_entered_as_their_generalised_forces_are(tmp_path, base):
    """Step by step, impulse and work from the poses of the bodies are those from the generalised forces on the base joints.

    The midpoints of both differ by (omega h)^4 / 400 of what they measure, here (4e-3)^4 / 400 < 1e-12.
    """
    system, data = tug(tmp_path, base, "both", 0.001)
    model, accounts = system.mj, np.zeros((2, 7))
    by_pose = thrusters(system, data, system.robot, accounts[0, :1], accounts[0, 1:])
    assert [group.actuators.tolist() for group in by_pose] == [[0], [1]]
    mask = np.array((True, True, False))
    motors = BaseMotors(system, data, system.robot, mask, ~mask, accounts[1, :1], accounts[1, 1:])
    for _ in range(300):
        for group in (*by_pose, motors):
            group.open()
        data.ctrl[2] += 0.01  # what drives a joint is nothing to them
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        for group in (*by_pose, motors):
            group.close(0.001)
    np.testing.assert_allclose(*accounts, rtol=0, atol=1e-11 * np.abs(accounts).max())
    assert np.count_nonzero(np.abs(accounts[0]) > 0.01) >= 4


@pytest.mark.parametrize("base", BASES)
def test_only_plain_sites_are_entered_by_pose(tmp_path, base):
    """A site with a reference is not, nor is any where the components that the base bears turn with it."""
    system, data = tug(tmp_path, base, "reference", 0.001)
    actuators = [group.actuators.tolist() for group in thrusters(system, data, system.robot, np.zeros(1), np.zeros(6))]
    assert actuators == ([] if base == "turning" else [[1]])


def test_a_limit_on_the_force_at_a_base_joint_is_kept(tmp_path):
    """MuJoCo's actuatorfrcrange takes from the impulse, so that no pose tells it."""
    joints = '<joint name="x" type="slide" axis="1 0 0" actuatorfrcrange="-1 1"/>'
    (tmp_path / "sled.xml").write_text(f"""<mujoco>{HEAD}<worldbody><body name="sled">{joints}<geom size="0.1" mass="2"/>
      <site name="nozzle"/></body></worldbody><actuator><motor site="nozzle" gear="5 0 0 0 0 0"/></actuator></mujoco>""")
    system = compile_paths(tmp_path / "sled.xml")
    data = mujoco.MjData(system.mj)
    data.ctrl[:] = 1.0
    mujoco.mj_forward(system.mj, data)
    balance = Balance(system, data, np.empty(system.mj.nv))
    fly(system, data, balance, 1e-3, seconds=0.1)
    assert np.abs(residuals(balance, system, data)[1]).max() < 1e-12
    assert data.qvel[0] == pytest.approx(0.05)


def test_a_thruster_of_an_object_works_but_pushes_no_robot(tmp_path):
    (tmp_path / "robot.xml").write_text(ball("ball"))
    (tmp_path / "tug.xml").write_text(TUMBLER)
    system = compile_paths(tmp_path / "robot.xml", {"tug": tmp_path / "tug.xml"})
    data = mujoco.MjData(system.mj)
    data.qvel[6:] = (0.2, -0.1, 0.3, 1.0, -2.0, 1.5)
    data.ctrl[:] = 2.0
    mujoco.mj_forward(system.mj, data)
    balance = Balance(system, data, np.empty(system.mj.nv))
    fly(system, data, balance, 1e-3, seconds=0.5)
    energy, momentum = residuals(balance, system, data)
    assert abs(energy[0]) < 1e-9
    assert np.abs(momentum[1]).max() == 0.0


def test_a_quaternion_may_change_its_sign_in_a_step(tmp_path):
    """Both signs say the same pose: what another model led there may come back with either."""
    done = []
    for sign in (1.0, -1.0):
        system, data = tug(tmp_path, "free", "base", 0.01)
        done.append(np.zeros(7))
        (group,) = thrusters(system, data, system.robot, done[-1][:1], done[-1][1:])
        group.open()
        mujoco.mj_step(system.mj, data)
        data.qpos[3:7] *= sign
        mujoco.mj_forward(system.mj, data)
        group.close(0.01)
    np.testing.assert_allclose(*done, rtol=1e-12)


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
    assert run["balance.external_P_x_N_s"][-1] == pytest.approx(2.0 * (run["state.v_robot_x_m_s"][-1] - 3.0), rel=1e-12)
    assert run["balance.external_P_x_N_s"][-1] < -0.5
    assert all(check.passes for check in all_checks(run, 1e-12))


def test_a_wrong_account_is_noticed(tmp_path):
    """The balances can fail: a velocity changed behind their back shows up as a residual of that size."""
    (tmp_path / "robot.xml").write_text(TUMBLER)
    system = compile_paths(tmp_path / "robot.xml")
    data = mujoco.MjData(system.mj)
    mujoco.mj_forward(system.mj, data)
    balance = Balance(system, data, np.empty(system.mj.nv))
    data.qvel[0] = 1e-6
    mujoco.mj_forward(system.mj, data)
    _, momentum = residuals(balance, system, data)
    assert momentum[0, 0] == pytest.approx(3e-6, rel=1e-9)


def test_what_is_carried_is_entered_by_its_states_and_jumps_are_not(tmp_path, rng):
    """Samples of two objects in one block, each from where it was taken; the other object's gains are nobody's."""
    (tmp_path / "robot.xml").write_text(TUMBLER)
    for name in ("one", "other"):
        (tmp_path / f"{name}.xml").write_text(ball(name, mass=2.0))
    system = compile_paths(tmp_path / "robot.xml", {name: tmp_path / f"{name}.xml" for name in ("one", "other")})
    data = mujoco.MjData(system.mj)
    balance = Balance(system, data, np.empty(system.mj.nv))
    layout = Row(balance.columns).layout
    contact = layout.places(f"balance.contact_{component}" for component in COMPONENTS)
    gained = layout.places(f"balance.{subsystem}_impact_energy_J" for subsystem in SUBSYSTEMS)
    given, energy = np.zeros(6), 0.0
    samples, expected = [], []
    (columns,) = balance.columns

    def sample():
        columns.on_sample(math.nan)
        samples.append(columns.live.copy())

    def moved():
        before = states()
        mujoco.mj_integratePos(system.mj, data.qpos, rng.normal(size=system.mj.nv), 0.3)
        data.qvel[:] = rng.normal(size=system.mj.nv)
        mujoco.mj_forward(system.mj, data)
        mujoco.mj_mulM(system.mj, data, balance.momentum, data.qvel)
        return states() - before

    def states():
        mujoco.mj_subtreeVel(system.mj, data)
        rows = []
        for tree in system.objects:
            P = system.mj.body_subtreemass[tree.root] * data.subtree_linvel[tree.root]
            L = data.subtree_angmom[tree.root] + np.cross(data.subtree_com[tree.root], P)
            M = mass_matrix(system.mj, data)
            rows.append([0.5 * data.qvel[tree.dofs] @ (M @ data.qvel)[tree.dofs], *P, *L])
        return np.array(rows)

    moved()
    for k in (0, 0, 1):
        balance.set_grasped_object(system.objects[k])
        for _ in range(2):
            change = moved()[k]
            energy, given = energy + change[0], given + change[1:]
            sample()
            expected.append([*given, 0.0, -energy, energy])
        balance.set_grasped_object(None)
        moved()  # a jump, which is booked by who makes it
        sample()
        expected.append(expected[-1])
    table = columns.table(np.array(samples))
    np.testing.assert_allclose(table[:, [*contact, *gained]], expected, rtol=0, atol=1e-13 * np.abs(expected).max())
