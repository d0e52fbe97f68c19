"""Flexible joints that a scenario gives to a robot's file: closed form of the drive, rigid control laws, refusals."""

from __future__ import annotations

import json
import math
from typing import ClassVar

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import InputError
from tests.contact_models.grasp.scenes import grasping
from tests.laws import Law
from tests.replays import proved
from tests.scenes import HEAD, scene

BASE, LINK, ROTOR, GEAR, K = 0.7, 0.3, 2e-5, 80.0, 40.0
REFLECTED = GEAR**2 * ROTOR
W = math.sqrt(K * (1.0 / BASE + 1.0 / LINK + 1.0 / REFLECTED))
"""Rotor, link and base turn about one axis: three inertias, one spring."""

# The defaults of the file, its armature and its keyframe are not those of the drive.
ARM = f"""<mujoco>{HEAD}<default><joint damping="0.5" armature="0.9"/></default><worldbody><body name="base">
  <joint name="x" type="slide" axis="1 0 0" damping="0" armature="0"/>
  <joint name="yaw" axis="0 0 1" damping="0" armature="0"/>
  <inertial pos="0 0 0" mass="4" diaginertia="{BASE} {BASE} {BASE}"/><geom size="0.1" mass="0"/>
  <frame euler="0 0 30"><body name="link" pos="0 0 0.2"><joint name="drive" axis="0 0 1" pos="0 0 0.1" damping="0"/>
  <inertial pos="0 0 0" mass="1" diaginertia="{LINK} {LINK} {LINK}"/><geom size="0.1" mass="0"/>
  <site name="tip" pos="0.3 0 0"/>
  </body></frame></body></worldbody>
  <actuator><motor name="motor" joint="drive"/></actuator>
  <keyframe><key qpos="0 0 0.1"/></keyframe></mujoco>"""
FLEX = {"drive": {"stiffness": K, "damping": 0.0, "gear": GEAR, "rotor_inertia": ROTOR}}


class Push(Law):
    """A constant effort; it remembers what it sees."""

    seen: ClassVar[list] = []

    def __init__(self, config, context):
        self.system = context.system

    def start(self, observation):
        Push.seen.append((tuple(self.system.joints), observation.data.qpos.copy()))

    def control(self, observation, command):
        command.effort[0], command.powered[0] = 0.6, True

    def telemetry(self):
        return np.empty(0)


def pushed(folder, flex=None, robot=ARM, **changes):
    path = scene(folder, robot, {}, duration_s=0.3)
    phases = [{"name": "push", "until": "end", "controller": {"kind": "push"}}]
    given = {"robot": {"mjcf": "robot.xml", "joint_flex": FLEX if flex is None else flex}, "phases": phases}
    path.write_text(json.dumps(json.loads(path.read_text()) | given | changes))
    Push.seen.clear()
    return ffsm_mj.run(path, controllers={"push": Push})


def test_a_step_of_torque_on_the_rotor(tmp_path):
    """The spring gives way by -(u / (B w^2)) (1 - cos w t); the rotor has the rest, and base and link keep a spin of 0."""
    run = proved(pushed(tmp_path))
    since = run.time
    deflection = -0.6 / (REFLECTED * W * W) * (1.0 - np.cos(W * since))
    error = np.abs(run["state.q_robot_drive_flex_rad"] - deflection).max()
    # RK4's phase error h^4 w^5 t / 120 of the amplitude.
    assert error < 1.05 * np.abs(deflection).max() * (1e-3 * W) ** 4 / 120.0 * W * 0.3
    # The rotor alone: B theta'' = u + K delta, integrated twice.
    rotor = (
        0.6
        / REFLECTED
        * (0.5 * since**2 * (1.0 - K / (REFLECTED * W * W)) + K / (REFLECTED * W**4) * (1 - np.cos(W * since)))
    )
    np.testing.assert_allclose(run["state.q_robot_drive_rad"], rotor, atol=1e-7)
    spin = BASE * run["state.v_robot_yaw_rad_s"] + LINK * (
        run["state.v_robot_yaw_rad_s"] + run["state.v_robot_drive_rad_s"] + run["state.v_robot_drive_flex_rad_s"]
    )
    assert np.abs(spin).max() < 1e-12
    np.testing.assert_allclose(run["momentum.robot_L_z_N_m_s"], spin, atol=1e-12)


def test_a_stiff_drive_is_the_rigid_joint_with_the_reflected_inertia(tmp_path):
    """The deflection falls with the stiffness: at 1e5 N m/rad the joint moves as with an armature of gear^2 J."""
    stiff = pushed(tmp_path, {"drive": FLEX["drive"] | {"stiffness": 1e5}}, time_step_s=2.5e-4)
    rigid = ARM.replace('pos="0 0 0.1" damping="0"', f'pos="0 0 0.1" damping="0" armature="{REFLECTED}"')
    plain = pushed(tmp_path, {}, rigid)
    difference = stiff["state.q_robot_drive_rad"] + stiff["state.q_robot_drive_flex_rad"] - plain["state.q_robot_drive_rad"]
    assert np.abs(difference).max() < 3.0 * 0.6 / 1e5


def test_laws_see_the_rigid_robot_at_the_motors(tmp_path):
    """Unless they ask for the flexible one. The plant has both joints."""
    initial = {"joints": {"drive": 0.2, "drive_flex": 0.05}}
    run = pushed(tmp_path, initial=initial)
    (names, qpos), *_ = Push.seen
    assert names == ("robot/x", "robot/yaw", "robot/drive")
    np.testing.assert_array_equal(qpos, [0.0, 0.0, 0.2])
    assert run["state.q_robot_drive_flex_rad"][0] == 0.05
    again = pushed(tmp_path, initial=initial, controller_joints="flexible")
    (names, qpos), *_ = Push.seen
    assert names == ("robot/x", "robot/yaw", "robot/drive", "robot/drive_flex")
    np.testing.assert_array_equal(qpos, [0.0, 0.0, 0.2, 0.05])
    np.testing.assert_array_equal(run.log.rows, again.log.rows)


def test_the_drive_has_nothing_of_the_file(tmp_path):
    """No defaults, and the axis and the anchor of its joint; the armature of the file is replaced."""
    pushed(tmp_path)
    system = prepare(tmp_path / "scene.yaml", {"phases.0.controller.kind": "off"}).system
    model, drive, flex = system.mj, *(system.joints[f"robot/{name}"] for name in ("drive", "drive_flex"))
    assert model.dof_armature[[drive.dofs.start, flex.dofs.start]] == pytest.approx([REFLECTED, 0.0])
    assert model.dof_damping[flex.dofs.start] == 0.0
    first, second = (model.joint(joint.name) for joint in (drive, flex))
    np.testing.assert_array_equal(first.axis, second.axis)
    np.testing.assert_array_equal(first.pos, second.pos)
    lines = prepare(tmp_path / "scene.yaml", {"phases.0.controller.kind": "off"}).describe()
    assert any(f"fastest mode {W:.4g} rad/s" in line and "drive_flex" in line for line in lines)


def test_a_flexible_arm_catches_and_holds(tmp_path):
    """The laws of both phases compute with the rigid arm, free and with the object, and hold the motors."""
    path = grasping(tmp_path, duration_s=1.4)
    drive = {"stiffness": 60.0, "damping": 0.05, "gear": 100.0, "rotor_inertia": 2e-5}
    run = proved(ffsm_mj.run(path, {"robot.joint_flex": {"shoulder": drive, "elbow": drive}, "phases.hold.for_s": 0.4}))
    (capture,) = run.grasps
    assert capture.release_s is not None
    held = (run.time > capture.time_s) & (run.time < capture.release_s)
    assert np.abs(run["state.q_robot_shoulder_flex_rad"][held]).max() > 1e-3
    assert run["balance.robot_damper_heat_J"][-1] > 0.0


TWO = ARM.replace('<joint name="drive"', '<joint name="other" axis="0 1 0"/><joint name="drive"')
BALL = ARM.replace('name="drive" axis="0 0 1"', 'name="drive" type="ball"').replace(
    '<motor name="motor" joint="drive"/>', ""
)


@pytest.mark.parametrize(
    ("robot", "key", "change", "message"),
    [
        (ARM, "drve", {}, "robot.joint_flex.drve: unknown joint 'drve' (did you mean 'drive'?)"),
        (ARM, "yaw", {}, "robot.joint_flex.yaw: is a joint of the base, between the robot and the world"),
        (TWO, "drive", {}, "robot.joint_flex.drive: must be the only joint of its body; 'link' has 2"),
        (BALL, "drive", {}, "robot.joint_flex.drive: must be a hinge or slide joint"),
        (ARM, "drive", {"stiffness": 0.0}, "joint_flex.drive.stiffness: "),
        (ARM, "drive", {"rotor": 1.0}, "robot.joint_flex.drive.rotor: unknown key"),
        (ARM, "drive", {"stiffness": 1e9}, "time_step_s: the spring of joint 'robot/drive_flex' has a mode of "),
    ],
)
def test_faults_name_file_line_and_key(tmp_path, robot, key, change, message):
    with pytest.raises(InputError) as refused:
        pushed(tmp_path, {key: FLEX["drive"] | change}, robot)
    (line,) = refused.value.lines
    assert line.startswith(f"{tmp_path / 'scene.yaml'}:1:")
    assert message in line


def test_an_estimator_needs_the_joints_of_the_plant(tmp_path):
    with pytest.raises(InputError, match=r"robot\.joint_flex: an estimator estimates the joints of the plant: write"):
        pushed(tmp_path, estimator={"kind": "direct"})


def test_damping_gains_are_judged_by_the_rotor(tmp_path):
    """A sampled torque -kd rate meets the inertia B of the rotor alone: it is stable up to 2 B / dt."""
    most = 2.0 * REFLECTED / 1e-3
    noted = []
    for share in (1.01, 0.99):
        law = {"kind": "pd", "kp": 0.0, "kd": share * most}
        pushed(tmp_path, phases=[{"name": "push", "until": "end", "controller": law}])
        notes = prepare(tmp_path / "scene.yaml").notes()
        noted.append([note for note in notes if "kd is unstable at the control period" in note and "robot/drive'" in note])
    assert [len(each) for each in noted] == [1, 0]
