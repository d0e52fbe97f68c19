"""The law that holds joints: its closed loop has the stated bandwidth, with the reaction of base and other joints."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.controller_protocol import Command, Observation
from ffsm_mj.errors import InputError
from tests.controllers.test_track import ARM, WHEELS
from tests.scenes import ball, scene

W, ZETA = 2.0, 0.7
START = np.array([0.0, -1.4, 0.3, 2.5, -0.4, -1.1, 0.3])
"""Configuration of the arm at the start of the scenario ``capture``."""
PARTS = {"wrist_alone": ["wrist"], "arm": ARM, "arm_and_wheels": [*ARM, *WHEELS]}


def arm(law, **changes):
    """The seven-joint arm on its free base at rest, with ideal motors, its satellite far away."""
    return prepare(
        "capture",
        {
            "actuators": {},
            "grasps": {},
            "time_step_s": 0.01,
            "duration_s": 1.0,
            "initial.joints.satellite/free": [50.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
            "initial.rates": {},
            "phases": [{"name": "all", "until": "end", "controller": {"kind": "hold", **law}}],
            **changes,
        },
    )


def linearised(assembly, reference=None):
    """The closed loop on the driven joints at the reference, by central differences of the plant, (2 n, 2 n)."""
    system, data = assembly.system, mujoco.MjData(assembly.system.mj)
    law = assembly.controller.phases[0].controller
    joints = [int(system.mj.actuator_trnid[i, 0]) for i in law.driven_actuators]
    qpos, dofs = system.mj.jnt_qposadr[joints], system.mj.jnt_dofadr[joints]
    data.qpos[:] = assembly.data.qpos
    mujoco.mj_forward(system.mj, data)
    law.start(Observation(0.0, data))
    if reference is not None:
        data.qpos[qpos] = reference
    middle, n = data.qpos[qpos].copy(), len(joints)

    def acceleration(state):
        data.qpos[qpos], data.qvel[dofs], data.qfrc_applied[:] = middle + state[:n], state[n:], 0.0
        mujoco.mj_forward(system.mj, data)
        command = Command.off(system.mj.nu)
        law.control(Observation(0.0, data), command)
        data.qfrc_applied[dofs] = command.effort[law.driven_actuators]
        mujoco.mj_forward(system.mj, data)
        return data.qacc[dofs]

    step = 1e-5
    lower = [(acceleration(step * unit) - acceleration(-step * unit)) / (2.0 * step) for unit in np.eye(2 * n)]
    return np.vstack((np.eye(2 * n)[n:], np.array(lower).T))


@pytest.mark.parametrize("name", PARTS)
@pytest.mark.parametrize("zeta", [ZETA, 2.0])
def test_the_closed_loop_has_the_stated_bandwidth(name, zeta):
    """All eigenvalues are w (-zeta +- sqrt(zeta^2 - 1)), whatever the coupling: differences leave 1e-7 of w^2."""
    assembly = arm({"joints": PARTS[name], "bandwidth_rad_s": W, "damping_ratio": zeta}).assemble()
    n = len(PARTS[name])
    matrix = linearised(assembly)
    expected = np.block([[np.zeros((n, n)), np.eye(n)], [-(W**2) * np.eye(n), -2.0 * zeta * W * np.eye(n)]])
    np.testing.assert_allclose(matrix, expected, atol=1e-6)
    values = sorted(np.linalg.eigvals(matrix), key=lambda z: (round(z.imag, 6), z.real))
    roots = np.roots([1.0, 2.0 * zeta * W, W**2])
    np.testing.assert_allclose(values, sorted(np.tile(roots, n), key=lambda z: (z.imag, z.real)), atol=1e-5)


def test_the_bandwidth_is_that_at_the_given_positions():
    """Gains are those where it holds, not where it starts, in Hz as in rad/s."""
    there = [0.3, -1.0, 0.2, 1.2, 0.1, -0.6, 0.4]
    law = {"joints": ARM, "bandwidth_Hz": W / (2.0 * np.pi), "positions": there}
    matrix = linearised(arm(law).assemble(), there)
    np.testing.assert_allclose(matrix[7:, :7], -(W**2) * np.eye(7), atol=1e-6)
    np.testing.assert_allclose(matrix[7:, 7:], -2.0 * W * np.eye(7), atol=1e-6)
    away = linearised(arm(law).assemble())
    assert np.abs(away[7:, 7:] + 2.0 * W * np.eye(7)).max() > 0.1


@pytest.mark.parametrize("share", [0.05, 0.5])
def test_a_run_follows_the_sampled_closed_form(share):
    """A step of 1e-4 rad, at a short control period and at half of the stability limit: nothing but its square is left."""
    period, w = 0.01, share / (ZETA * 0.01)
    offset = 1e-4 * np.array([1.0, -2.0, 0.5, 1.5, -1.0, 0.7, 1.0])
    law = {"joints": ARM, "bandwidth_rad_s": w, "damping_ratio": ZETA, "positions": (START + offset).tolist()}
    run = arm(law, control_period_s=period).run()
    assert run.outcome == "completed", run.message
    s = w * period
    step = np.array([[1.0 - s**2 / 2.0, 1.0 - ZETA * s], [-(s**2), 1.0 - 2.0 * ZETA * s]])  # of e and dt ed
    error, expected = np.array([1.0, 0.0]), []
    for _ in run.time:
        expected.append(error[0])
        error = step @ error
    system = prepare("capture").system
    told = run.qpos[:, [system.joint(name).qpos.start for name in ARM]] - (START + offset)
    # Coriolis terms and the change of M_c are of the square of the step: 1e-8 rad times w^2 / w^2.
    np.testing.assert_allclose(told, np.outer(expected, -offset), atol=2e-7)
    assert run["controller.hold_error_rad"][0] == pytest.approx(2e-4)
    assert run.summary()["controller"]["phases"][0]["reports"]["largest_error_rad"] == pytest.approx(2e-4, rel=0.1)
    assert all(check.passes for check in all_checks(run))


def test_large_motions_lose_energy():
    """Kinetic energy and that of the constant stiffness fall by what the damping takes, on a tumbling base."""
    there = START + np.array([1.0, -0.8, 0.9, -1.2, 1.1, 0.7, -1.0])
    law = {"joints": ARM, "bandwidth_rad_s": 1.0, "positions": there.tolist()}
    turning = {"initial.rates": {"robot/base": [0.01, 0.0, -0.02, 0.02, -0.03, 0.02]}}
    prepared = arm(law, control_period_s=0.01, duration_s=5.0, **turning)
    run, assembly = prepared.run(), prepared.assemble()
    assert run.outcome == "completed", run.message
    law = assembly.controller.phases[0].controller
    law.start(Observation(0.0, assembly.data))
    error = run.qpos[:, [assembly.system.joint(name).qpos.start for name in ARM]] - there
    rates = run.qvel[:, [assembly.system.joint(name).dofs.start for name in ARM]]
    stored = run["energy.robot_J"] + 0.5 * np.einsum("ti,ij,tj->t", error, law._stiffness, error)
    lost = np.einsum("ti,ij,tj->t", rates, law._damping, rates)
    assert np.linalg.eigvalsh(law._stiffness)[0] > 0.0
    # Efforts are held over 10 ms: an error of half of w dt in what is stored, as of a delay of 5 ms.
    taken = np.concatenate(([0.0], np.cumsum((lost[1:] + lost[:-1]) / 2.0 * np.diff(run.time))))
    np.testing.assert_allclose(stored + taken, stored[0], rtol=0.01)
    assert (np.diff(stored) < 1e-3 * stored[0]).all()
    assert stored[-1] < 0.2 * stored[0]


def test_the_stability_limit_is_the_closed_form():
    for zeta, most in ((0.2, 4.0 * 0.2), (1.0, 1.0), (2.0, 0.5)):

        def law(share, zeta=zeta, most=most):
            return {"joints": ARM, "bandwidth_rad_s": share * most / 0.01, "damping_ratio": zeta}

        with pytest.raises(InputError, match=rf"controller\.bandwidth_rad_s: is unstable .*: stable below {most / 0.01:g}"):
            arm(law(1.001)).assemble()
        s = 0.98 * most
        matrix = np.array([[1.0 - s**2 / 2.0, 1.0 - zeta * s], [-(s**2), 1.0 - 2.0 * zeta * s]])
        assert np.abs(np.linalg.eigvals(matrix)).max() < 1.0
        s = 1.02 * most
        matrix = np.array([[1.0 - s**2 / 2.0, 1.0 - zeta * s], [-(s**2), 1.0 - 2.0 * zeta * s]])
        assert np.abs(np.linalg.eigvals(matrix)).max() > 1.0
        assert not any("unstable" in line for line in arm(law(0.98)).describe())


SLIDER = """<mujoco><option gravity="0 0 0"/><worldbody><body name="base"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="3" diaginertia="4 4 2"/>
  <body name="finger"><joint name="slide" type="slide" axis="0 1 0" limited="true" range="0 0.04"/>
    <inertial pos="0 0 0" mass="1.5" diaginertia="0.4 0.4 0.5"/></body>
  <body name="wheel"><joint name="spin" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="0.4 0.4 0.5"/></body>
  </body></worldbody>
  <actuator><motor name="slide" joint="slide" gear="7"/><motor name="spin" joint="spin"/></actuator></mujoco>"""


def slider(folder, law, **changes):
    initial = {"joints": {"rock/free": [9, 0, 0, 1, 0, 0, 0], "slide": 0.02}}
    phases = [{"name": "all", "until": "end", "controller": {"kind": "hold", **law}}]
    return scene(folder, SLIDER, {"rock": ball("rock")}, **{"initial": initial, "phases": phases, **changes})


def test_a_slide_is_held_against_the_mass_of_its_base(tmp_path):
    """1.5 kg on 4 kg are 12/11 kg: the torque of the first tick says so; slides report in m, hinges in rad."""
    path = slider(tmp_path, {"bandwidth_rad_s": 3.0, "positions": [0.03, 0.0]})
    run = ffsm_mj.run(path)
    assert run["actuators.robot_slide_command_N"][0] == pytest.approx(9.0 * 0.01 * 1.5 * 4.0 / 5.5, rel=1e-12)
    assert run["controller.hold_error_m"][0] == pytest.approx(0.01)
    assert run["controller.hold_error_rad"][0] == 0.0


@pytest.mark.parametrize(
    ("law", "said"),
    [
        ({}, r"controller: write 'bandwidth_rad_s' or 'bandwidth_Hz', one of the two"),
        ({"bandwidth_rad_s": 1.0, "bandwidth_Hz": 1.0}, r"controller: write 'bandwidth_rad_s' or 'bandwidth_Hz', one of"),
        ({"bandwidth_rad_s": -1.0}, r"controller\.bandwidth_rad_s: should be greater than 0, got -1"),
        ({"bandwidth_rad_s": 1.0, "positions": [0.03]}, r"positions: 1 values for 2 joints; .*: robot/slide, robot/spin"),
        ({"bandwidth_rad_s": 1.0, "positions": [0.05, 0.0]}, r"positions\.0: 0\.05 is beyond the range of robot/slide, "),
        ({"bandwidth_Hz": 159.16}, r"controller\.bandwidth_Hz: is unstable at .* 0\.001 s: stable below 159\.2"),
        ({"bandwidth_rad_s": 1.0, "joints": ["free"]}, r"joints\.0: unknown joint of the robot 'free'"),
    ],
)  # fmt: skip
def test_faults(tmp_path, law, said):
    with pytest.raises(InputError, match=said) as refused:
        ffsm_mj.run(slider(tmp_path, law))
    assert len(refused.value.lines) == 1
