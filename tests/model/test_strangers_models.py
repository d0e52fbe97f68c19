"""What MuJoCo does with an attribute of a stranger's file is modelled, refused or noted: it never gives a wrong number."""

from __future__ import annotations

import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import InputError
from tests.scenes import HEAD, ball, compile_paths, scene

BUS = """<mujoco>{head}<worldbody><body name="bus"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="10" diaginertia="1 2 3"/><geom name="hull" type="box" size="0.2 0.2 0.2" {geom}/>{site}
  <body name="link" pos="0.3 0 0"><joint name="j" axis="0 1 0" {joint}/><inertial pos="0.2 0 0" mass="2"
  diaginertia="0.1 0.1 0.1"/><body name="hand" pos="0.4 0 0"><joint name="wrist" type="ball"/>
  <geom name="hand" size="0.05" mass="1"/></body></body></body>
  {world}</worldbody><equality>{equality}</equality><actuator>{actuator}</actuator><sensor>{sensor}</sensor></mujoco>"""


def bus(head=HEAD, **parts):
    return BUS.format(
        head=head, **dict.fromkeys(("geom", "site", "joint", "world", "equality", "actuator", "sensor"), "") | parts
    )


def system(folder, xml, others=(), **files):
    (folder / "bus.xml").write_text(xml)
    for name, text in files.items():
        (folder / f"{name}.xml").write_text(text)
    return compile_paths(folder / "bus.xml", {name: folder / f"{name}.xml" for name in others})


@pytest.mark.parametrize("attached", [False, True])
def test_a_total_mass_is_refused_wherever_it_stands(tmp_path, attached):
    """MuJoCo applies that of the outermost file alone, and a scene is the outermost."""
    setting = '<compiler settotalmass="12"/>'
    if not attached:
        with pytest.raises(InputError, match=r"bus\.xml:1: <compiler settotalmass='12'> would have no effect in a scene"):
            system(tmp_path, bus(setting + HEAD))
        return
    arm = f'<mujoco>{setting}<worldbody><body name="arm"><joint/><geom size="0.1"/></body></worldbody></mujoco>'
    main = bus(
        '<asset><model name="arm" file="arm.xml"/></asset>' + HEAD, site='<attach model="arm" body="arm" prefix="a_"/>'
    )
    with pytest.raises(InputError, match=r"arm\.xml:1: <compiler settotalmass='12'>"):
        system(tmp_path, main, arm=arm)


@pytest.mark.parametrize("conservative", [True, False])
def test_the_gravity_flag_is_zero_gravity(tmp_path, conservative):
    head = '<option gravity="0 0 -9.81"><flag gravity="disable"/></option>'
    run = ffsm_mj.run(scene(tmp_path, bus(head), {}, duration_s=0.1, conservative=conservative), rerun=False)
    assert run["state.q_robot_free_z_m"][-1] == 0.0


def test_the_magnetic_field_is_that_of_the_file(tmp_path):
    """Models without one take it over; two different ones are refused."""
    field, sensor = '<option gravity="0 0 0" magnetic="2e-5 0 3e-5"/>', '<magnetometer name="mag" site="s"/>'
    assert system(tmp_path, bus(field), ["other"], other=ball("other")).mj.opt.magnetic.tolist() == [2e-5, 0.0, 3e-5]
    assert system(tmp_path, ball("robot"), ["other"], other=bus(field)).mj.opt.magnetic.tolist() == [2e-5, 0.0, 3e-5]
    with pytest.raises(
        InputError, match=r"magnetic field is 1 0 0, and 2e-05 0 3e-05 in .*bus\.xml; .* have one magnetic field"
    ):
        system(tmp_path, bus(field), ["other"], other=bus('<option gravity="0 0 0" magnetic="1 0 0"/>'))
    path = scene(tmp_path, bus(field, site='<site name="s"/>', sensor=sensor), {}, duration_s=0.1)
    run = ffsm_mj.run(path, rerun=False)
    assert [run[f"sensor.robot_mag_{axis}_T"][-1] for axis in "xyz"] == [2e-5, 0.0, 3e-5]


def test_an_effort_limit_of_a_joint_bounds_what_its_motor_delivers(tmp_path):
    """100 N m are asked for and 2 are applied, logged and entered in the balance: MuJoCo clamps the sum at the joint."""
    xml = bus(joint='actuatorfrcrange="-2 2"', actuator='<motor name="m" joint="j" gear="5"/>')
    path = scene(tmp_path, xml, {}, duration_s=0.05, phases=[{"name": "p", "until": "end", "controller": {
        "kind": "pd", "kp": 1e3, "kd": 0.0, "joints": ["j"], "target": [0.1]}}])  # fmt: skip
    run = ffsm_mj.run(path, rerun=False)
    told = [run[f"actuators.robot_m_{what}_N_m"] for what in ("command", "applied", "lower", "upper")]
    assert told[0][0] == 100.0
    assert [each[0] for each in told[1:]] == [2.0, -2.0, 2.0]
    assert all(check.passes for check in all_checks(run))


def test_an_effort_limit_under_several_actuators_is_refused(tmp_path):
    limited, motor = 'actuatorfrcrange="-2 2"', '<motor joint="j"/>'
    with pytest.raises(InputError, match=r"joint 'j' has an effort limit, and on it act robot/j_motor, robot/j_motor_2"):
        system(tmp_path, bus(joint=limited, actuator=motor * 2))
    site = '<site name="nozzle" pos="0.1 0 0"/></body></body></body>'
    jet = bus(joint=limited, actuator=motor + '<motor site="nozzle" gear="1 0 0 0 0 0"/>').replace(
        "</body></body></body>", site
    )
    with pytest.raises(InputError, match="joint 'j' has an effort limit, and on it act"):
        system(tmp_path, jet)


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        ({"actuator": '<motor joint="free" gear="1 0 0 0 0 0"/>'}, "motor on a free joint; write <motor site="),
        ({"actuator": '<motor joint="free" gear="0 0 0 0 1 0"/>'}, "motor on a free joint; write <motor site="),
        ({"actuator": '<motor joint="wrist" gear="0 0 1"/>'}, "motor on a ball joint, which is not supported"),
        ({"actuator": '<adhesion body="link" ctrlrange="0 1"/>'}, "is an <adhesion>: it acts by MuJoCo's contact forces"),
        ({"actuator": '<motor joint="j" gear="0"/>'}, "has gear or gain 0: it drives nothing"),
        (
            {"actuator": '<orientation joint="wrist" kp="1"/>'},
            "is an <orientation> servo, with three forces of one actuator",
        ),
    ],
)
def test_actuators_that_cannot_be_modelled_are_refused_with_their_line(tmp_path, parts, expected):
    with pytest.raises(InputError, match="actuator '") as refused:
        system(tmp_path, bus(**parts))
    line = refused.value.lines[0]
    assert line.startswith(f"{tmp_path}/bus.xml:6: actuator '")
    assert expected in line


@pytest.mark.parametrize("word", ["damping", "servos"])
def test_strip_removes_what_is_refused_of_actuators(tmp_path, word):
    actuator = '<adhesion body="link" ctrlrange="0 1"/>' if word == "servos" else '<motor joint="j" damping="0.5"/>'
    changes = {"robot.strip": [word]}
    model = prepare(scene(tmp_path, bus(actuator=actuator), {}), changes).system.mj
    assert model.nactuator == (word == "damping")
    assert not model.dof_damping.any()


def test_armature_of_a_joint_of_the_base_is_refused(tmp_path):
    """It is inertia against the world; that of a joint of the arm is a rotor."""
    default = '<default><joint armature="1"/></default>'
    base = bus(default + HEAD).replace('<freejoint name="free"/>', '<joint name="free" type="free"/>')
    with pytest.raises(InputError, match=r"bus\.xml:1: joint 'free' has armature 1, and joins the base to the world"):
        system(tmp_path, base)
    assert system(tmp_path, bus(joint='armature="1"')).mj.dof_armature.max() == 1.0


@pytest.mark.parametrize(
    ("flag", "parts"),
    [
        ("spring", {"joint": 'stiffness="1"'}),
        ("damper", {"joint": 'damping="1"'}),
        ("frictionloss", {"joint": 'frictionloss="1"'}),
        ("constraint", {"joint": 'frictionloss="1"'}),
        ("equality", {"equality": '<weld body1="bus" body2="link"/>'}),
        ("actuation", {"actuator": '<motor joint="j"/>'}),
        ("clampctrl", {"actuator": '<motor joint="j" ctrlrange="-1 1"/>'}),
    ],
)
def test_a_flag_that_changes_the_plant_is_refused(tmp_path, flag, parts):
    """A scene has flags of its own, and would switch the element on; without the element, the flag is of no consequence."""
    head = f'<option gravity="0 0 0"><flag {flag}="disable"/></option>'
    with pytest.raises(InputError, match=rf'bus\.xml:1: <flag {flag}="disable"> has no effect in a scene'):
        system(tmp_path, bus(head, **parts))
    assert not [note for note in system(tmp_path, bus(head)).notes if "joints stop" in note]


def test_disabled_groups_of_actuators_are_refused(tmp_path):
    head = '<option gravity="0 0 0" actuatorgroupdisable="3"/>'
    with pytest.raises(InputError, match=r"actuatorgroupdisable> has no effect in a scene; remove j_motor, or the option"):
        system(tmp_path, bus(head, actuator='<motor joint="j" group="3"/>'))
    assert system(tmp_path, bus(head, actuator='<motor joint="j"/>')).notes == ()


@pytest.mark.parametrize(
    ("option", "listed"),
    [
        ('cone="elliptic" iterations="3"', "cone, iterations"),
        ('timestep="1"', "timestep"),
        ('o_margin="1" integrator="Euler"', "o_margin, integrator"),
        ('integrator="RK4"', ""),
    ],
)
def test_settings_of_solvers_and_contacts_are_noted_once(tmp_path, option, listed):
    """What the scene has anyway, and memory, are not mentioned."""
    notes = system(tmp_path, bus(f'<option gravity="0 0 0" {option}/><size memory="10M"/>')).notes
    assert [note.rpartition(": ")[2] for note in notes] == [listed] * bool(listed)


def test_a_disabled_limit_is_noted(tmp_path):
    head = '<option gravity="0 0 0"><flag limit="disable"/></option>'
    (note,) = system(tmp_path, bus(head, joint='range="-1 1"')).notes
    assert '<flag limit="disable"> has no effect in a scene: joints stop at their limits' in note


def test_what_has_no_effect_is_no_reason_to_refuse(tmp_path):
    """Compensation of a gravity that is zero, a constraint that is inactive, lights and cameras that follow the world."""
    lights = '<light mode="targetbody" target="world"/><camera name="c" mode="targetbody" target="world"/>'
    weld = '<weld body1="bus" body2="hand" active="false"/>'
    compiled = system(tmp_path, bus(world=lights, equality=weld).replace('name="link"', 'name="link" gravcomp="1"'))
    (note,) = compiled.notes
    assert note.endswith(": gravcomp")
    assert compiled.mj.neq == 1
    assert not compiled.mj.eq_active0.any()


def test_a_urdf_is_known_by_its_root(tmp_path):
    """ROS files are often named .xml."""
    inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    link = f'<link name="hub"><inertial><mass value="1"/>{inertia}</inertial></link>'
    urdf = f'<?xml version="1.0"?><!-- a > b -->\n<robot name="r">{link}</robot>'
    robot = system(tmp_path, urdf).robot
    assert [joint.kind for joint in robot.joints] == ["free"]


def test_models_that_cannot_touch_are_noted_and_watched(tmp_path):
    """Files that keep their own parts from colliding by contype 1 and conaffinity 2 keep two satellites from it too."""
    geom = 'contype="1" conaffinity="2"'
    other = bus(geom=geom).replace('name="hand" size="0.05"', f'name="hand" size="0.05" {geom}')
    path = scene(tmp_path, other, {"other": other}, duration_s=0.3, initial={
        "joints": {"other/free": [1.5, 0, 0, 1, 0, 0, 0]}, "rates": {"other/free": [-10, 0, 0, 0, 0, 0]}})  # fmt: skip
    prepared = prepare(path)
    assert any("'robot' and 'other' cannot touch: contype and conaffinity" in note for note in prepared.notes())
    run = ffsm_mj.run(path, rerun=False)
    assert len(run.unhandled_contacts) > 0
    assert not any("cannot touch" in note for note in prepare(path, {"contacts.ignored": [
        {"between": ["robot", "other"], "reason": "they stay apart"}]}).notes())  # fmt: skip


def test_an_ambiguous_geom_is_said_to_be_ambiguous(tmp_path):
    path = scene(tmp_path, ball("hull"), {"other": ball("hull")}, contacts={"rules": [{"between": ["hull", "other"]}]})
    with pytest.raises(InputError, match=r"(body|geom) 'hull' is ambiguous; write one of robot/hull, other/hull"):
        prepare(path)
