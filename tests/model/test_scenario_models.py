"""What a scenario says of its models: objects that it fixes, sites that it adds to the robot, elements that it removes."""

from __future__ import annotations

import json

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.cli.main import main
from ffsm_mj.contact.motion_bound import speeds_per_root_energy
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.errors import InputError
from tests.model.repeated import repeated
from tests.scenes import ARM, HEAD, ball, scene

PORT = f"""<mujoco>{HEAD}
<worldbody>
  <geom name="plate" type="box" size="1 1 0.1"/>
  <body name="post" pos="0 0 0.5">
    <geom name="post" size="0.2" mass="7"/>
    <body name="tip" pos="0 0 0.3" euler="0 90 0"><geom name="tip" type="box" size="0.01 0.02 0.03"/></body>
  </body>
</worldbody>
</mujoco>"""


def docking(folder, port=PORT, pose=None, **scenario):
    return scene(
        folder,
        ball("ball"),
        {"port": port},
        fixed={"port": pose or {}},
        **{"duration_s": 0.02, "initial": {"joints": {"robot/free": [0, 0, 9, 1, 0, 0, 0]}}, **scenario},
    )


def faults(path):
    with pytest.raises(InputError) as caught:
        prepare(path)
    return list(caught.value.lines)


def test_a_fixed_object_is_at_its_pose(tmp_path):
    """All bodies of the file are at their places relative to the pose; the quaternion is normalised."""
    turn = np.array((0.8, 0.0, 0.6, 0.0))
    path = docking(tmp_path, pose={"position_m": [1.0, -2.0, 3.0], "quaternion": [*(turn * 1.0005)]})
    system = prepare(path).system
    (port,) = system.fixed
    assert (port.name, port.root, system.objects) == ("port", port.bodies[0], ())
    assert [system.mj.body(body).name for body in port.bodies] == ["port/world", "port/post", "port/tip"]
    alone = mujoco.MjModel.from_xml_string(PORT)
    there, here = mujoco.MjData(system.mj), mujoco.MjData(alone)
    mujoco.mj_forward(system.mj, there)
    mujoco.mj_forward(alone, here)
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, turn)
    for name in ("plate", "post", "tip"):
        at = there.geom(f"port/{name}")
        np.testing.assert_allclose(at.xpos, rotation.reshape(3, 3) @ here.geom(name).xpos + (1.0, -2.0, 3.0), atol=1e-15)
        turned = rotation.reshape(3, 3) @ here.geom(name).xmat.reshape(3, 3)
        np.testing.assert_allclose(at.xmat.reshape(3, 3), turned, atol=1e-15)
    # Nobody's sums have its mass in them.
    assert system.mj.body_subtreemass[0] == system.mj.body_mass.sum() == 1.0


def test_check_lists_fixed_objects(tmp_path):
    assert "  port: fixed, bodies 3" in prepare(docking(tmp_path)).describe()


def test_a_run_with_a_fixed_object_is_repeatable_from_folder_and_log(tmp_path):
    path = docking(
        tmp_path,
        pose={"position_m": [0.3, 0.2, -0.7], "quaternion": [0.8004, 0.0, 0.6, 0.0]},
        contacts={"rules": [{"between": ["port/post", "ball"], "restitution": 0.5}]},
        initial={"joints": {"robot/free": [1.3, 0.2, -0.5, 1, 0, 0, 0]}, "rates": {"robot/free": [-1.0, 0, 0, 0, 0, 0]}},
        duration_s=0.4,
    )
    run, logged = repeated(path, tmp_path / "out", tmp_path / "port.xml")
    assert len(run.impacts) == 1
    for name in ("body_pos", "body_quat", "body_mass", "geom_pos"):
        np.testing.assert_array_equal(
            getattr(logged.mj, name), getattr(prepare(tmp_path / "out" / "scenario.yaml").system.mj, name)
        )
    assert [each.name for each in logged.fixed] == ["port"]


@pytest.mark.parametrize(
    ("inside", "line"),
    [
        ('<joint name="hinge"/>', "port.xml:5: joint 'hinge' moves a fixed object; remove it, or write 'fixed: false'"),
        ("<freejoint/>", "port.xml:5: joint 'post_joint' moves a fixed object; remove it, or write 'fixed: false'"),
    ],
)
def test_a_joint_is_refused_with_file_and_line(tmp_path, inside, line):
    port = PORT.replace('<geom name="post"', f'{inside}<geom name="post"')
    assert faults(docking(tmp_path, port)) == [f"{tmp_path}/{line}"]


def test_a_mocap_body_is_refused_with_file_and_line(tmp_path):
    port = PORT.replace('<body name="post"', '<body name="hand" mocap="true"/><body name="post"')
    line = "port.xml:4: body 'hand' (mocap) moves a fixed object; remove it, or write 'fixed: false'"
    assert faults(docking(tmp_path, port)) == [f"{tmp_path}/{line}"]


def test_an_actuator_is_refused_with_file_and_line(tmp_path):
    port = PORT.replace('<geom name="post"', '<site name="nozzle"/><geom name="post"').replace(
        "</worldbody>", '</worldbody>\n<actuator><motor name="jet" site="nozzle" gear="1 0 0 0 0 0"/></actuator>'
    )
    assert faults(docking(tmp_path, port)) == [
        f"{tmp_path}/port.xml:9: actuator 'jet' drives a fixed object; remove it, or write 'fixed: false'"
    ]


def test_a_fixed_urdf_gets_no_free_joint(tmp_path):
    """A floating one gets a free joint."""
    urdf = """<robot name="rig"><link name="rig"><collision><geometry><box size="1 1 1"/></geometry></collision></link>
      <link name="arm"/><joint name="bolt" type="fixed"><parent link="rig"/><child link="arm"/></joint></robot>"""
    path = docking(tmp_path)
    (tmp_path / "rig.urdf").write_text(urdf)
    system = prepare(path, {"objects.port.mjcf": "rig.urdf"}).system
    assert [joint.name for joint in system.joints.values()] == ["robot/free"]
    assert len(system.fixed[0].bodies) == 3


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"fixed": False, "pose": {}}, "objects.port.pose: only with 'fixed: true'"),
        (
            {"pose": {"quaternion": [1, 0, 0, 0.2]}},
            "pose.quaternion: the quaternion (w, x, y, z) must have length 1, got 1.0198",
        ),
        ({"pose": {"quaternion": [0, 0, 0, 0]}}, "must have length 1, got 0"),
        ({"pose": {"position_m": [1, 2]}}, "objects.port.pose.position_m:"),
        ({"pose": {"position_m": [1, 2, 1e12]}}, "objects.port.pose.position_m"),
        ({"pose": {"position": [1, 2, 3]}}, "unknown key (did you mean 'position_m'?); allowed: position_m, quaternion"),
        ({"fixed": "yes"}, "objects.port.fixed: should be a valid boolean"),
    ],
)
def test_faults_of_a_pose_are_reported_with_their_place(tmp_path, changes, words):
    path = docking(tmp_path)
    data = json.loads(path.read_text())
    data["objects"]["port"] = {"mjcf": "port.xml", "fixed": True} | changes
    path.write_text(json.dumps(data, indent=1))
    (line,) = faults(path)
    assert line.startswith(f"{path}:")
    assert words in line


def test_a_pair_needs_a_moving_side(tmp_path):
    system = prepare(docking(tmp_path)).system
    with pytest.raises(LookupError, match="both fixed"):
        ContactPair(system, "pair", "port/plate", "port/tip", 1.0)
    pair = ContactPair(system, "pair", "port/plate", "ball", 1.0)
    data = mujoco.MjData(system.mj)
    data.qvel[:3] = (0.0, 0.0, -1.0)
    mujoco.mj_forward(system.mj, data)
    # 1 kg: |v| <= sqrt(2 T), and the ball turns about its centre, 0.1 m from its surface: I = 0.4 m r^2.
    spin = 0.1 / np.sqrt(0.4 * 0.1**2)
    assert speeds_per_root_energy(system.mj, data, [pair])[0] == pytest.approx(1.0 + spin, rel=1e-12)
    assert pair.closing_speed_bound(data) == pytest.approx(1.1)


def test_a_fixture_of_a_model_that_floats_is_no_side_of_a_pair(tmp_path):
    """A geom in the world of a floating model is not declared as fixed: the message names it and a remedy."""
    rock = ball("rock").replace(
        "<worldbody>", '<worldbody><body name="stand"><geom name="stand" size="0.1" pos="5 0 0"/></body>'
    )
    path = scene(tmp_path, ball("ball"), {"rock": rock}, contacts={"rules": [{"between": ["ball", "rock/stand"]}]})
    (line,) = faults(path)
    assert "geom 'rock/stand' is fixed to the world: move it to an object with 'fixed: true'" in line


def test_its_contacts_are_reported_or_ignored_by_its_name(tmp_path):
    """Overlap with the plate at the start is reported, unless the pair is in contacts.ignored."""
    inside = {"joints": {"robot/free": [0, 0, 0, 1, 0, 0, 0]}}
    run = ffsm_mj.run(docking(tmp_path, initial=inside))
    assert [record.geoms for record in run.unhandled_contacts] == [("port/plate", "robot/ball")]
    ignored = [{"between": ["robot", "port"], "reason": "they are one"}]
    assert not ffsm_mj.run(docking(tmp_path, initial=inside, contacts={"ignored": ignored})).unhandled_contacts


def reaching(folder, **sites):
    """The arm, with a task for a site that the scenario adds."""
    path = scene(
        folder,
        ARM,
        {"target": ball("target")},
        duration_s=0.05,
        initial={"joints": {"target/free": [9, 0, 0, 1, 0, 0, 0], "shoulder": 0.4}, "rates": {"elbow": 0.5}},
        task={"tip": "tip", "target_m": [1.0, 0.5, 0.0]},
    )
    path.write_text(json.dumps(json.loads(path.read_text()) | {"robot": {"mjcf": "robot.xml", "sites": sites}}))
    return path


def test_a_site_is_at_the_given_position(tmp_path):
    path = reaching(tmp_path, tip={"body": "lower", "pos_m": [0.5, 0.0, 0.1]})
    system = prepare(path).system
    site = system.mj.site("robot/tip")
    assert system.mj.body(site.bodyid[0]).name == "robot/lower"
    np.testing.assert_array_equal(site.pos, [0.5, 0.0, 0.1])
    data = mujoco.MjData(system.mj)
    mujoco.mj_forward(system.mj, data)
    np.testing.assert_allclose(data.site("robot/tip").xpos, [1.25, 0.0, 0.1], atol=1e-15)  # base 0.25, upper 0.5, lower 0.5


def test_a_site_of_an_object_is_turned_as_stated(tmp_path):
    """The quaternion, here a half turn about x - z of the target's frame, takes z into -x."""
    path = reaching(tmp_path, tip={"body": "lower"})
    half = {"body": "target", "pos_m": [0.1, 0.0, 0.0], "quaternion": [0.0, 0.5**0.5, 0.0, -(0.5**0.5)]}
    text = json.loads(path.read_text())
    text["objects"]["target"]["sites"] = {"grapple": half}
    path.write_text(json.dumps(text))
    system = prepare(path).system
    data = mujoco.MjData(system.mj)
    mujoco.mj_forward(system.mj, data)
    assert system.mj.body(system.mj.site("target/grapple").bodyid[0]).name == "target/target"
    np.testing.assert_allclose(data.site("target/grapple").xmat.reshape(3, 3)[:, 2], [-1.0, 0.0, 0.0], atol=1e-15)
    text["objects"]["target"]["sites"]["grapple"]["quaternion"] = [1.0, 1.0, 0.0, 0.0]
    path.write_text(json.dumps(text))
    (line,) = faults(path)
    assert "objects.target.sites.grapple.quaternion: the quaternion (w, x, y, z) must have length 1, got 1.41421" in line
    text["objects"]["target"]["sites"]["grapple"] = {"body": "hull"}
    path.write_text(json.dumps(text))
    (line,) = faults(path)
    assert "objects.target.sites.grapple.body: unknown body 'hull'; allowed: target" in line


def test_log_and_rerun_have_the_site_too(tmp_path):
    turned = {"body": "finger", "quaternion": [0.6, 0.0, 0.8, 0.0]}
    _, system = repeated(reaching(tmp_path, tip=turned), tmp_path / "run")
    assert (tmp_path / "run" / "mjcf" / "robot" / "robot.xml").read_text() == ARM
    np.testing.assert_allclose(system.mj.site("robot/tip").quat, turned["quaternion"], rtol=1e-15)


@pytest.mark.parametrize(
    ("site", "said"),
    [
        (
            {"body": "lowr"},
            r"robot\.sites\.tip\.body: unknown body 'lowr' \(did you mean 'lower'\?\); allowed: base, finger, ",
        ),
        ({"body": "world"}, r"robot\.sites\.tip\.body: unknown body 'world'; allowed"),
        ({"body": "base", "pos_m": [0, 0]}, r"robot\.sites\.tip\.pos_m"),
    ],
)
def test_faults_of_a_site_are_reported_with_their_place(tmp_path, site, said):
    with pytest.raises(InputError, match=r"scene\.yaml:1:\d+: " + said):
        prepare(reaching(tmp_path, tip=site))


def test_a_site_of_the_model_is_not_replaced(tmp_path):
    path = reaching(tmp_path, tip={"body": "lower"})
    (tmp_path / "robot.xml").write_text(ARM.replace('<geom name="tip"', '<site name="tip"/><geom name="tip"'))
    with pytest.raises(InputError, match=r"robot\.sites\.tip: the model already has a site of this name; choose another"):
        prepare(path)


ALL = ["damping", "frictionloss", "stiffness", "limits", "equalities", "tendons", "servos"]
JOINT = 'damping="2" frictionloss="0.1" stiffness="3" range="-1 1" limited="true"'
TENDON = """<tendon><fixed name="strap" damping="3" stiffness="1" frictionloss="0.2" range="-1 1" limited="true">
  <joint joint="shoulder" coef="1"/><joint joint="elbow" coef="1"/></fixed></tendon>
  <equality><joint name="tied" joint1="shoulder" joint2="elbow"/><tendon name="taut" tendon1="strap"/></equality>
  <sensor><tendonpos tendon="strap"/><actuatorfrc actuator="aim"/><jointpos joint="elbow"/></sensor>
  <keyframe><key name="home" ctrl="1 2 3 4 5" act="6"/></keyframe></mujoco>"""
SERVOS = '<position name="aim" joint="elbow" kp="9"/><general name="lag" joint="shoulder" dyntype="filter" dynprm="1"/>'


def vendor():
    """The arm with all non-conservative elements, a motor on a tendon, servos and a keyframe."""
    text = ARM.replace('name="shoulder" axis', f'name="shoulder" {JOINT} axis').replace(
        'name="elbow" axis', 'name="elbow" springdamper="0.1 0.5" axis'
    )
    return text.replace("</actuator></mujoco>", f'<motor name="pull" tendon="strap"/>{SERVOS}</actuator>{TENDON}')


def moving(folder, strip, **changes):
    path = scene(folder, vendor(), {"target": ball("target")}, **changes)
    return path, {
        "robot.strip": strip,
        "initial.joints": {"target/free": [9.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]},
        "initial.rates": {"elbow": 0.5, "shoulder": -0.3},
        "duration_s": 0.2,
    }


def test_a_completely_stripped_arm_moves_as_the_bare_arm(tmp_path):
    """Bit by bit: the removed elements have no effect."""
    path, changes = moving(tmp_path, ALL)
    run = ffsm_mj.run(path, changes)
    (tmp_path / "robot.xml").write_text(ARM)
    bare = ffsm_mj.run(path, changes | {"robot.strip": []})
    np.testing.assert_array_equal(run.qpos, bare.qpos)
    assert all(check.passes for check in all_checks(run))
    assert prepare(path, changes).system.mj.nsensor == 0


def test_check_lists_the_removed_elements(tmp_path, capfd):
    path, changes = moving(tmp_path, ALL)
    notes = prepare(path, changes).system.notes
    removed = (
        "damping of 2 joints (shoulder, elbow)",
        "damping of 1 tendon (strap)",
        "frictionloss of 1 joint (shoulder)",
        "frictionloss of 1 tendon (strap)",
        "stiffness of 1 joint (shoulder)",
        "stiffness of 1 tendon (strap)",
        "limits of 1 joint (shoulder)",
        "limits of 1 tendon (strap)",
        "2 equality constraints (tied, taut)",
        "1 sensor (strap_tendonpos)",
        "1 actuator (pull)",
        "1 tendon (strap)",
        "1 sensor (aim_actuatorfrc)",
        "2 actuators (aim, lag)",
    )
    assert notes == (f"removed from robot: {'; '.join(removed)}",)
    capfd.readouterr()
    assert main(["check", str(path), "-s", f"robot.strip={ALL}"]) == 0
    assert f"note: {notes[0]}\n" in capfd.readouterr().out


@pytest.mark.parametrize(
    ("left", "attribute"),
    [("damping", "dof_damping"), ("stiffness", "jnt_stiffness"), ("frictionloss", "dof_frictionloss")],
)
def test_springs_dampers_and_friction_of_joints_are_kept(tmp_path, left, attribute):
    """Unless they are stripped: they enter the balance."""
    path, changes = moving(tmp_path, [word for word in ALL if word != left])
    assert getattr(prepare(path, changes).system.mj, attribute).any()


def test_servos_are_kept(tmp_path):
    """Unless they are stripped."""
    path, changes = moving(tmp_path, ALL[:-1])
    assert {"robot/aim", "robot/lag"} <= set(prepare(path, changes).system.names("actuator"))


def test_log_and_rerun_strip_alike(tmp_path):
    """The copied file is the original; log replay and rerun remove the same elements."""
    path, changes = moving(tmp_path, ALL)
    changes["objects.target.strip"] = ["damping"]
    (tmp_path / "target.xml").write_text(
        ball("target").replace('<freejoint name="free"/>', '<joint name="free" type="free" damping="1"/>')
    )
    gone = [tmp_path / name for name in ("robot.xml", "target.xml", "scene.yaml")]
    repeated(path, tmp_path / "run", *gone, overrides=changes)
    assert (tmp_path / "run" / "mjcf" / "robot" / "robot.xml").read_text() == vendor()


def test_unknown_entries_of_strip_are_refused_with_the_allowed_ones(tmp_path):
    path, changes = moving(tmp_path, ["damping", "gravity"])
    with pytest.raises(InputError, match=r"robot\.strip.*'damping'.*'tendons'.*gravity"):
        prepare(path, changes)


def test_gravcomp_is_removed(tmp_path):
    """It has no effect without gravity; with ``strip`` the body has no weight either."""
    path, changes = moving(tmp_path, [])
    held = ARM.replace('<body name="lower"', '<body name="lower" gravcomp="1"')
    (tmp_path / "robot.xml").write_text(held)
    (note,) = prepare(path, changes).system.notes
    assert "left out, " in note
    assert note.endswith(": gravcomp")
    system = prepare(path, changes | {"robot.strip": ["gravcomp"]}).system
    assert system.notes == ("removed from robot: gravcomp of 1 link (lower)",)
    assert not system.mj.body_gravcomp.any()
