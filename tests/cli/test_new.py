"""A scenario around a robot's file: what is written runs as it stands, and nothing is written over or left behind."""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.cli.main import main
from tests.decomposition import meshes
from tests.model.fake_menagerie import Menagerie
from tests.model.test_model_files import TETRA
from tests.replays import assert_passes
from tests.scenes import ARM

SERVO_ARM = """<mujoco model="vendor"><compiler angle="radian"/><option integrator="implicitfast"/>
  <default><joint damping="1" frictionloss="0.1"/></default>
  <worldbody><light pos="0 0 3"/><geom name="floor" type="plane" size="1 1 1"/>
    <body name="pedestal"><geom type="cylinder" size="0.1 0.1" mass="4"/>
      <body name="upper" pos="0 0 0.15"><joint name="lift" axis="0 1 0" range="-1 1"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.4" size="0.04" mass="2"/>
        <body name="fore" gravcomp="1" pos="0 0 0.4"><joint name="bend" axis="0 1 0" range="0.5 2.5"/>
          <geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.03" mass="1"/>
          <body name="left" pos="0.03 0 0.35"><geom size="0.02" mass="0.05"/><joint name="left" type="slide"/></body>
          <body name="right" pos="-0.03 0 0.35"><geom size="0.02" mass="0.05"/><joint name="right" type="slide"/></body>
        </body></body></body></worldbody>
  <equality><joint joint1="left" joint2="right" polycoef="0 -1 0 0 0"/></equality>
  <actuator><general name="lift" joint="lift" biastype="affine" gainprm="90" biasprm="0 -90 -9" forcerange="-50 50"/>
    <position name="bend" joint="bend" kp="40" ctrlrange="0.5 2.5"/><motor name="left" joint="left"/></actuator>
  <keyframe><key name="home" qpos="0.4 1.2 0 0" ctrl="0.4 1.2 0"/></keyframe></mujoco>"""
"""What a published arm's MJCF is like: servos, damping, a coupled gripper, a keyframe, a floor of its own."""

URDF = """<robot name="vendor">
  <link name="foot"><inertial><mass value="3"/><inertia ixx=".02" ixy="0" ixz="0" iyy=".02" iyz="0" izz=".02"/></inertial>
    <collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision></link>
  <joint name="swing" type="revolute"><parent link="foot"/><child link="boom"/><origin xyz="0 0 0.1"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="20" velocity="1"/><dynamics damping="0.5"/></joint>
  <link name="boom"><inertial><origin xyz="0 0 0.2"/><mass value="1"/>
      <inertia ixx=".02" ixy="0" ixz="0" iyy=".02" iyz="0" izz=".001"/></inertial>
    <collision><origin xyz="0 0 0.2"/><geometry>{shape}</geometry></collision></link>
  <joint name="flange" type="fixed"><parent link="boom"/><child link="tool0"/><origin xyz="0 0 0.45"/></joint>
  <link name="tool0"/></robot>"""
ROD = '<cylinder radius="0.03" length="0.4"/>'
TWO = ARM.replace("</worldbody>", "<body name='other'><joint/><geom size='1'/></body></worldbody>")


@pytest.fixture
def vendor(tmp_path, monkeypatch):
    """Writes a robot's file, in a folder beside the one that the commands are given in; returns its path from there."""
    (tmp_path / "vendor").mkdir()
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")

    def written(name, text):
        (tmp_path / "vendor" / name).write_text(text)
        return f"../vendor/{name}"

    return written


def refused(capfd, *arguments):
    """The one line that a command is refused with."""
    assert main(["new", *arguments]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    return line


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize(
    ("name", "text", "stripped"),
    [
        ("servos.xml", SERVO_ARM, []),
        ("rod.urdf", URDF.format(shape=ROD), []),
        ("floating.xml", ARM, []),
    ],
)
def test_what_is_written_runs_as_it_stands(vendor, name, text, stripped, capfd):
    """Check, run and analyze are content, and the ball is where it was said to be a second after the start.

    Its place is written to 1e-6 m and found to 1e-6 m, its speed is 0.05 m/s or more: 1e-4 s is enough.
    """
    path = vendor(name, text)
    assert main(["new", "my", "--robot", path]) == 0
    said = capfd.readouterr().out
    assert "files in .: my.yaml, my.xml, my_ball.xml" in said
    assert ("removed from the robot: " in said) == bool(stripped)
    assert not stripped or f"removed from the robot: {', '.join(stripped)}\n" in said
    assert main(["check", "my.yaml"]) == 0
    told = capfd.readouterr().out
    assert "conservative: nothing in the models breaks it" in told
    assert "unstable" not in told
    assert main(["run", "my.yaml", "--no-rerun", "--out", "out"]) == 0
    assert main(["analyze", "out"]) == 0
    run = ffsm_mj.load_run("out")
    assert run.impacts[0].time_s == pytest.approx(1.0, abs=1e-4)
    assert run.unhandled_contacts == ()
    assert run.tip_error()[0] < 1e-3  # the tip begins at its target, which is written to 1e-4 m
    assert prepare("my.yaml").scenario.robot.strip == tuple(stripped)
    assert Path(path).read_text() == text
    shutil.rmtree("../vendor")
    np.testing.assert_array_equal(ffsm_mj.run("out").log.rows, run.log.rows)  # it needs the vendor's file no more


def test_an_arm_gets_a_base_and_a_tip_and_keeps_its_drives(vendor):
    """A cube of the mass that is asked for, with the inertia of a cube; servos and what they leave free are the file's."""
    vendor("servos.xml", SERVO_ARM)
    assert main(["new", "my", "--robot", "../vendor/servos.xml", "--base-mass", "120"]) == 0
    system = prepare("my.yaml").system
    model, bus = system.mj, system.mj.body("robot/bus")
    edge = 2.0 * model.geom("robot/bus_hull").size[0]
    assert bus.mass[0] == 120.0
    np.testing.assert_allclose(bus.inertia, 120.0 * edge**2 / 6.0, rtol=5e-4)  # written to four digits
    assert system.robot.root == bus.id
    assert model.body("robot/pedestal").parentid[0] == bus.id
    assert not [name for name in system.names("geom") if "floor" in name]
    assert set(system.names("actuator")) == {f"robot/{name}" for name in ("lift", "bend", "left")}
    assert model.actuator("robot/lift").biasprm.tolist()[:3] == [0.0, -90.0, -9.0]
    assert model.dof_frictionloss[6:10].tolist() == [0.1] * 4
    scenario = prepare("my.yaml").scenario
    assert scenario.initial.joints["lift"] == 0.4  # of the keyframe
    site = model.site("robot/tip")
    assert model.body(site.bodyid[0]).name == "robot/fore"  # the hand, not one of its two fingers
    np.testing.assert_allclose(site.pos, [0.0, 0.0, 0.33], atol=1e-4)  # where the capsule ends: 0.3 and its radius


def test_joints_of_a_file_without_actuators_get_motors(vendor):
    """With the limits that the file states, and without followers of couplings."""
    text = re.sub("<actuator>.*</actuator>", "", SERVO_ARM, flags=re.DOTALL).replace(' ctrl="0.4 1.2 0"', "")
    vendor("bare.xml", text.replace('name="lift" axis', 'name="lift" actuatorfrcrange="-50 50" axis'))
    assert main(["new", "my", "--robot", "../vendor/bare.xml"]) == 0
    system = prepare("my.yaml").system
    assert set(system.names("actuator")) == {f"robot/{name}_motor" for name in ("lift", "bend", "right")}
    np.testing.assert_array_equal(system.mj.actuator("robot/lift_motor").ctrlrange, [-50.0, 50.0])
    assert not system.mj.actuator("robot/bend_motor").ctrllimited[0]


def test_the_effort_that_a_urdf_states_limits_its_motor(vendor):
    vendor("rod.urdf", URDF.format(shape=ROD))
    assert main(["new", "my", "--robot", "../vendor/rod.urdf"]) == 0
    model = prepare("my.yaml").system.mj
    np.testing.assert_array_equal(model.actuator("robot/swing_motor").ctrlrange, [-20.0, 20.0])
    assert model.body(model.site("robot/tip").bodyid[0]).name == "robot/tool0"
    assert model.body("robot/foot").mass[0] == 3.0  # the root link keeps its mass


def test_a_robot_that_floats_gets_no_base(vendor, capfd):
    vendor("floating.xml", ARM)
    assert main(["new", "my", "--robot", "../vendor/floating.xml"]) == 0
    assert "base: none is added, the robot floats already\n" in capfd.readouterr().out
    system = prepare("my.yaml").system
    assert system.mj.body(system.robot.root).name == "robot/base"
    assert [joint.kind for joint in system.robot.joints] == ["free", "hinge", "hinge"]
    line = refused(capfd, "it", "--robot", "../vendor/floating.xml", "--base-mass", "5")
    assert line == "new: --base-mass: ../vendor/floating.xml floats already, no base is added; leave it out"


def test_the_tip_of_a_hand_is_beyond_it(vendor):
    """A hand that is fixed to the last link, whose own geoms are behind it; and a file is named as seen from here."""
    palm = '<body name="palm" pos="0 0 0.35"><geom size="0.03" mass="0.2" friction="0.5"/>'
    hand = SERVO_ARM.replace('<body name="left"', f'{palm}<body name="left"').replace(
        "</body></body></body></w", "</body>" * 4 + "</w"
    )
    vendor("arm.xml", hand)
    assert main(["new", "my", "--robot", "../vendor/arm.xml"]) == 0
    prepared = prepare("my.yaml")
    site = prepared.system.mj.site("robot/tip")
    assert prepared.system.mj.body(site.bodyid[0]).name == "robot/palm"
    np.testing.assert_allclose(site.pos, [0.0, 0.0, 0.03], atol=1e-4)  # its surface, written to 1e-4 m
    (left_out,) = [line for line in prepared.describe() if "friction of geoms" in line]
    assert left_out.startswith("note: my.xml: ")


def test_the_tip_of_a_gripper_without_an_arm_is_the_site_between_its_fingers(vendor):
    fingers = "".join(
        f'<body pos="{x} 0 0.1"><joint name="f{x}" axis="0 1 0"/><geom size="0.01"/></body>' for x in (-0.05, 0.05)
    )
    mount = f'<body name="mount"><geom size="0.05"/><site name="pinch" pos="0 0 0.2"/>{fingers}</body>'
    vendor("gripper.xml", f"<mujoco><worldbody>{mount}</worldbody></mujoco>")
    assert main(["new", "my", "--robot", "../vendor/gripper.xml"]) == 0
    assert prepare("my.yaml").scenario.task.tip == "pinch"


@pytest.mark.parametrize(("tip", "body"), [("centre", "robot/lower"), ("upper", "robot/upper")])
def test_the_tip_may_be_named(vendor, tip, body):
    """A site of the file, or a body; and the ball comes to it."""
    vendor("arm.xml", ARM.replace('<geom name="tip"', '<site name="centre" pos="0.2 0 0"/><geom name="tip"'))
    assert main(["new", "my", "--robot", "../vendor/arm.xml", "--tip", tip]) == 0
    prepared = prepare("my.yaml")
    model = prepared.system.mj
    assert model.body(model.site(prepared.assemble().task.tip_site).bodyid[0]).name == body
    assert prepared.run().impacts


def test_meshes_of_packages_are_found(vendor, tmp_path, capfd):
    """Named by --package-path where they do not lie above the model; the scenario says so too."""
    path = vendor("mesh.urdf", URDF.format(shape='<mesh filename="package://rods/rod.obj" scale="0.3 0.3 0.3"/>'))
    assert "no folder 'rods' above the model or in 'package_paths'" in refused(capfd, "my", "--robot", path)
    (tmp_path / "shelf" / "rods").mkdir(parents=True)
    (tmp_path / "shelf" / "rods" / "rod.obj").write_text(TETRA.format(x=1))
    assert main(["new", "my", "--robot", path, "--package-path", "../shelf"]) == 0
    run = ffsm_mj.run("my.yaml")
    assert run.impacts
    assert all(check.passes for check in all_checks(run))


@pytest.mark.parametrize("there", ["my.yaml", "my.xml", "my_ball.xml"])
def test_nothing_is_written_over(vendor, there, tmp_path, capfd):
    vendor("floating.xml", ARM)
    (tmp_path / "work" / there).write_text("mine")
    line = refused(capfd, "my.yaml", "--robot", "../vendor/floating.xml")
    assert line == f"new: {there} exists; nothing is written over it"
    assert [path.name for path in (tmp_path / "work").iterdir()] == [there]
    assert (tmp_path / "work" / there).read_text() == "mine"


MASS = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
GHOST = f"<mujoco><worldbody><body><freejoint/>{MASS}<body><joint/>{MASS}</body></body></worldbody></mujoco>"
STATUE = "<mujoco><worldbody><body><geom size='1'/></body></worldbody></mujoco>"


@pytest.mark.parametrize(
    ("text", "options", "said"),
    [
        (None, [], "../vendor/robot.xml: no such model file"),
        (STATUE, [], "../vendor/robot.xml: a robot is a tree of moving bodies; no joint was found"),
        (TWO, [], "a robot is one tree of moving bodies; found 2 (base, other): name the robot's with --root"),
        (TWO, ["--root", "othr"], "new: --root: unknown root of a tree 'othr' (did you mean 'other'?); allowed: "),
        (SERVO_ARM, ["--tip", "hand"], "new: --tip: unknown site or body 'hand'; allowed: bus, fore, left, pe"),
        (SERVO_ARM.replace("<body name=", "<bdy name=", 1), [], "malformed XML"),
        (SERVO_ARM, ["--base", "none"], "new: --base none is for a URDF; give the root of an MJCF a <freejoint/>"),
        (ARM, ["--base", "none"], "new: --base: ../vendor/robot.xml floats already, no base is added; leave it out"),
        (ARM, ["--base-size", "1"], "new: --base-size: ../vendor/robot.xml floats already, no base is added; leave it out"),
        (SERVO_ARM, ["--base-mass", "-2"], "ffsm new: argument --base-mass/--bus-mass: -2 is not a positive number"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_told_in_a_line(vendor, tmp_path, text, options, said, capfd):
    """And nothing is left of it."""
    if text is not None:
        vendor("robot.xml", text)
    assert said in refused(capfd, "my", "--robot", "../vendor/robot.xml", *options)
    assert not any((tmp_path / "work").iterdir())


@pytest.mark.parametrize("name", ["a/b", "", ".hidden", "my arm", "../my"])
def test_names_that_cannot_be(vendor, name, capfd):
    vendor("floating.xml", ARM)
    assert "is no name of a scenario" in refused(capfd, name, "--robot", "../vendor/floating.xml")


def test_a_tree_of_several_may_be_chosen(vendor):
    """The other one stays behind."""
    vendor("two.xml", TWO)
    assert main(["new", "my", "--robot", "../vendor/two.xml", "--root", "base"]) == 0
    names = prepare("my.yaml").system.names("body")
    assert "robot/lower" in names
    assert "robot/other" not in names


def test_names_that_the_file_has_are_left_to_it(vendor):
    """A base and a tip beside a body "bus" and a site "tip" of the vendor's."""
    text = SERVO_ARM.replace('name="pedestal"', 'name="bus"')
    vendor("arm.xml", text.replace('<body name="upper"', '<site name="tip"/><body name="upper"'))
    assert main(["new", "my", "--robot", "../vendor/arm.xml"]) == 0
    prepared = prepare("my.yaml")
    assert {"robot/bus", "robot/bus_2"} <= set(prepared.system.names("body"))
    assert prepared.scenario.task.tip == "new_tip"


def test_what_mujoco_warns_of_attaching_is_not_told(vendor):
    """Names stay the vendor's, which MuJoCo warns of for models that are saved; the vendor's solver is of no consequence."""
    vendor("servos.xml", SERVO_ARM)
    assert main(["new", "my", "--robot", "../vendor/servos.xml"]) == 0
    assert not [note for note in prepare("my.yaml").system.notes if "MuJoCo" in note]


NO_WAY = """<mujoco><option gravity="0 0 0"/><worldbody><body name="hub"><freejoint/>
  <geom type="box" size="1 1 1" mass="1000"/><body><joint name="wheel" axis="0 0 1"/>
  <geom type="cylinder" size="0.4 0.2" mass="20"/></body></body></worldbody>
  <actuator><motor joint="wheel"/></actuator></mujoco>"""
"""A satellite with a wheel inside its body, which no ball reaches."""


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (NO_WAY, "no ball: no straight line was found on which a ball meets the tip before other parts"),
        (GHOST, "no ball: no geom of the robot can touch a ball (contype and conaffinity)"),
    ],
)
def test_without_a_way_for_the_ball_there_is_a_scenario_without_it(vendor, text, why, capfd):
    vendor("robot.xml", text)
    assert main(["new", "my", "--robot", "../vendor/robot.xml"]) == 0
    said = capfd.readouterr().out
    assert why in said
    assert "files in .: my.yaml, my.xml\n" in said
    run = ffsm_mj.run("my.yaml", rerun=False)
    assert_passes(run)


def test_a_robot_without_motors_coasts(vendor):
    """Such as a satellite with thrusters alone: the ball still comes."""
    jets = '<motor name="jet" site="nozzle" gear="0 0 1 0 0 0"/>'
    hub = (
        NO_WAY.split("<body><joint", maxsplit=1)[0]
        + '<site name="nozzle"/></body></worldbody>'
        + f"<actuator>{jets}</actuator></mujoco>"
    )
    vendor("robot.xml", hub)
    assert main(["new", "my", "--robot", "../vendor/robot.xml"]) == 0
    run = ffsm_mj.run("my.yaml", rerun=False)
    assert [phase.name for phase in prepare("my.yaml").scenario.phases] == ["coast"]
    assert run.impacts[0].time_s == pytest.approx(1.0, abs=1e-4)


def test_a_spacecraft_of_a_urdf_floats_on_its_own_root(vendor, capfd):
    """No second base, and the model is the URDF itself."""
    path = vendor("rod.urdf", URDF.format(shape=ROD))
    assert main(["new", "my", "--robot", path, "--base", "none"]) == 0
    assert "base: the root of the robot floats; --base-mass KG mounts it on a base instead" in capfd.readouterr().out
    system = prepare("my.yaml").system
    assert system.mj.body(system.robot.root).name == "robot/foot"
    assert system.mj.body_mass[list(system.robot.bodies)].sum() == pytest.approx(4.0)
    assert all(check.passes for check in all_checks(ffsm_mj.run("my.yaml", rerun=False)))


def test_springs_and_dampers_of_joints_stay(vendor):
    """They are modelled, so the plant is the vendor's."""
    vendor("robot.xml", ARM.replace('<joint name="elbow"', '<joint name="elbow" stiffness="3" damping="0.2"'))
    assert main(["new", "my", "--robot", "../vendor/robot.xml"]) == 0
    prepared = prepare("my.yaml")
    assert prepared.scenario.robot.strip == ()
    joint = prepared.system.mj.joint("robot/elbow")
    assert (joint.stiffness[0], joint.damping[0]) == (3.0, 0.2)


def test_the_ball_flies_back(vendor):
    """It is light against what it meets, so that it does not come again and again."""
    vendor("rod.urdf", URDF.format(shape=ROD))
    assert main(["new", "my", "--robot", "../vendor/rod.urdf"]) == 0
    run = ffsm_mj.run("my.yaml")
    before, after = (np.array(each["ball/free"][:3]) for each in (run.impacts[0].qvel_before, run.impacts[0].qvel_after))
    assert before @ after < 0.0
    assert len(run.impacts) == 1


def test_another_folder_may_be_written_to(vendor, capfd):
    """Paths in the files are relative to it."""
    path = vendor("servos.xml", SERVO_ARM)
    assert main(["new", "my", "--robot", path, "--out", "deep/er"]) == 0
    assert "next: ffsm check deep/er/my.yaml && ffsm run deep/er/my.yaml\n" in capfd.readouterr().out
    assert prepare("deep/er/my.yaml").scenario.robot.asset_folders == ("../../../vendor",)


def test_a_name_may_look_like_a_number(vendor):
    """YAML would make one of it."""
    vendor("floating.xml", ARM)
    assert main(["new", "2024", "--robot", "../vendor/floating.xml"]) == 0
    assert prepare("2024.yaml").scenario.name == "2024"


def test_a_link_that_leads_nowhere_is_not_written_through(vendor, tmp_path, capfd):
    path = vendor("floating.xml", ARM)
    (tmp_path / "work" / "my.yaml").symlink_to(tmp_path / "elsewhere.yaml")
    assert refused(capfd, "my", "--robot", path) == "new: my.yaml exists; nothing is written over it"
    assert not (tmp_path / "elsewhere.yaml").exists()


_SPHERE = "<collision><geometry><sphere radius='0.3'/></geometry></collision>"
_UNIT = "<inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/>"


@pytest.mark.parametrize(("far", "axis"), [("1e9", "1 0 0"), ("0", "1 1 1e300")])
def test_a_robot_from_which_no_run_can_start(tmp_path, capfd, far, axis):
    """Refused in one line, with nothing of MuJoCo's beside it and nothing written; negative gains came of it before."""
    links = "".join(
        f"<link name='{name}'><inertial><origin xyz='0 0 {z}'/><mass value='1'/>{_UNIT}</inertial>{_SPHERE}</link>"
        for name, z in (("a", "0"), ("b", far))
    )
    joint = "<joint name='j' type='revolute'><parent link='a'/><child link='b'/><origin xyz='1 0 0'/>"
    limit = "<limit lower='-1' upper='1' effort='1' velocity='1'/>"
    robot = tmp_path / "r.urdf"
    robot.write_text(f"<robot name='r'>{links}{joint}<axis xyz='{axis}'/>{limit}</joint></robot>")
    assert main(["new", "q", "--robot", str(robot), "--out", str(tmp_path / "o")]) == 2
    captured = capfd.readouterr()
    assert captured.out == ""
    start = rf"{robot}: as q\.xml, which is not written: in its starting pose"
    assert re.fullmatch(rf"{start} the mass matrix is .+\n", captured.err)
    assert list((tmp_path / "o").iterdir()) == []


def test_the_pose_that_is_written_is_within_the_limits(vendor):
    """A keyframe past a limit ends at it; without one, each joint begins well inside its range."""
    past = SERVO_ARM.replace('qpos="0.4 1.2 0 0"', 'qpos="1.00004 2.6 0 0"')
    vendor("servos.xml", past)
    assert main(["new", "my", "--robot", "../vendor/servos.xml"]) == 0
    joints = prepare("my.yaml").scenario.initial.joints
    assert (joints["lift"], joints["bend"]) == (1.0, 2.5)
    vendor("other.xml", re.sub(r"<keyframe>.*</keyframe>", "", SERVO_ARM))
    assert main(["new", "other", "--robot", "../vendor/other.xml"]) == 0
    joints = prepare("other.yaml").scenario.initial.joints
    assert (joints["lift"], joints["bend"]) == (0.3, 1.5)


def test_only_what_is_not_modelled_is_removed(vendor, capfd):
    """Sensors of a kind that is not measured, and nothing else."""
    sensor = '<sensor><camprojection site="eye" camera="view"/></sensor><actuator>'
    frames = '<camera name="view" resolution="9 9"/><site name="eye"/><body name="upper"'
    vendor("robot.xml", SERVO_ARM.replace("<actuator>", sensor).replace('<body name="upper"', frames))
    assert main(["new", "my", "--robot", "../vendor/robot.xml"]) == 0
    assert "removed from the robot: sensors\n" in capfd.readouterr().out


@pytest.mark.parametrize("scene", [False, True])
def test_meshes_that_are_not_convex_become_pieces(vendor, capfd, scene):
    """Those that can be decomposed, in the robot and in objects; of others it is said why not."""

    def mesh(name, vertices, faces):
        numbers = " ".join(map(repr, vertices.reshape(-1).tolist()))
        return f'<mesh name="{name}" vertex="{numbers}" face="{" ".join(map(str, faces.reshape(-1).tolist()))}"/>'

    vertices, faces = meshes.bracket()
    whole = [mesh("bracket", vertices, faces), mesh("open", vertices, faces[1:]), mesh("box", *meshes.box())]
    geoms = "".join(f'<geom type="mesh" mesh="{name}" pos="{x} 0 0"/>' for x, name in enumerate(("bracket", "open", "box")))
    other = f'<body name="part" pos="5 0 0"><freejoint/>{geoms}</body>' if scene else ""
    path = vendor(
        "robot.xml",
        f'<mujoco><asset>{"".join(whole)}</asset><worldbody><body name="base"><freejoint/>{geoms}</body>{other}'
        "</worldbody></mujoco>",
    )
    asked = ["--scene", path, "--robot", "base"] if scene else ["--robot", path]
    assert main(["new", "my", *asked, "--decompose"]) == 0
    said = capfd.readouterr().out
    prefixes = ("robot/", "part/") if scene else ("",)
    for prefix in prefixes:
        assert f"mesh {prefix}bracket: 2 pieces by planes 1, at least" in said
        assert f"mesh {prefix}open stays its hull: " in said
        assert "mesh 'open': is not closed" in said
        assert f"mesh {prefix}box" not in said
    prepared = prepare("my.yaml")
    assert [one.mesh for one in prepared.scenario.robot.decompose] == ["bracket"]
    assert [len(pieces) for pieces in prepared.system.pieces.values()] == [2] * len(prefixes)
    assert main(["check", "my.yaml"]) == 0
    told = capfd.readouterr().out
    assert "    robot/bracket: 2 pieces by planes 1, at least" in told


def test_a_scene_in_one_file(vendor, capfd):
    """The file stays as it is, and the scenario runs; what is not modelled is removed from the model that has it."""
    floor = '<geom name="floor" type="plane" size="1 1 1" pos="0 0 -2"/><geom name="step" size="0.1" pos="3.1 0 0"/>'
    rock = '<body name="rock" pos="3 0 0"><freejoint/><geom name="rock" size="0.1"/><site name="eye"/></body></worldbody>'
    sensor = '<sensor><touch site="eye"/><user dim="1" objtype="body" objname="rock"/></sensor></mujoco>'
    text = ARM.replace("<worldbody>", f"<worldbody>{floor}").replace("</worldbody>", rock).replace("</mujoco>", sensor)
    path = vendor("room.xml", text)
    assert main(["new", "my", "--scene", path, "--robot", "base"]) == 0
    said = capfd.readouterr().out
    assert "robot: base; objects: rock, surroundings\n" in said
    assert "removed: rock: [sensors]\n" in said
    assert "contacts ignored, as they overlap at the start: 1\n" in said
    assert "[rock/rock, surroundings/step]" in Path("my.yaml").read_text()
    assert ffsm_mj.run("my.yaml").outcome == "completed"
    assert "allowed: base, rock" in refused(capfd, "it", "--scene", path, "--robot", "floor")
    assert refused(capfd, "it", "--scene", path, "--robot", "floor").startswith("new: --robot: unknown root")
    assert refused(capfd, "it", "--scene", "none.xml", "--robot", "base").startswith("new: --scene: no such model file")
    assert "needs --robot BODY" in refused(capfd, "it", "--scene", path)
    assert "--out alone" in refused(capfd, "it", "--scene", path, "--robot", "base", "--wheels", "4", "--target", "no.xml")
    assert "exists; nothing is written over it" in refused(capfd, "my", "--scene", path, "--robot", "base")
    assert [each.name for each in Path().iterdir()] == ["my.yaml"]


def test_a_robot_of_menagerie_is_copied(vendor, tmp_path, monkeypatch, capfd):
    """With its licence, into a folder of its name."""
    shelf = Menagerie(tmp_path / "vendor")
    vendor("arm.xml", SERVO_ARM)
    vendor("LICENSE", "all yours")
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", shelf)
    assert main(["new", "my", "--menagerie", "vendor"]) == 0
    assert "download of vendor: " in capfd.readouterr().err
    assert sorted(each.name for each in Path("vendor").iterdir()) == ["LICENSE", "arm.xml"]
    assert prepare("my.yaml").scenario.robot.asset_folders == ()
    assert "exists; nothing is written over it; --robot vendor/arm.xml uses" in refused(capfd, "it", "--menagerie", "vendor")
    assert "give the robot by --robot FILE or by --menagerie NAME" in refused(capfd, "it")


def test_a_keyframe_that_contradicts_a_coupling_is_refused(tmp_path, capfd):
    """Nothing names a file or a line that nobody can look at."""
    robot = tmp_path / "arm.xml"
    robot.write_text("""<mujoco><compiler angle="radian"/><worldbody><body name="base"><geom size=".1" mass="5"/>
      <body name="l1" pos=".1 0 0"><joint name="j1" axis="0 0 1" range="-1 1"/><geom size=".03" pos=".1 0 0" mass="1"/>
      <body name="l2" pos=".3 0 0"><joint name="j2" axis="0 0 1" range="-1 1"/><geom size=".03" pos=".1 0 0" mass="1"/>
      </body></body></body></worldbody>
      <equality><joint name="twice" joint1="j2" joint2="j1" polycoef="0 2 0 0 0"/></equality>
      <keyframe><key qpos="0.9 0.3"/></keyframe></mujoco>""")
    assert main(["new", "q", "--robot", str(robot), "--out", str(tmp_path)]) == 2
    assert capfd.readouterr().err == (
        f"{robot}: as q.yaml, which is not written: initial.joints.j2: the initial state is off {robot}:5: equality 'twice' "
        "by 1.5 m or rad; nearest values that fit: robot/j1 0.5, robot/j2 1; the pose is that of its first keyframe, if it "
        "has one\n"
    )
    assert [path.name for path in tmp_path.iterdir()] == ["arm.xml"]


@pytest.mark.parametrize("option", ["robot", "scene"])
def test_a_friction_below_zero_is_refused_and_not_stripped(tmp_path, capfd, option):
    """It is a mistake of the file, and no kind of friction that is not modelled."""
    file, out = tmp_path / "arm.xml", tmp_path / "out"
    file.write_text("""<mujoco><worldbody><body name="arm"><freejoint/><geom size=".1"/><body pos="1 0 0">
      <joint name="elbow" frictionloss="-3"/><geom size=".1"/></body></body></worldbody></mujoco>""")
    asked = ["--robot", str(file)] if option == "robot" else ["--scene", str(file), "--robot", "arm"]
    assert main(["new", "q", *asked, "--out", str(out)]) == 2
    captured = capfd.readouterr()
    assert captured.err.strip() == (
        f"{file}:2: joint 'elbow' has frictionloss -3 below zero, which would drive the joint; it must be zero or more"
    )
    assert [*out.iterdir()] == []
