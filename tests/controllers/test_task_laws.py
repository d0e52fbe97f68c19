"""Laws on the task's output against their closed forms, in the plane and in space."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import scipy.linalg

import ffsm_mj
from ffsm_controllers import kinds
from ffsm_mj import Simulator
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.controller_protocol import Command, ControllerContext, Observation, ScenarioFaults, Task
from tests.controllers.task_laws import (
    PD,
    SPATIAL,
    W,
    critically_damped,
    planar,
    planar_run,
    reports,
    spatial,
    spatial_run,
    tip,
)

COMPUTED = {"kind": "task_ct", "position": PD}


def test_computed_torque_follows_the_closed_form():
    """T4: the held torque is late by half a period, an error of first order; without it the known digits at 2 s."""
    runs = [planar_run(COMPUTED, period_s, 2.0) for period_s in (0.008, 0.004)]
    errors = [np.abs(run.tip_error() - critically_damped(run)).max() for run in runs]
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.01)
    coarse, fine = (run.tip_error()[-1] for run in runs)
    assert 2.0 * fine - coarse == pytest.approx(3.836438, abs=3e-6)  # what is left is of second order, some 1e-6
    assert fine == pytest.approx(3.836438 - 4.0 * (3.836438 - 3.836129), abs=3e-6)  # 3.836129 at 1 ms


def test_the_transposed_jacobian_loses_the_energy_that_its_damper_takes():
    """T6: -7.18e-3 J of 22.5 J unaccounted for at 2 ms, of first order in the period; at 10 ms five times that."""
    left = []
    for period_s in (0.02, 0.01):
        run = planar_run({"kind": "task_tj", "position": {"kp_N_m": 2.0, "kd_N_s_m": 8.0}}, period_s, 10.0)
        stored = run["energy.robot_J"] + run.tip_error() ** 2
        power = 8.0 * np.linalg.norm(run.tip_velocity[:, :2], axis=1) ** 2
        assert np.diff(stored).max() < 1e-6
        assert stored[0] == pytest.approx(22.5, abs=1e-7)  # the start is stated to nine digits
        left.append(stored[0] - stored[-1] - period_s * np.sum((power[1:] + power[:-1]) / 2.0))
    assert left[1] == pytest.approx(5.0 * -7.18e-3, rel=0.02)
    assert left[0] / left[1] == pytest.approx(2.0, rel=0.02)


def test_resolved_motion_rate_goes_along_a_line():
    """T1: at 0.2 m/s towards the target; off the line and behind by 1/k_v: 1.9e-3 m off at 50 1/s."""
    off = []
    for servo in (25.0, 100.0):
        law = {"kind": "gjm_rate", "position": {"k_1_s": 0.5, "max_speed_m_s": 0.2}, "servo_gain_1_s": servo}
        run = planar_run(law, 0.008, 8.0)
        path, way = tip(run)[:, :2] - tip(run)[0, :2], np.array([3.0, 0.0]) - tip(run)[0, :2]
        way /= np.linalg.norm(way)
        off.append(np.abs(way[0] * path[:, 1] - way[1] * path[:, 0]).max())
        distance = run.tip_error()
        assert 0.0 < distance[-1] - (distance[0] - 1.6) < 0.2 / servo
    assert off[0] == pytest.approx(2.0 * 1.9e-3, rel=0.1)
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.1)


def test_without_its_momentum_resolved_motion_rate_stays_behind():
    """T1: the rates v_h that the momentum gives the tip are compensated; without them the error stays at |v_h|/k."""
    law = {"kind": "gjm_rate", "position": {"k_1_s": 0.5}, "servo_gain_1_s": 25.0}
    drifting = {"initial.rates": {"base_x": 0.03, "base_y": -0.02}, "task.target_m": [8.0, 1.5]}
    run = planar_run(law, 0.01, 10.0, **drifting)
    # v_h of a robot that drifts as a whole is its velocity, 0.0361 m/s: 0.072 m without it.
    # The servo's lag leaves some of the accelerations that follow the drift.
    assert run.tip_error()[-1] < 0.01


def law_at_start(kind, **gains):
    """A law of the case study, and data at its start."""
    simulator = Simulator("baseline", {"duration_s": 0.001}, record=False)
    data = simulator.reset().data
    system, law = simulator.system, kinds().classes[kind]
    context = ControllerContext(system, Task(system.index("site", "tip"), (0, 1), np.array([3.0, 0.0])), 1e-3)
    return law(law.Config(kind=kind, **gains), context), data


def effort(law, data):
    """Efforts of the three joints at a state."""
    command = Command.off(len(data.ctrl))
    law.start(Observation(0.0, data))
    law.control(Observation(0.0, data), command)
    return command.effort[-3:] if not command.effort[:-3].any() else command.effort


@pytest.mark.parametrize("refresh", [False, True])
def test_the_regulator_has_the_gains_of_the_riccati_equation(refresh):
    """T5: S at the start, and Kp, Kd in closed form and from SciPy."""
    gains = {"Q": (1.0, 1.0, 0.5, 0.5), "R": (1.0, 1.0, 1.0), "refresh": refresh}
    law, data = law_at_start("lqr", **gains)
    data.qvel[:6] = [0.01, -0.02, 0.03, 0.04, -0.05, 0.06]
    mujoco.mj_forward(law.model._model, data)
    u, B = effort(law, data), law.model.B
    np.testing.assert_allclose(B @ B.T, [[0.0159055424, 0.0062709442], [0.0062709442, 0.1027979971]], rtol=0, atol=6e-11)
    Kp = np.array([[0.1253296830, 0.0140717081], [0.0140717081, 0.3203123227]])
    Kd = np.array([[0.5080028589, 0.0233502142], [0.0233502142, 0.8315518093]])
    np.testing.assert_allclose(B @ u, -Kp @ law.model.e - Kd @ law.model.yd, rtol=0, atol=1e-9)
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [np.zeros((2, 4))]])
    whole = np.vstack((np.zeros((2, 3)), B))
    K = scipy.linalg.solve_continuous_are(A, whole, np.diag(gains["Q"]), np.eye(3))
    np.testing.assert_allclose(u, -whole.T @ K @ np.concatenate((law.model.e, law.model.yd)), rtol=0, atol=1e-12)


def test_only_a_refreshed_regulator_has_the_gains_of_the_present_state():
    """At another state the frozen one keeps its gains."""
    efforts = []
    for refresh in (False, True):
        law, data = law_at_start("lqr", Q=(1.0, 1.0, 0.5, 0.5), R=(1.0, 1.0, 1.0), refresh=refresh)
        effort(law, data)
        data.qpos[5] += 1.0
        mujoco.mj_forward(law.model._model, data)
        command = Command.off(len(data.ctrl))
        law.control(Observation(0.1, data), command)
        S = law.model.B @ law.model.B.T
        s, V = np.linalg.eigh(S)
        efforts.append(np.abs(law.model.B @ command.effort[-3:] + (V * np.sqrt(s)) @ V.T @ law.model.e).max())
    assert efforts[0] > 0.1
    assert efforts[1] < 1e-12


def modal(run, model_at, stiffness, ratio):
    """Errors over time of Lambda e'' + D e' + K e = 0 with the Lambda of the end, from rest."""
    inertia = np.linalg.inv(model_at.B @ model_at.alpha.T)
    squares, modes = scipy.linalg.eigh(stiffness * np.eye(len(inertia)), inertia)  # modes^T inertia modes = 1
    start = modes.T @ inertia @ (tip(run)[0, : len(inertia)] - model_at.target_m)
    rate = np.sqrt(squares) * np.sqrt(1.0 - ratio**2)
    t = run.time[:, None]
    decay = np.exp(-ratio * np.sqrt(squares) * t)
    return (start * decay * (np.cos(rate * t) + ratio * np.sqrt(squares) / rate * np.sin(rate * t))) @ modes.T


def test_every_mode_of_an_impedance_has_its_damping_ratio():
    """From 2 cm the inertia stays what it is to 1 %, and so the motion is that of two oscillators."""
    ratio, stiffness = 0.3, 5.0
    law, data = law_at_start("impedance", position={"stiffness_N_m": stiffness}, damping_ratio=ratio)
    effort(law, data)
    target = (law.model.y + np.array([0.015, -0.01])).tolist()
    law.model.target_m = np.array(target)
    run = planar_run(
        {"kind": "impedance", "position": {"stiffness_N_m": stiffness}, "damping_ratio": ratio},
        0.004,
        4.0,
        **{"task.target_m": target},
    )
    error = tip(run)[:, :2] - target
    assert np.abs(error).max() < 0.02
    assert np.abs(error - modal(run, law.model, stiffness, ratio)).max() < 2.5e-4
    assert np.abs(error - modal(run, law.model, stiffness, 2.0 * ratio)).max() > 2e-3


def test_the_wrench_of_an_impedance_is_bounded_as_a_whole():
    """It keeps its direction: the acceleration of the tip is Lambda^-1 times a force towards the target."""
    law, data = law_at_start("impedance", position={"stiffness_N_m": 5.0, "max_force_N": 0.3})
    u = effort(law, data)
    force = np.linalg.solve(law.model.B @ law.model.alpha.T, law.model.drift + law.model.B @ u)
    np.testing.assert_allclose(force, -0.3 * law.model.e / np.linalg.norm(law.model.e), rtol=0, atol=1e-12)
    assert law.telemetry()[-1] == pytest.approx(0.3)


def test_an_impedance_stays_with_a_site_that_moves():
    """The target drifts and turns: in the end there is no lag. Without its rates it would be 2 sqrt(m/k) v, some 0.03 m."""
    law = {
        "kind": "impedance",
        "object_site": "satellite/grapple",
        "offset_m": [-0.9, 0.1, 0.2],
        "position": {"stiffness_N_m": 40.0},
        "attitude": {"stiffness_N_m_rad": 20.0},
        "joint_damping_N_m_s_rad": 2.0,
    }
    satellite = [2.6, 0.2, 0.5, 0.99, 0.05, -0.05, 0.12]
    changes = {"grasps": {}, "initial.joints.satellite/free": satellite}
    changes |= {"task": {"tip": "tip", "target_m": [0.0, 0.0, 0.0]}}
    changes |= {"initial.rates": {"satellite/free": [-0.005, 0.005, 0.01, 0.005, 0.01, -0.01]}}
    given = {key: value for key, value in spatial(law, 0.02, 20.0).items() if key != "task.target_m"}
    run = ffsm_mj.run("capture", given | changes)
    assert run["controller.task_error_m"][0] > 0.1
    assert run["controller.task_error_m"][-1] < 2e-3
    assert run["controller.task_error_rad"][-1] < 2e-3
    assert reports(run)["least_task_share"] == 1.0


def test_an_impedance_carries_the_tip_along_with_a_site_that_tumbles():
    """With next to no spring the tip has the acceleration of the site, by finite differences of the satellite alone."""
    system = prepare("capture").system
    context = ControllerContext(system, Task(system.index("site", "tip"), (0, 1, 2), np.zeros(3)), 1e-3)
    position = {"stiffness_N_m": 1.0, "max_force_N": 1e-9}
    config = {"object_site": "satellite/grapple", "offset_m": (-0.5, 0.2, 0.1), "position": position}
    law = kinds().classes["impedance"]
    law = law(law.Config(kind="impedance", **config), context)
    data, rng = mujoco.MjData(system.mj), np.random.default_rng(4)
    mujoco.mj_integratePos(system.mj, data.qpos, rng.normal(size=system.mj.nv), 1.0)
    data.qvel[:] = rng.normal(size=system.mj.nv)
    places = []
    for step_s in (-1e-3, 0.0, 1e-3):
        near = mujoco.MjData(system.mj)
        near.qpos[:], near.qvel[:] = data.qpos, np.sign(step_s or 1.0) * data.qvel
        if step_s:
            system.mj.opt.timestep = abs(step_s)
            mujoco.mj_step(system.mj, near)
        mujoco.mj_forward(system.mj, near)
        site = near.site("satellite/grapple")
        places.append(site.xpos + site.xmat.reshape(3, 3) @ config["offset_m"])
    mujoco.mj_forward(system.mj, data)
    command = Command.off(system.mj.nu)
    law.start(Observation(0.0, data))
    law.control(Observation(0.0, data), command)
    expected = (places[0] - 2.0 * places[1] + places[2]) / 1e-6
    assert np.abs(expected).max() > 0.5
    found = law.model.drift + law.model.B @ command.effort[law.model.joints.actuators]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5)


@pytest.mark.long
@pytest.mark.parametrize("kind", SPATIAL)
def test_in_space_with_attitude(kind):
    """Seven joints bring the tip to its target; the frame, held as it is at the start, comes back to it."""
    law = {"kind": kind, **SPATIAL[kind]}
    run = spatial_run(law, 0.02, 16.0, (-0.2, 0.1, 0.1))
    assert run.outcome == "completed"
    assert run.tip_error()[-1] < 0.03 * run.tip_error()[0]
    if "attitude" in law:
        assert run["controller.task_error_rad"][0] == 0.0
        assert run["controller.task_error_rad"][-1] < 2e-3


def test_computed_torque_turns_the_tip_as_its_gains_say():
    """The angle from a stated attitude falls as the closed form does, beside the distance."""
    law = {"kind": "task_ct", "position": PD, "attitude": {**PD, "target": [1.0, 0.0, 0.0, 0.0]}}
    errors = []
    for period_s in (0.02, 0.01):
        run = spatial_run(law, period_s, 3.0)
        angle, t = run["controller.task_error_rad"], run.time
        closed = angle[0] * (1.0 + W * t) * np.exp(-W * t)
        errors.append((np.abs(angle - closed).max(), np.abs(run.tip_error() - critically_damped(run)).max()))
        assert angle[0] > 0.5
    np.testing.assert_allclose(np.divide(*errors), 2.0, rtol=0.02)


def test_efforts_of_other_parts_are_accounted_for():
    """A wheel on the base is turned hard; the tip follows its closed form as without."""
    parts = {"arm": COMPUTED, "base": {"kind": "base_pd", "wheels": ["wheel"], "rotation": {"kp": 40.0, "kd": 20.0}}}
    changes = planar(COMPUTED, 0.004, 1.0)
    changes["phases"] = [{"name": "all", "until": "end", "controllers": parts}]
    run = ffsm_mj.run("baseline", changes)
    assert np.abs(run["actuators.robot_wheel_applied_N_m"]).max() > 0.5
    assert np.abs(run.tip_error() - critically_damped(run)).max() < 1e-3
    assert "controller.arm_task_error_m" in run.keys


def test_what_cannot_be_is_refused():
    """With its place in the section of the law."""
    for kind, gains, path, what in (
        ("task_ct", {"position": PD, "joints": ("joint_1",)}, ("joints",), "control 1 of the 2 components"),
        ("task_ct", {"position": PD, "joints": ("joint_9",)}, ("joints", 0), "joint_9"),
        ("rns", {"position": PD, "joints": ("joint_1", "joint_2"), "attitude": PD}, ("joints",), "control 2 of the 3"),
        ("lqr", {"Q": (1.0,) * 10, "R": (1.0,) * 3, "attitude": {}}, ("attitude",), "3 of the 5 components"),
        ("impedance", {"position": {"stiffness_N_m": 1.0}, "object_site": "tip"}, ("object_site",), "site of the robot"),
    ):
        with pytest.raises(ScenarioFaults) as faults:
            law_at_start(kind, **gains)
        (fault,) = faults.value.faults
        assert fault.path == path
        assert what in fault.message
