"""Control laws of mechanisms: they drive the independent joints, in reduced coordinates."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_controllers.joint_servo import JointServo, ServoConfig
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.notes import notes
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.controller_protocol import ControllerContext
from ffsm_mj.dynamics.loops.closed_loops import ClosedLoops
from ffsm_mj.dynamics.loops.equalities import equalities_of
from ffsm_mj.dynamics.motion import predict
from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.errors import InputError
from ffsm_mj.task_model import JointModel
from tests.controllers.detumbling import POSE, RATES, spacecraft
from tests.mechanisms.models import CHAIN, HEAD, five_bar, four_bar, geared, mechanism
from tests.mechanisms.test_motions import last
from tests.replays import proved
from tests.scenes import scene

TOW = """<mujoco>{head}<worldbody><body name="base"><freejoint name="base"/>
  <inertial pos="0 0 0" mass="20" diaginertia="2 2 2"/>
  <body name="upper" pos=".3 0 0"><joint name="shoulder" axis="0 0 1"/>
  <inertial pos=".2 0 0" mass="2" diaginertia=".03 .03 .03"/>
   <body name="lower" pos=".4 0 0"><joint name="elbow" axis="0 0 1"/>
    <inertial pos=".15 0 0" mass="1" diaginertia=".02 .02 .02"/>
    <site name="tip" pos=".3 0 0"/>
    <body name="disc" pos=".1 0 0"><joint name="disc" axis="0 0 1"/>
     <inertial pos="0 0 0" mass=".5" diaginertia=".01 .01 .01"/>
    </body></body></body></body></worldbody>
 <equality><joint joint1="disc" joint2="elbow" polycoef="0 4 0 0 0"/></equality>
 <actuator><motor name="m1" joint="shoulder"/><motor name="m2" joint="elbow"/>
 <motor name="m3" joint="disc"/></actuator></mujoco>"""
"""An arm with a disc in its forearm that turns four times as fast as the elbow; both have a motor."""


def tow():
    return TOW.format(head=HEAD)


def at_start(folder, mjcf, joints, rates, **scenario):
    assembly = prepare(mechanism(folder, mjcf, joints, rates, **scenario)).assemble()
    return assembly.system, assembly.data


def null_space(system, data, independent):
    """N with qdot = N nu by differences of the closed positions: dependent rates follow from independent ones."""
    J = ClosedLoops(system.mj, data, [each.source for each in equalities_of(system.mj)]).rows().J
    dependent = [dof for dof in range(system.mj.nv) if dof not in independent]
    N = np.zeros((system.mj.nv, len(independent)))
    N[independent, range(len(independent))] = 1.0
    N[dependent] = -np.linalg.pinv(J[:, dependent]) @ J[:, independent]
    return N


@pytest.mark.parametrize("which", ["gears", "linkage", "polynomial"])
def test_the_reduced_model_is_that_of_elimination(tmp_path, which):
    """M_r = N^T M N, c_r = N^T (c + M b), with the base and the driven joint as coordinates; then the base eliminated."""
    mjcf, joints, rates, driven, others = {
        "gears": (geared(), {}, {"A": 1.0}, "A", ["B"]),
        "linkage": (four_bar(), {"crank": math.pi / 3}, {"crank": 2.0}, "crank", ["coupler", "rocker"]),
        "polynomial": (CHAIN, {"j1": 0.5, "j2": -0.4}, {"j1": 1.2, "j2": -0.9}, "j1", ["j3"]),
    }[which]
    system, data = at_start(tmp_path, mjcf, joints, rates | {"robot/base": [0.05, -0.03, 0.02, 0.2, -0.1, 0.15]})
    names = (driven,) if which != "polynomial" else ("j1", "j2")
    model = JointModel(ControllerContext(system, None, 0.01), names)
    model.update(data)
    dependent = {system.joint(name).dofs.start for name in others}
    independent = [dof for dof in range(system.mj.nv) if dof not in dependent]
    N, M = null_space(system, data, independent), mass_matrix(system.mj, data)
    # b by differences of N along the motion: qddot = N nudot + b at nudot = 0
    h, moved = 1e-6, [mujoco.MjData(system.mj) for _ in range(2)]
    for each, sign in zip(moved, (1.0, -1.0), strict=True):
        each.qpos[:], each.qvel[:] = data.qpos, data.qvel
        mujoco.mj_integratePos(system.mj, each.qpos, data.qvel, sign * h)
        mujoco.mj_forward(system.mj, each)
    nu = data.qvel[independent]
    b = (null_space(system, moved[0], independent) - null_space(system, moved[1], independent)) @ nu / (2 * h)
    force = data.qfrc_passive - data.qfrc_bias
    M_r, f_r = N.T @ M @ N, N.T @ (force - M @ b)
    own = [independent.index(dof) for dof in model.joints.dofs]
    reduced = np.linalg.inv(np.linalg.inv(M_r)[np.ix_(own, own)])
    np.testing.assert_allclose(model.M_c, reduced, rtol=1e-11, atol=1e-13)
    coasting = np.linalg.solve(M_r, f_r)
    np.testing.assert_allclose(model.coasting[independent], coasting, rtol=0, atol=1e-7)  # by the differences
    np.testing.assert_allclose(model.mobility[:, independent], np.linalg.inv(M_r)[own], rtol=1e-10, atol=1e-12)


def test_a_joint_that_follows_is_not_driven(tmp_path):
    """Without names the leader alone; with both names it is said which follows."""
    system, _ = at_start(tmp_path, tow(), {}, {})
    model = JointModel(ControllerContext(system, None, 0.01))
    assert model.joints.names == ("robot/shoulder", "robot/elbow")
    pd = {"kind": "pd", "kp": 5.0, "kd": 2.0, "target": [0.2, 0.3]}
    phases = [{"name": "move", "until": "end", "controller": pd}]
    path = mechanism(tmp_path, tow(), {}, {}, phases=phases)
    told = notes(prepare(path).assemble())
    assert any("nothing drives robot/m3" in line for line in told), told
    named = [{"name": "move", "until": "end", "controller": pd | {"joints": ["elbow", "disc"]}}]
    with pytest.raises(InputError, match="robot/disc follows robot/elbow, which is driven too"):
        prepare(mechanism(tmp_path, tow(), {}, {}, phases=named)).assemble()


def test_a_path_of_a_geared_joint_is_followed(tmp_path):
    """Computed torque of the reduced model: the joint is where the path has it, to the order of the hold."""
    law = {"kind": "joint_path", "bandwidth_rad_s": 20.0, "waypoints": [{"at_s": 0.8, "positions": [0.4, 0.5]}]}
    errors = []
    for period in (4e-3, 2e-3):
        run = ffsm_mj.run(
            mechanism(
                tmp_path,
                tow(),
                {},
                {},
                phases=[{"name": "move", "until": "end", "controller": law}],
                control_period_s=period,
                duration_s=0.8,
            )
        )
        proved(run)
        errors.append(np.abs(np.subtract(last(run, "q_robot_shoulder_rad", "q_robot_elbow_rad"), (0.4, 0.5))).max())
    assert errors[1] < 2e-4
    assert last(run, "q_robot_disc_rad")[0] == pytest.approx(4.0 * last(run, "q_robot_elbow_rad")[0], abs=1e-11)


def test_a_state_is_predicted_with_the_rows(tmp_path):
    """By the motion of a run: the row stays closed."""
    system, data = at_start(tmp_path, four_bar(), {"crank": math.pi / 3}, {"crank": 2.0})
    run = ffsm_mj.run(mechanism(tmp_path, four_bar(), {"crank": math.pi / 3}, {"crank": 2.0}, duration_s=0.1))
    predict(system.mj, data, 0.1)
    crank = float(data.qpos[system.joint("crank").qpos][0])
    assert crank == pytest.approx(last(run, "q_robot_crank_rad")[0], abs=1e-6)
    mujoco.mj_kinematics(system.mj, data)
    assert np.abs(data.site("robot/pin").xpos - data.site("robot/end").xpos).max() < 1e-7


REACH = {"tip": "tip", "axes": ["x", "y"], "target_m": [0.05, 0.5]}
CRANKS = {"crank_a": 1.9, "crank_b": 1.2}


def reaching(folder, law, mjcf=None, joints=CRANKS, task=REACH, **scenario):
    """The tip of a five-bar linkage, which two cranks move, goes to a target."""
    phases = [{"name": "reach", "until": "end", "controller": law}]
    return mechanism(folder, mjcf or five_bar(), joints, {}, task=task, phases=phases, **scenario)


GAINS = {"kp_1_s2": 9, "kd_1_s": 6}


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize(
    "law",
    [
        {"kind": "task_ct", "position": GAINS},
        {"kind": "task_tj", "position": {"kp_N_m": 60, "kd_N_s_m": 30}},
        {"kind": "lqr", "Q": [50, 50, 8, 8], "R": [0.1, 0.1]},
        {"kind": "gjm_rate", "position": {"k_1_s": 3}, "servo_gain_1_s": 30},
        {"kind": "impedance", "position": {"stiffness_N_m": 60}},
        {"kind": "osdre", "Q": [50, 50, 8, 8], "R": [0.1, 0.1]},
    ],
    ids=lambda law: law["kind"],
)
def test_laws_move_the_tip_of_a_five_bar_linkage(tmp_path, law):
    """By both cranks: one of them is not between base and tip, and moves it through the loop."""
    run = ffsm_mj.run(reaching(tmp_path, law, duration_s=4.0, control_period_s=0.01))
    assert run.outcome == "completed", run.message
    assert not [check for check in all_checks(run) if not check.passes]
    (error,) = [key for key in run.keys if key.startswith("controller.") and key.endswith("error_m")]
    assert float(run[error][-1]) < 1e-3 * float(run[error][0])


@pytest.mark.parametrize("which", ["five bars", "gears"])
def test_computed_torque_gives_the_error_that_it_asks_for(tmp_path, which):
    """From rest it is e_0 (1 + w t) exp(-w t) with kp = w^2, kd = 2 w, up to the hold of efforts, of order one."""
    given = {
        "five bars": (five_bar(), CRANKS, REACH),
        "gears": (tow(), {"shoulder": 0.4, "elbow": 0.6}, REACH | {"target_m": [0.7, 0.4]}),
    }[which]
    worst = []
    for period in (0.004, 0.002):
        path = reaching(tmp_path, {"kind": "task_ct", "position": GAINS}, *given, duration_s=1.0, control_period_s=period)
        run = ffsm_mj.run(path)
        error = run["controller.task_error_m"]
        expected = error[0] * (1.0 + 3.0 * run.time) * np.exp(-3.0 * run.time)
        worst.append(np.abs(error - expected).max() / error[0])
    assert worst[0] < 0.01
    assert worst[0] / worst[1] == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize("kind", ["hold", "joint_path", "osdre"])
def test_motors_of_one_loop_that_depend_on_each_other_are_refused(tmp_path, kind):
    """With those that can be driven."""
    text = four_bar().replace("</actuator>", '<motor name="rocker" joint="rocker"/></actuator>')
    law = {
        "hold": {"kind": "hold", "bandwidth_rad_s": 5.0},
        "joint_path": {"kind": "joint_path", "bandwidth_rad_s": 5.0, "waypoints": [{"at_s": 0.4, "positions": [1.2, 1.4]}]},
        "osdre": {"kind": "osdre", "Q": [1, 1, 1, 1], "R": [1, 1]},
    }[kind]
    allowed = r"controller\.joints: robot/crank, robot/rocker depend on each other .* drive robot/crank alone, by 'joints'"
    task = REACH | {"tip": "pin"}
    with pytest.raises(InputError, match=allowed):
        prepare(reaching(tmp_path, law, text, {"crank": math.pi / 3}, task)).assemble()


def test_gains_are_those_of_the_mechanism_where_it_is_held(tmp_path):
    """At another angle of the crank the coupler and the rocker are elsewhere, too."""
    system, data = at_start(tmp_path, four_bar(), {"crank": math.pi / 3}, {})
    servo = JointServo(ServoConfig(kind="hold", bandwidth_rad_s=5.0), ControllerContext(system, None, 0.01))
    _, there = at_start(tmp_path, four_bar(), {"crank": 1.6}, {})
    crank = system.joint("crank").dofs.start
    dependent = {system.joint(name).dofs.start for name in ("coupler", "rocker")}
    independent = [dof for dof in range(system.mj.nv) if dof not in dependent]
    N = null_space(system, there, independent)
    M_r = N.T @ mass_matrix(system.mj, there) @ N
    expected = 1.0 / np.linalg.inv(M_r)[independent.index(crank), independent.index(crank)]
    found = servo.reduced_mass(data, np.array([1.6]))
    assert found[0, 0] == pytest.approx(expected, rel=1e-10)
    assert abs(found[0, 0] / servo.reduced_mass(data, np.array([math.pi / 3]))[0, 0] - 1.0) > 0.01


PASSIVE = """<body name="left" pos="0 .3 0"><joint name="left" axis="1 0 0" stiffness="2" damping="2"/>
   <inertial pos="0 .5 0" mass="2" diaginertia=".2 .1 .25"/></body>
  <body name="right" pos="0 -.3 0"><joint name="right" axis="1 0 0"/>
   <inertial pos="0 -.5 0" mass="2" diaginertia=".2 .1 .25"/></body>
  <body name="crank" pos="0 .1 .3"><joint name="crank" axis="0 0 1" damping=".05"/>
   <inertial pos=".075 0 0" mass=".5" diaginertia=".002 .002 .002"/>
   <body name="coupler" pos=".15 0 0"><joint name="coupler" axis="0 0 1" damping=".05"/>
    <inertial pos=".175 0 0" mass=".8" diaginertia=".01 .01 .01"/><site name="pin" pos=".35 0 0"/></body></body>
  <body name="rocker" pos=".4 .1 .3"><joint name="rocker" axis="0 0 1"/>
   <inertial pos=".125 0 0" mass=".6" diaginertia=".004 .004 .004"/><site name="end" pos=".25 0 0"/></body>"""
"""Two panels that a coupling moves alike, on a spring, and a four-bar linkage: nothing drives them."""
TIES = """<equality><joint joint1="right" joint2="left" polycoef="0 -1 0 0 0"/>
  <connect name="bar" site1="pin" site2="end"/></equality>"""


WHEELS = ["wheel_0", "wheel_1", "wheel_2"]
DETUMBLE = {"kind": "detumble", "wheels": WHEELS, "rate_1_s": 0.5, "arm": {"bandwidth_rad_s": 2.0}}
DAMP = {
    "kind": "free_flying",
    "wheels": WHEELS,
    "rotation": {"kp": 0.0, "kd": 2.0},
    "arm": {"joints": ["shoulder"], "kp": 5.0, "kd": 4.0},
}


def tumbling(folder, law):
    """A tumbling spacecraft with an arm, wheels, and mechanisms that nothing drives, for 20 s."""
    robot = (
        spacecraft().replace('<body name="link"', f'{PASSIVE}<body name="link"').replace("</actuator>", f"</actuator>{TIES}")
    )
    initial = {"joints": {"base": POSE, "crank": 1.0, "left": 0.1}, "rates": {"base": RATES, "crank": 0.5}}
    steps = {"duration_s": 20.0, "time_step_s": 5e-3, "control_period_s": 0.02}
    phases = [{"name": "all", "until": "end", "controller": law}]
    return ffsm_mj.angular_momentum(proved(ffsm_mj.run(scene(folder, robot, {}, initial=initial, phases=phases, **steps))))


@pytest.mark.long
def test_wheels_take_the_momentum_of_a_spacecraft_with_mechanisms(tmp_path):
    """At the rate asked for, 0.01 of the rest in each tick of 20 ms, whatever moves in it."""
    told = tumbling(tmp_path, DETUMBLE)
    expected = np.linalg.norm(told["initial_N_m_s"]) * 0.99**1000
    assert told["stack_without_wheels_N_m_s"] == pytest.approx(expected, rel=1e-3)


@pytest.mark.long
def test_damped_rotation_of_a_spacecraft_with_mechanisms(tmp_path):
    """The hub comes to rest, and with it what dampers slow down: after five time constants 1e-2 of the momentum is left."""
    told = tumbling(tmp_path, DAMP)
    assert told["stack_without_wheels_N_m_s"] < 1e-2 * np.linalg.norm(told["initial_N_m_s"])
