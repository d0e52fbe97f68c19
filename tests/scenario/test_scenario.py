"""Bad input: one clear line each, with the place and what is allowed. Good input: typed, frozen, repeatable."""

from __future__ import annotations

import json
import math
from copy import deepcopy
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import Fault, InputError
from ffsm_mj.model.system import System
from ffsm_mj.scenario.loading import load_scenario
from ffsm_mj.scenario.scenario import ScenarioConfig
from ffsm_mj.scenario.schema import scenario_schema
from ffsm_mj.scenario.shipped import scenario_names, scenario_path, scenarios_dir
from ffsm_mj.scenario.source import read_yaml
from ffsm_mj.yaml import parse, plain_value, write_flow, write_yaml
from tests.conftest import MJCF
from tests.scenario import editor
from tests.scenes import ball, scene, two_balls

BASELINE = scenario_path("baseline")


def faults(*overrides, path=BASELINE):
    """Lines of the error that a scenario with these overrides makes."""
    with pytest.raises(InputError) as caught:
        prepare(path, overrides)
    return caught.value.lines


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("foo=1", "foo: unknown key; allowed: robot, log, model, "),
        ("phases.0.controller.zz=1", "unknown key; allowed: joints, kind, null_space_damping, parameterization, Q, R"),
        ("actuators.motor_1.kk=1", "unknown key; allowed: delay_s, kind, no_load_speed_rad_s, stall_torque_N_m"),
        ("duration_s='3'", 'duration_s: should be a valid number, got "3"'),
        ("duration_s=true", "duration_s: should be a valid number, got true"),
        ("task.target_m=[1, .nan]", "task.target_m.1: should be a finite number"),
        ("time_step_s=-0.001", "time_step_s: should be greater than 0"),
        ("time_step_s=1e-3x", "time_step_s: should be a valid number"),
        ("duration_s=.inf", "duration_s: should be a finite number"),
        ("control_period_s=0.0015", "must be a multiple of time_step_s (0.001 s); the nearest is 0.002"),
        ("duration_s=1.0005", "must be a multiple of control_period_s (0.001 s)"),
        (
            "initial={form: run, at_s: 1}",
            "initial.form: unknown key (did you mean 'from'?); allowed: activations, at_s, frame, from, joints, rates",
        ),
        ("initial.joints.joint_9=1", "unknown joint 'joint_9' (did you mean 'robot/joint_3'?); allowed: object/x"),
        ("initial.joints.base_x=[1, 2]", "slide joint robot/base_x takes 1 number, got 2"),
        ("initial.joints.base_x=abc", 'initial.joints.base_x: should be a valid number, got "abc"'),
        ("task.tip=tup", "unknown site 'tup' (did you mean 'robot/tip'?); allowed: robot/tip"),
        ("task.axes=[x, x]", "axes must be different"),
        ("contacts.rules.0.between=[griper, box]", "unknown model, body or geom 'griper' (did you mean 'robot/gripper'?)"),
        ("contacts.rules.0.between=[box, box]", "contacts.rules.0.between: names one geom twice"),
        ("contacts.rules.0.between=[self, self]", "'self' needs a model on the other side, such as [robot, self]"),
        ("contacts.rules.0.between=[robot]", "contacts.rules.0.between: should have at least 2 items, not 1"),
        ("contacts.default.restitution=1.5", "contacts.default.restitution: should be less than or equal to 1"),
        ("contacts.rules.0.restitution=1.5", "restitution must be in [0, 1]; above 1 only with 'super_elastic: true'"),
        ("contacts.ignored.0.between=[robot, nobody]", "contacts.ignored.0.between.1: unknown model, body or geom 'nobody'"),
        ("actuators.motor_9={kind: ideal}", "unknown actuator 'motor_9'"),
        ("phases.0.controller.kind=mpc", "unknown kind 'mpc'; allowed: base_pd, detumble, free_flying, "),
        ("phases.0.controller={}", "needs a 'kind'"),
        ("phases.0.controller.joints=[joint_1, elbow]", "phases.0.controller.joints.1: unknown joint of the robot 'elbow'"),
        ("phases.0.controller.joints=[joint_1]", "2 outputs need at least 2 joints, there are 1"),
        ("phases.0.controller.Q=[0, 1, 1, 1]", "its position block must be regular"),
        ("phases.0.controller.Q=[1, 1, 1, -1]", "must be positive semidefinite"),
        ("phases.0.controller.Q=[1, 1, 1]", "must be 4 numbers (a diagonal) or 4 rows of 4"),
        ("phases.0.controller.R=[1, 0, 1]", "must be positive definite; its smallest eigenvalue is 0"),
        (
            "phases.0.controller.kind=osdr",
            "unknown kind 'osdr' (did you mean 'osdre'?); allowed: base_pd, detumble, free_flying, ",
        ),
        (
            "actuators.motor_1.kind=torque-speed",
            "unknown kind 'torque-speed' (did you mean 'torque_speed'?); allowed: ideal, ",
        ),
        ("phases.0.until=null", "a phase needs 'until' (impact, settled, end, ...) or 'for_s', or an event and 'for_s'"),
        (
            "phases.0.until=settled",
            "phases.0: 'until: settled' needs 'settled: {error_m: ..., speed_m_s: ..., for_s: ...}'",
        ),
        ("phases.0.settled={error_m: 1, speed_m_s: 1, for_s: 1}", "'settled' has no effect without 'until: settled'"),
        ("phases.0.settled={error_m: 1, speed_m_s: 0, for_s: 1}", "phases.0.settled.speed_m_s: should be greater than 0"),
        ("phases.0.settled={error_m: 1, for_s: 1}", "phases.0.settled.speed_m_s: is missing"),
        ("phases.0.until=settle", "unknown end of a phase 'settle' (did you mean 'settled'?); allowed: contact_begins, "),
        ("phases.2.for_s=1", "'for_s' has no effect with 'until: end'; leave one of them out"),
        ("robot.mjcf=nothing.xml", "no such model file"),
        ("objects.robot={mjcf: ../mjcf/box_1m.xml}", "this name is taken"),
        ("no_equals_sign", "an override is written key=value"),
        ("phases.9.name=x", "phases is a list of 3: its positions are 0 to 2"),
        ("duration_s=[", "in the value: malformed YAML: "),
        ("duration=3", "duration: unknown key (did you mean 'duration_s'?)"),
        ("phases.2.name=approach", "another phase has the name 'approach'"),
        ("contacts.rules=[]", "phases.0.until: no impact can end it: no two geoms have a contact rule"),
        ("contacts.ignored.0.between=[gripper, box]", "no effect: every pair that it names is in contacts.ignored"),
        ("phases.0.controller.joints=[]", "must contain at least one joint, or be left out"),
        (
            "phases.1.controller={kind: pd, kp: -1, kd: 1}",
            "phases.1.controller.kp: should be greater than or equal to 0, got -1",
        ),
        ("initial.rates.joint_1=1e300", "must stay below 1e+10"),
        ("objects=3", "objects: should be a mapping of keys, got 3"),
        (
            "sensors={camera: kind:framepos}",
            'sensors.camera: should be a mapping of keys, got "kind:framepos" (a space follows the colon of a key); ',
        ),
        ("task=3", "task: should be a mapping of keys, got 3; allowed: "),
        ("phases=[]", "phases: should have at least 1 item"),
        ("robot.mjcf=.", "is a folder, not a model file"),
        ("phases.²=3", "phases is a list of 3: its positions are 0 to 2"),
        ("phases.0.controller.joints=!!int x", "in the value: !!int stands before 'x', which is none; leave the tag out"),
        ('duration_s=!!int ""', "!!int stands before ''"),
        ("stop_on_impact=!!bool maybe", "!!bool stands before 'maybe'"),
        ("duration_s=0x_", 'duration_s: should be a valid number, got "0x_"'),
        ("duration_s=1:2:3", 'duration_s: should be a valid number, got "1:2:3"'),
        ("duration_s=2001-02-30", 'duration_s: should be a valid number, got "2001-02-30"'),
        ("name=!!python/name:os.system", "the tag !!python/name:os.system means nothing here; leave it out"),
        ("phases=[" + "[" * 3000, "in the value: more than 32 lists and mappings inside one another"),
        ("phases=&a [*a]", "the alias *a stands inside of what it stands for"),
        ("task=*nowhere", "the alias *nowhere stands for nothing"),
        ("initial.joints={1: 2}", "a key must be a text, this is 1; write it in quotes"),
        ("initial.joints={[1]: 2}", "a key must be a text, this is a list"),
        ("initial.joints={<<: 3}", "'<<' takes a mapping, or a list of mappings, to merge in"),
        ("impact.max_impacts=" + "1" * 5000, "a number of 5000 digits; at most 300 are read"),
        ("duration_s=1e300", "is 1e+303 times control_period_s (0.001 s); at most 5e+08 times"),
        ("time_step_s=5e-324", "control_period_s: is inf times time_step_s (4.94066e-324 s)"),
        (".".join("a" * 40) + "=1", "the key has 40 parts; a scenario is at most 32 deep"),
        (r'name="\UFFFFFFFF"', "in the value: malformed YAML"),
    ],
)
def test_one_clear_line(override, expected):
    (line,) = faults(override)
    assert line.startswith(("overrides: " + override, str(BASELINE)))
    assert expected in line


def test_an_override_is_shown_on_one_line():
    """Line ends, colours of a terminal and bytes that are no UTF-8 are escaped."""
    (line,) = faults("dura\ntion_s=\x1b[31m\udcff")
    assert line.startswith(r"overrides: dura\ntion_s=\x1b[31m\udcff: ")


def test_faults_of_a_file_name_line_and_column(tmp_path):
    text = BASELINE.read_text().replace("../mjcf", str(MJCF)).replace("time_step_s: 0.001", "time_stop_s: 0.001")
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    number = text.splitlines().index("time_stop_s: 0.001") + 1
    (line,) = faults(path=path)
    assert line.startswith(f"{path}:{number}:1: time_stop_s: unknown key (did you mean 'time_step_s'?); allowed: ")


def test_a_rule_that_a_later_one_takes_everything_from_is_refused():
    (line,) = faults("contacts.rules=[{between: [gripper, box]}, {between: [robot, object], name: all}]")
    assert "contacts.rules.0: has no effect: every pair that it names is in later rules, which win" in line


def test_joints_that_look_like_numbers_can_be_overridden():
    (line,) = faults("initial.joints.2=0.5")
    assert "unknown joint '2'" in line


def test_overlap_at_the_start():
    (line,) = faults("initial.joints.object/x=7.2", "initial.joints.object/y=1.2")
    assert "contacts.rules.0: robot/gripper and object/box overlap by 0.201 m at the start" in line


def test_every_fault_has_a_line():
    assert len(faults("duration_s=-1", "task.tip=3", "log.rerun=1")) == 3


def _aliases_of_aliases() -> str:
    """Ten to the tenth values in twelve lines."""
    return "".join(f"{b}: &{b} [{', '.join([f'*{a}'] * 10)}]\n" for a, b in pairwise("abcdefghij"))


@pytest.mark.long
@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("name: x\nduration_s: [1\n", ":3:1: malformed YAML"),
        ("name: x\nname: y\n", ":2:1: the key 'name' stands twice in one mapping; first in line 1"),
        ("- 1\n", ":1:1: a scenario is a mapping"),
        ("", ":1:1: a scenario is a mapping"),
        ("name: \xe4\n".encode("latin-1"), ":1:7: is not UTF-8: byte 0xe4"),
        ("a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + _aliases_of_aliases(), "; at most 20000 are read"),
        (
            "a: &a []\n" + "".join(f"k{i}: &{'ba'[i % 2]} [*{'ab'[i % 2]}]\n" for i in range(40)),
            ":32:10: more than 32 lists and mappings",
        ),
        ("a: [" + "1," * 50_000 + "]", ": more than 20000 values"),
        ("a: " + "x" * 300_000, ":1:1: 300003 characters; at most 262144 are read"),
        ("a: [" + "[" * 5000, ":1:35: more than 32 lists and mappings inside one another"),
        ("a: 1\nb: \0\n", ":2:4: malformed YAML: the character 0x0000 is not allowed"),
        ("a: 1\n---\nb: 1\n", ":2:1: a second document begins here; a file holds one"),
        ("? [a, b]\n: 1\n", ":1:3: a key must be a text, this is a list"),
        ("a: 1\n~: 1\n", ":2:1: a key must be a text, this is nothing"),
        ("a: !!set {b}\n", ":1:4: the tag !!set means nothing here"),
        ("a: !!timestamp 2001-99-99\n", ":1:4: the tag !!timestamp means nothing here"),
        ("%YAML 9.9\n---\na: 1\n", ":1:1: malformed YAML"),
    ],
)
def test_malformed_yaml(tmp_path, text, expected):
    path = tmp_path / "bad.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    (line,) = faults(path=path)
    assert line.startswith(str(path))
    assert expected in line


def test_a_byte_order_mark_is_no_part_of_the_first_key(tmp_path):
    path = tmp_path / "marked.yaml"
    path.write_bytes(b"\xef\xbb\xbf" + BASELINE.read_bytes().replace(b"../mjcf", str(MJCF).encode()))
    assert load_scenario(path)[0].name == "baseline"


def test_merged_keys_and_aliases(tmp_path):
    """A key of the mapping itself comes before a merged one, the first merged mapping before the second."""
    path = tmp_path / "merged.yaml"
    path.write_text("a: &a {x: 1, y: 1}\nb: &b {y: 2, z: 2}\nc:\n  <<: [*a, *b]\n  x: 0\nd: *a\ne: {<<: *b}\n")
    source = read_yaml(path)
    assert source.data["c"] == {"x": 0, "y": 1, "z": 2}
    assert source.data["d"] == {"x": 1, "y": 1}
    assert source.data["e"] == {"y": 2, "z": 2}
    assert source.line(Fault("here", ("c", "z"))).startswith(f"{path}:4:3: c.z: ")


def test_a_text_is_parsed_once_and_what_is_made_of_it_is_one_s_own(tmp_path):
    """The same text of the same file is the same tree; another text or file is not, and data of one is no other's."""
    path = tmp_path / "some.yaml"
    path.write_text("a: [1, 2]\n")
    first = read_yaml(path)
    first.data["a"].append(3)
    assert parse("a: [1, 2]\n", path) is parse("a: [1, 2]\n", path)
    assert read_yaml(path).data == {"a": [1, 2]}
    path.write_text("a: [1, 4]\n")
    assert read_yaml(path).data == {"a": [1, 4]}
    assert parse("a: [1, 2]\n", tmp_path / "other.yaml").find(("a",)).place.path == tmp_path / "other.yaml"


@pytest.mark.parametrize(
    ("text", "value"),
    [
        *(("1", 1), ("-0", 0), ("0o17", 15), ("0x1F", 31), ("1.", 1.0), (".5", 0.5), ("1e3", 1000.0), ("-.inf", -math.inf)),
        *(("~", None), ("Null", None), ("TRUE", True), ("false", False), ("no", "no"), ("0b1", "0b1"), ("1_000", "1_000")),
        *(("'1'", "1"), ("! 1", "1"), ("!!str 1", "1"), ("!!float 1", 1.0), ("!!int '7'", 7), ("2001-01-01", "2001-01-01")),
    ],
)
def test_scalars_are_those_of_the_core_schema(text, value):
    found = plain_value(text)
    assert (found, type(found)) == (value, type(value))


def test_missing_scenario():
    with pytest.raises(InputError, match=r"x\.yaml: cannot be read \(File name too long"):
        scenario_path("x" * 300 + ".yaml")
    with pytest.raises(InputError, match=r"unknown shipped scenario 'basline' \(did you mean 'baseline'"):
        scenario_path("basline")
    with pytest.raises(InputError, match=r"is a folder without a scenario\.yaml"):
        scenario_path(MJCF)
    with pytest.raises(InputError, match="no such scenario file"):
        scenario_path("nowhere/mine.yaml")


def replaced(tmp_path, old, new):
    """Faults of the baseline with its box's MJCF changed."""
    text = (MJCF / "box_1m.xml").read_text()
    assert old in text
    (tmp_path / "box.xml").write_text(text.replace(old, new))
    return faults(f"objects.object.mjcf={tmp_path / 'box.xml'}")


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('axis="1 0 0"', 'axis="1 0 0" damping="0.5"', "box.xml:8: joint 'x' has damping 0.5"),
        ('axis="1 0 0"', 'axis="1 0 0" frictionloss="0.5"', "joint 'x' has frictionloss 0.5"),
        ('axis="1 0 0"', 'axis="1 0 0" stiffness="2"', "joint 'x' has stiffness 2"),
        ('mass="5"', 'mass="-5"', "mass and inertia of moving bodies must be larger than mjMINVAL"),
        ('type="slide"', 'type="slode"', "invalid keyword"),
        ("</worldbody>", "", "XML"),
        (
            "</worldbody>",
            "<body name='b'><freejoint/><geom size='1'/></body></worldbody>",
            "one tree of moving bodies",
        ),
    ],
)
def test_models_that_cannot_be_used(tmp_path, old, new, expected):
    lines = replaced(tmp_path, old, new)
    assert len(lines) == 1
    assert str(tmp_path / "box.xml") in lines[0]
    assert expected in lines[0]


def test_options_of_simulator_and_surroundings_change_nothing(tmp_path):
    """The compiled scene is that of the file without them, and one note lists them."""
    plain = (MJCF / "box_1m.xml").read_text()
    given = 'gravity="0 0 -9.81" density="1.2" timestep="0.5" cone="elliptic" integrator="Euler" impratio="3"'
    found: list[System] = []
    for text in (plain, plain.replace('gravity="0 0 0" integrator="RK4"', given).replace("<geom ", '<geom condim="4" ')):
        (tmp_path / "box.xml").write_text(text)
        found.append(prepare(BASELINE, [f"objects.object.mjcf={tmp_path / 'box.xml'}"]).system)
    assert found[1].faults == ()
    (note,) = set(found[1].notes) - set(found[0].notes)
    assert note.startswith(f"{tmp_path / 'box.xml'}: left out, ")
    assert note.endswith("gravity 0 0 -9.81, timestep, impratio, density, integrator, cone, condim of geoms")
    for name in ("gravity", "density", "timestep", "cone", "integrator", "impratio"):
        assert np.array_equal(*(getattr(each.mj.opt, name) for each in found))


def test_dissipation_is_allowed_only_by_name(tmp_path):
    text = (MJCF / "box_1m.xml").read_text().replace('axis="1 0 0"', 'axis="1 0 0" damping="0.5"')
    (tmp_path / "box.xml").write_text(text)
    path = [f"objects.object.mjcf={tmp_path / 'box.xml'}", "conservative=false"]
    assert len(prepare(BASELINE, path).system.faults) == 1


def test_a_robot_without_motors_names_the_cure(tmp_path):
    path = scene(tmp_path, ball(), {}, task={"tip": "centre", "target_m": [0, 0, 0]})
    (line,) = faults('phases.0.controller={"kind": "pd", "kp": 1.0, "kd": 1.0}', path=path)
    assert "the robot has no motor-driven joint; add <motor joint=.../> to its MJCF" in line


@pytest.mark.long(one_of=5)
@pytest.mark.parametrize("name", scenario_names())
def test_shipped_scenarios_are_valid_and_point_to_the_schema(name):
    path = scenario_path(name)
    assert path.read_text().startswith("# yaml-language-server: $schema=ffsm.schema.json\n")
    scenario, source = load_scenario(path)
    assert scenario.name == name
    assert scenario.description
    editor.check(source.data)
    prepare(path)


def test_committed_schema_is_current():
    assert json.loads((scenarios_dir() / "ffsm.schema.json").read_text()) == scenario_schema()


def test_schema_describes_units_and_refuses_unknown_keys():
    schema = scenario_schema()
    assert schema["$defs"]["Scenario"]["properties"]["time_step_s"]["description"] == "Integration step of RK4, s."
    with pytest.raises(editor.ValidationError):
        editor.check(read_yaml(BASELINE, ["foo=1"]).data)


def test_scenarios_are_frozen():
    scenario, _ = load_scenario(BASELINE)
    with pytest.raises(ValidationError):
        scenario.duration_s = 1.0  # type: ignore[misc]


def test_yaml_round_trip(tmp_path):
    scenario, source = load_scenario(BASELINE)
    (tmp_path / "again.yaml").write_text(write_yaml(source.data))
    again, _ = load_scenario(tmp_path / "again.yaml")
    assert again == scenario
    assert ScenarioConfig.model_validate(source.data) == scenario


@pytest.mark.parametrize(
    ("element", "words"),
    [
        ('<actuator><motor name="m" joint="J-q"/></actuator>', "J-q"),
        ('<equality><weld body1="typo" body2="ball"/></equality>', "typo"),
        ('<tendon><fixed name="t"><joint joint="J-zz" coef="1"/></fixed></tendon>', "J-zz"),
        ('<contact><exclude body1="nobody" body2="ball"/></contact>', "nobody"),
    ],
)
def test_a_model_that_refers_to_nothing_is_refused(tmp_path, element, words):
    """Attached to the scene such elements vanish without a word: a motor less, and everything holds."""
    path = two_balls(tmp_path)
    robot = tmp_path / "robot.xml"
    robot.write_text(robot.read_text().replace("</mujoco>", f"{element}</mujoco>"))
    with pytest.raises(InputError, match=words) as caught:
        prepare(path)
    (line,) = caught.value.lines
    assert line.startswith(f"{robot}: ")


@pytest.mark.parametrize(
    ("name", "words"), [("robot.xml", "is a model, not a scenario"), ("run.mcap", "is the log of a run")]
)
def test_a_file_of_another_kind_is_told(tmp_path, name, words):
    two_balls(tmp_path)
    (tmp_path / "run.mcap").touch()
    with pytest.raises(InputError, match=words):
        prepare(tmp_path / name)


def test_an_override_leaves_the_data_of_its_source_alone(tmp_path):
    """A campaign makes all its sources from one."""
    base = read_yaml(two_balls(tmp_path))
    before = deepcopy(base.data)
    changed = base.overridden(["contacts.rules.0.restitution=0.5", "initial.rates.robot/x=2", "model.robot.ball.mass_kg=3"])
    assert changed.data["contacts"]["rules"][0]["restitution"] == 0.5
    assert changed.data["model"] == {"robot": {"ball": {"mass_kg": 3}}}
    assert base.data == before


@pytest.mark.parametrize(
    "text", ["1", "-1", "007", "1.5", "-0.0", "1e5", "1e-07", "2.5e+300", "1e999", "123456789012345678"]
)
def test_a_plain_number_is_what_yaml_makes_of_it(text):
    number, composed = plain_value(text), parse(text, Path()).plain()
    assert (repr(number), type(number)) == (repr(composed), type(composed))


@pytest.mark.parametrize("value", [{"a": "b: c", "d": None}, "off", "1_000", [True, -1e-9, [3, "x, y"]], "", "a\nb" * 99])
def test_a_value_on_one_line_is_read_as_it_was(value):
    """A text with a colon, or one that reads like another value, has quotes."""
    text = write_flow(value)
    assert "\n" not in text
    assert plain_value(text) == value
