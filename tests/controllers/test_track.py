"""The law that follows a site of an object: its error obeys the equation that the gains say, whatever moves."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_controllers.task_space.singularity import damped_inverse
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.controller_protocol import ControllerContext
from ffsm_mj.errors import InputError
from ffsm_mj.report.run_report import run_report
from ffsm_mj.task_model import TaskModel
from ffsm_mj.verification.truncation import ExplainedChecks

W = 0.6
GAINS = {"kp_1_s2": W**2, "kd_1_s": 2.0 * W}
ARM = ["yaw", "shoulder", "upper_roll", "elbow", "fore_roll", "wrist", "hand_roll"]
WHEELS = ["wheel_x", "wheel_y", "wheel_z"]
SPIN = np.array([0.08, -0.06, 0.1])
"""Angular velocity of robot and satellite alike, rad/s in world axes: no relative rate, and a base that turns."""
TURN = np.array([0.9, 0.25, -0.2, 0.3]) / np.linalg.norm([0.9, 0.25, -0.2, 0.3])
"""Attitude of the satellite: nothing of it is along the world's axes."""


def following(**law):
    """A law that follows the satellite's grapple at a distance."""
    return {
        "kind": "track",
        "robot_site": "tip",
        "object_site": "satellite/grapple",
        "joints": ARM,
        "offset_m": [-0.2, 0.05, 0.1],
        "position": GAINS,
        "attitude": GAINS,
        **law,
    }


def in_body_axes(vector):
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, TURN)
    return matrix.reshape(3, 3).T @ vector


def scene(law, **changes):
    """Robot and satellite turn alike, the satellite drifts; ideal motors, one phase."""
    return {
        "duration_s": 3.0,
        "time_step_s": 0.005,
        "control_period_s": 0.005,
        "actuators": {},
        "grasps": {},
        "contacts.rules": [],
        "initial.joints.satellite/free": [2.4, -0.1, 0.5, *TURN],
        "initial.rates.robot/base": [0.01, 0.02, -0.01, *SPIN],
        "initial.rates.satellite/free": [-0.02, 0.01, 0.015, *in_body_axes(SPIN)],
        "phases": [{"name": "all", "until": "end", "controller": law}],
        **changes,
    }


def told(run, name):
    return run[f"controller.track_{name}"]


def deviations(run):
    """Largest deviation of distance in m and of angle in rad from e'' = -kd e' - kp e.

    Robot and satellite turn alike at first, so that the angle falls from rest, about one axis of the satellite.
    """
    t, decay = run.time, np.exp(-W * run.time)
    angle = told(run, "angle_rad")
    offset, velocity = start(run)
    distance = np.linalg.norm((offset + np.outer(t, velocity + W * offset)) * decay[:, None], axis=1)
    return np.abs(told(run, "error_m") - distance).max(), np.abs(angle - angle[0] * (1.0 + W * t) * decay).max()


def start(run):
    """How far the robot's site is from where it is to be at the start, and how that changes, world axes, (3,) each.

    Nothing of the law is used: the sites are moved by the state's own rates for a moment.
    """
    system = prepare("capture").system
    data = mujoco.MjData(system.mj)

    def at(time_s):
        data.qpos[:] = run.qpos[0]
        mujoco.mj_integratePos(system.mj, data.qpos, run.qvel[0], time_s)
        mujoco.mj_kinematics(system.mj, data)
        tip, site = system.index("site", "tip"), system.index("site", "satellite/grapple")
        return data.site_xpos[tip] - data.site_xpos[site] - data.site_xmat[site].reshape(3, 3) @ [-0.2, 0.05, 0.1]

    return at(0.0), (at(1e-5) - at(-1e-5)) / 2e-5


@pytest.fixture(scope="module")
def recipes():
    """The scene with the base afloat, and held by its wheels."""
    base = {"wheels": WHEELS, "rotation": {"kp_N_m_rad": 8.0, "kd_N_m_s_rad": 30.0}}
    laws = {"afloat": following(joint_damping_N_m_s_rad=2.0), "held": following(base=base)}
    return {name: prepare("capture", scene(law)) for name, law in laws.items()}


# Torques are held for 5 ms, an error of first order: measured 7.3e-4 m and 3.7e-4 rad, half of it at half the period.
NEAR_M, NEAR_RAD = 1e-3, 6e-4


@pytest.mark.parametrize("base", ["afloat", "held"])
def test_the_error_falls_as_the_gains_say(recipes, base):
    run = recipes[base].run()
    assert run.outcome == "completed", run.message
    off_m, off_rad = deviations(run)
    assert off_m < NEAR_M
    assert off_rad < NEAR_RAD
    assert told(run, "speed_m_s")[0] > 0.02
    assert told(run, "error_m")[0] > 0.2
    assert told(run, "angle_rad")[0] > 0.5
    assert all(check.passes for check in all_checks(run))


def test_torques_keep_their_bound():
    """As one vector: the feedback is scaled, and the site goes on towards the object."""
    law = following(max_torque_N_m=2.0, joint_damping_N_m_s_rad=2.0)
    run = ffsm_mj.run("capture", scene(law))
    torques = np.stack([run[f"actuators.robot_{name}_command_N_m"] for name in ARM])
    assert np.abs(torques).max() == pytest.approx(2.0, abs=1e-12)
    share = told(run, "share")
    assert 0.0 < share.min() < 0.5
    assert share[-1] == 1.0
    assert run.summary()["controller"]["phases"][0]["reports"]["least_share"] == share.min()
    assert told(run, "error_m")[-1] < 0.8 * told(run, "error_m")[0]


def test_speeds_that_are_asked_for_are_bounded():
    """Far away the site comes at that speed, whatever it had: (v_0 - v) exp(-kd t) is 2e-4 m/s after 3 s."""
    fast = {"kp_1_s2": 1.44, "kd_1_s": 2.4}
    law = following(position={**fast, "max_speed_m_s": 0.04}, attitude={**fast, "max_rate_rad_s": 0.05})
    run = ffsm_mj.run("capture", scene(law, duration_s=3.2))
    late = run.time > 3.0
    assert told(run, "speed_m_s")[late] == pytest.approx(0.04, abs=5e-4)
    assert told(run, "rate_rad_s")[late] == pytest.approx(0.05, abs=5e-4)


def test_a_stretched_arm_is_damped():
    """Where the arm is straight it cannot move the tip along itself: torques stay small instead of growing without bound."""
    straight = {f"initial.joints.{name}": 0.0 for name in ARM}
    run = ffsm_mj.run("capture", scene(following(), duration_s=2.0, **straight))
    assert run.outcome == "completed", run.message
    assert told(run, "mass_kg")[0] > 1e6
    torques = np.stack([run[f"actuators.robot_{name}_command_N_m"] for name in ARM])
    assert np.abs(torques).max() < 50.0


def test_the_effective_inertia_is_damped_smoothly(rng):
    directions = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    values = np.array([1e-2, 0.1, 0.3, 1.0, 2.0, 5.0])
    mobility = directions @ np.diag(values) @ directions.T
    inertia, mobilities = damped_inverse(mobility, 101.0)
    np.testing.assert_allclose(inertia @ mobility, np.eye(6), atol=1e-12)
    np.testing.assert_allclose(mobilities, values, rtol=1e-12)
    damped, _ = damped_inverse(mobility, 50.0)  # the first direction is at half the bound on mobility
    shares = np.diag(directions.T @ damped @ mobility @ directions)
    np.testing.assert_allclose(shares, [0.75, 1.0, 1.0, 1.0, 1.0, 1.0], atol=1e-12)
    at, step = 0.02, 1e-7
    around = [damped_inverse(np.diag([at + side, 1.0]), 1.0 / at)[0][0, 0] for side in (-step, step)]
    assert (around[1] - around[0]) / (2.0 * step) == pytest.approx(-1.0 / at**2, rel=1e-4)
    nothing, none = damped_inverse(np.zeros((2, 2)), 100.0)
    np.testing.assert_array_equal(nothing, 200.0 * np.eye(2))
    assert not none.any()


def test_a_planar_arm_follows_in_its_plane():
    """What it cannot move is left alone: no axes need to be named."""
    law = {
        "kind": "track",
        "object_site": "object/grapple",
        "offset_m": [0.9, 0.6, 0.0],
        "position": GAINS,
        "attitude": GAINS,
    }
    changes = {"actuators": {}, "grasps": {}, "duration_s": 2.5, "initial.rates.object/yaw": 0.05}
    changes |= {"time_step_s": 0.005, "control_period_s": 0.005}
    run = ffsm_mj.run("capture-planar", changes | {"phases": [{"name": "all", "until": "end", "controller": law}]})
    assert run.outcome == "completed", run.message
    t = run.time
    angle = told(run, "angle_rad")
    exact = (angle[0] + t * (W * angle[0] + np.sign(angle[1] - angle[0]) * told(run, "rate_rad_s")[0])) * np.exp(-W * t)
    np.testing.assert_allclose(angle, np.abs(exact), atol=2e-3)
    assert told(run, "error_m")[-1] < 0.6 * told(run, "error_m")[0]
    # Out of the plane its effective inertia is infinite, which is no singularity.
    assert np.isinf(told(run, "mass_kg")).all()
    assert run.summary()["controller"]["phases"][0]["reports"]["near_singularity_s"] == 0.0


def test_a_stretched_arm_is_near_a_singularity_and_says_so():
    """The target is out of reach: the arm stretches towards it, and along the arm its inertia grows beyond the bound."""
    law = {"kind": "track", "object_site": "object/grapple", "offset_m": [9.0, 0.0, 0.0], "singular_mass_kg": 40.0}
    law |= {"position": GAINS | {"max_speed_m_s": 0.5}, "joint_damping_N_m_s_rad": 5.0}
    changes = {"actuators": {}, "grasps": {}, "duration_s": 6.0, "time_step_s": 0.01, "control_period_s": 0.01}
    run = ffsm_mj.run("capture-planar", changes | {"phases": [{"name": "all", "until": "end", "controller": law}]})
    assert run.outcome == "completed", run.message
    (phase,) = run.summary()["controller"]["phases"]
    system = prepare("capture-planar").system
    task = TaskModel(ControllerContext(system, None, 0.01), site="tip", axes=(0, 1))
    data = mujoco.MjData(system.mj)
    inertia = []
    for qpos, qvel in zip(run.qpos[:-1], run.qvel[:-1], strict=True):
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_forward(system.mj, data)
        task.update(data)
        inertia.append(1.0 / np.linalg.eigvalsh(task.B @ task.alpha.T)[0])
    near = np.array(inertia) > 40.0
    assert 0.1 < near.mean() < 0.9
    assert phase["reports"]["near_singularity_s"] == pytest.approx(0.01 * near.sum())
    note = phase["reports"]["note"]
    assert f"near a singularity for {0.01 * near.sum():.4g} s, first at t = {run.time[near.argmax()]:.6g} s" in note
    assert f"effective inertia up to {np.max(inertia):.3g} (" in note
    assert f"phase 'all' (track): {note}" in run_report(run, ExplainedChecks(all_checks(run)))


def test_what_holds_the_object_follows_nothing():
    """A phase that goes on after the capture: the joints are only damped, and come to rest."""
    law = following(offset_m=[0.0, 0.0, 0.0], joint_damping_N_m_s_rad=20.0)
    near = {"within": {"position_m": 1.0, "angle_rad": 2.0}}
    grasps = {"grasp": {"robot_site": "tip", "object_site": "satellite/grapple", "when": near}}
    phases = [{"name": "all", "until": "end", "arm": ["grasp"], "controller": law}]
    changes = {"grasps": grasps, "phases": phases, "initial.rates.elbow": 0.1, "duration_s": 3.0}
    run = ffsm_mj.run("capture", scene(law, **changes))
    assert run.outcome == "completed", run.message
    assert run.grasps[0].time_s == 0.0
    rates = run.qvel[:, 9:16]
    assert np.abs(rates[0]).max() > 0.01
    assert np.abs(rates[-1]).max() < 0.2 * np.abs(rates[0]).max()
    assert np.isnan(told(run, "error_m")[-1])
    assert all(check.passes for check in all_checks(run))


@pytest.mark.parametrize(
    ("change", "note"),
    [
        ({"position": GAINS, "joint_damping_N_m_s_rad": 2000.0}, "joint_damping_N_m_s_rad is unstable"),
        ({"position": GAINS | {"kd_1_s": 500.0}}, "position.kd_1_s = 500 there is stable up to"),
        ({"attitude": GAINS | {"kd_1_s": 410.0}}, "attitude.kd_1_s = 410 there is stable up to"),
        ({"attitude": GAINS | {"kd_1_s": 390.0}}, ""),
    ],
)
def test_damping_that_the_period_is_too_long_for_is_told(change, note):
    """A rate that is taken to 1 - dt kd of itself: dt is 5 ms here, so that kd is stable up to 400 per second."""
    notes = [line for line in prepare("capture", scene(following(**change))).describe() if "unstable" in line]
    assert len(notes) == bool(note)
    assert all(note in line for line in notes)
    if "kd_1_s" in note:  # 400 up to rounding, then rounded down to three digits
        assert notes[0].rpartition(" ")[2] in ("399", "400")


@pytest.mark.parametrize(
    ("change", "place", "what"),
    [
        ({"object_site": "handle"}, "object_site", "unknown site 'handle'"),
        ({"object_site": "tip"}, "object_site", "robot/tip is a site of the robot; write one of satellite/grapple"),
        ({"robot_site": "grapple"}, "robot_site", "satellite/grapple is no site of the robot; write one of robot/front_1"),
        ({"robot_site": None}, "kind", "track needs 'robot_site', or a 'task' whose tip it takes"),
        ({"joints": ["yaw", "elbo"]}, "joints.1", "unknown joint of the robot 'elbo'"),
        ({"max_torque_N_m": [1.0, 2.0]}, "max_torque_N_m", "2 values for 7 joints; write one, or one each"),
        ({"max_torque_N_m": -1.0}, "max_torque_N_m", "greater than 0"),
        ({"position": {"kp": 1.0, "kd_1_s": 1.0}}, "position.kp", "unknown key"),
        ({"position": {"kp_1_s2": 1.0, "kd_1_s": 0.0}}, "position.kd_1_s", "greater than 0"),
        ({"base": {"wheels": ["wheel_w"]}}, "base.wheels.0", "unknown actuator 'wheel_w'"),
        ({"base": {"rotation": {"kp_N_m_rad": 1, "kd_N_m_s_rad": 1}}}, "base.rotation", "needs 'wheels' or 'thrusters'"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(change, place, what):
    law = {key: value for key, value in (following() | change).items() if value is not None}
    with pytest.raises(InputError) as error:
        prepare("capture", scene(law))
    line = error.value.lines[0]
    assert f"phases.0.controller.{place}: " in line
    assert what in line


def test_rates_of_joints_stay_within_their_bound():
    """From rest towards a satellite at rest: without a bound joints turn faster than 0.08 rad/s, with it none does.

    The law bounds the rates that it asks for. The joints follow these from below, with the time constant 1/kd, and exceed
    them by what the arm turns on its way, here less than a twentieth.
    """
    rest = {f"initial.rates.{name}": [0.0] * 6 for name in ("robot/base", "satellite/free")}
    fast, slow = (
        prepare("capture", scene(following(offset_m=[-0.6, 0.3, 0.1], **bound), duration_s=3.0, **rest)).run()
        for bound in ({}, {"max_joint_rate": 0.08})
    )
    dofs = [prepare("capture").system.joint(name).dofs.start for name in ARM]
    assert np.abs(fast.qvel[:, dofs]).max() > 0.12
    assert np.abs(slow.qvel[:, dofs]).max() < 0.08 * 1.05
    assert np.abs(slow.qvel[:, dofs]).max() > 0.08 * 0.8
    assert told(slow, "error_m")[-1] < told(slow, "error_m")[0]  # it goes on
    assert slow.summary()["controller"]["phases"][0]["reports"]["least_rate_share"] < 0.7


def test_a_bound_on_rates_that_none_reaches_changes_nothing(recipes):
    bounded = prepare("capture", scene(following(joint_damping_N_m_s_rad=2.0, max_joint_rate=50.0))).run()
    np.testing.assert_array_equal(bounded.qpos, recipes["afloat"].run().qpos)


def test_a_target_out_of_reach_is_told():
    """By check where it is so at the start, and by the run, with times: the satellite drifts out of reach after a second.

    The ticks are counted again in the log: states at which the grapple is farther from the first joint than the lengths of
    the links between the joints' anchors add up to.
    """
    law = following(offset_m=[0.0, 0.0, 0.0], position=GAINS | {"max_speed_m_s": 1e-3})
    law.pop("attitude")
    start = scene(law, duration_s=2.0)
    system = prepare("capture", start).system
    data = mujoco.MjData(system.mj)
    mujoco.mj_kinematics(system.mj, data)
    joints = [system.mj.joint(f"robot/{name}").id for name in ARM]
    tip, grapple = system.index("site", "tip"), system.index("site", "satellite/grapple")
    radius = np.linalg.norm(np.diff([*data.xanchor[joints], data.site_xpos[tip]], axis=0), axis=1).sum()
    centre = data.xanchor[joints[0]].copy()
    rest = {"initial.rates.robot/base": [0.0] * 6, "initial.rates.satellite/free": [0.5, 0, 0, 0, 0, 0]}
    x = centre[0] + radius - 0.5 + 0.47  # the grapple is 0.47 m before the frame
    there = [x, centre[1], centre[2], 1.0, 0.0, 0.0, 0.0]
    run = prepare("capture", start | rest | {"initial.joints.satellite/free": there}).run()
    beyond = []
    for state in run.qpos[:-1]:  # one at each tick, and one at the end
        data.qpos[:] = state
        mujoco.mj_kinematics(system.mj, data)
        beyond.append(np.linalg.norm(data.site_xpos[grapple] - data.xanchor[joints[0]]) > radius)
    report = run.summary()["controller"]["phases"][0]["reports"]
    assert 150 < sum(beyond) < 250
    assert report["out_of_reach_s"] == pytest.approx(0.005 * sum(beyond), rel=1e-12)
    assert "out of reach for" in report["note"]
    assert f"from joint robot/yaw, where the arm reaches {radius:.4g} m" in report["note"]
    far = prepare("capture", start | rest | {"initial.joints.satellite/free": [9.0, *there[1:]]})
    assert [line for line in far.describe() if "the target of all is" in line and "beyond the arm's reach" in line]
