"""``extends``: what a scenario takes from another one, and where its faults are said to stand."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from ruamel.yaml import YAML

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import InputError
from ffsm_mj.scenario.loading import load_scenario
from ffsm_mj.scenario.shipped import scenario_names, scenario_path
from ffsm_mj.scenario.source import MAX_EXTENDED
from tests.scenario import editor
from tests.scenes import two_balls

PARENT = """\
name: parent
description: the parent
duration_s: 1.0
robot: {mjcf: robot.xml}
objects: {target: {mjcf: target.xml}}
initial: {joints: {target/x: 0.5}}
actuators:
  robot/push_x: {kind: on_off, force_N: 50.0, threshold_N: 1.0}
contacts:
  rules:
    - {between: [ball, target/target]}
phases:
  - name: wait
    until: impact
    controller: {kind: pd, kp: 1.0, kd: 2.0}
  - name: coast
    for_s: 0.2
    controller: {kind: "off"}
  - name: hold
    until: end
    controller: {kind: pd, kp: 3.0, kd: 4.0}
"""


@pytest.fixture
def folder(tmp_path):
    """A parent in ``parent/`` with models beside it, for children one folder above."""
    (tmp_path / "parent").mkdir()
    two_balls(tmp_path / "parent")
    (tmp_path / "parent" / "parent.yaml").write_text(PARENT)
    return tmp_path


OFF = "phases: [{name: drift, until: end, controller: {kind: 'off'}}]\n"


def child(folder, text, extends="parent/parent.yaml"):
    path = folder / "child.yaml"
    path.write_text(f"extends: {extends}\nname: child\n{text}")
    return path


def faults(path, *overrides):
    with pytest.raises(InputError) as caught:
        prepare(path, overrides)
    return caught.value.lines


def test_a_child_is_its_parent_with_changes(folder):
    scenario, _ = load_scenario(child(folder, "duration_s: 2.0\nactuators: {robot/push_x: {threshold_N: 2.0}}\n"))
    parent, _ = load_scenario(folder / "parent" / "parent.yaml")
    assert (scenario.name, scenario.description, scenario.duration_s) == ("child", "", 2.0)
    assert scenario.actuators["robot/push_x"].model_dump(exclude_defaults=True) == {
        "kind": "on_off",
        "force_N": 50.0,
        "threshold_N": 2.0,
    }
    own = {"name", "description", "duration_s", "actuators"}
    assert scenario.model_dump(exclude=own) == parent.model_dump(exclude=own)


def test_null_takes_away_and_another_kind_replaces(folder):
    scenario, _ = load_scenario(child(folder, "actuators: {robot/push_x: null}\n"))
    assert scenario.actuators == {}
    scenario, _ = load_scenario(child(folder, "actuators: {robot/push_x: {kind: ideal}}\n"))
    assert scenario.actuators["robot/push_x"].model_dump() == {"kind": "ideal", "delay_s": None}


def test_phases_start_from_those_of_the_same_name(folder):
    rest = "{name: rest, for_s: 0.1, controller: {kind: 'off'}}"
    text = f"phases:\n- name: wait\n- {rest}\n- name: hold\n  controller: {{kp: 9.0}}\n"
    scenario, _ = load_scenario(child(folder, text))
    assert [phase.name for phase in scenario.phases] == ["wait", "rest", "hold"]
    assert scenario.phases[0].until == "impact"
    hold = scenario.phases[2].controller
    assert (hold.kp, hold.kd, scenario.phases[2].until) == (9.0, 4.0, "end")


def test_the_end_of_a_phase_is_changed_by_taking_the_other_away(folder):
    phases = "phases:\n- name: wait\n- name: coast\n  until: end\n"
    (line,) = faults(child(folder, phases))
    assert line == f"{folder}/child.yaml:5:3: phases.1: 'for_s' has no effect with 'until: end'; leave one of them out"
    scenario, _ = load_scenario(child(folder, phases + "  for_s: null\n"))
    assert scenario.phases[1].until == "end"


def test_faults_stand_where_they_are_written(folder):
    parent = folder / "parent" / "parent.yaml"
    parent.write_text(PARENT.replace("kd: 2.0", "kd: -2.0").replace("threshold_N: 1.0", "threshold: 1.0"))
    lines = faults(child(folder, "log: {rerun: 1}\n"))
    places = {line.split(": ")[1]: line.split(": ")[0] for line in lines}
    assert places["phases.0.controller.kd"] == f"{parent}:15:37"
    assert places["actuators.robot/push_x.threshold"] == f"{parent}:8:47"
    assert places["log.rerun"] == f"{folder}/child.yaml:3:7"


def test_a_phase_that_the_parent_does_not_have_must_be_whole(folder):
    (line,) = faults(child(folder, "phases:\n- name: hodl\n  until: end\n- name: hold\n"))
    assert line.startswith(
        f"{folder}/child.yaml:4:3: phases.0: a phase needs 'controller: {{kind: ...}}', or 'controllers: "
    )


def test_models_lie_beside_the_file_that_states_them(folder):
    (folder / "target.xml").write_text((folder / "parent" / "target.xml").read_text())
    prepared = prepare(child(folder, OFF + "objects: {target: {mjcf: target.xml}}\n"))
    assert [files.place for files in prepared.system.files.values()] == [
        f"{folder}/parent/robot.xml",
        f"{folder}/target.xml",
    ]
    (line,) = faults(folder / "child.yaml", "robot.mjcf=robot.xml")
    assert line == f"overrides: robot.mjcf=robot.xml: robot.mjcf: no such model file {folder}/robot.xml"
    (folder / "parent" / "robot.xml").unlink()
    (line,) = faults(folder / "child.yaml")
    assert line == f"{folder}/parent/parent.yaml:4:9: robot.mjcf: no such model file {folder}/parent/robot.xml"


@pytest.mark.parametrize(
    ("extends", "expected"),
    [
        ("nowhere.yaml", "extends: no such scenario file: {folder}/nowhere.yaml"),
        ("./parent", "extends: no such scenario file: {folder}/parent"),
        ("basline", "extends: unknown shipped scenario 'basline' (did you mean 'baseline'?); allowed: baseline, "),
        ("3", "extends: should be a scenario file, relative to this one, or the name of a shipped scenario"),
        ("child.yaml", "extends: is circular: child.yaml -> child.yaml"),
    ],
)
def test_parents_that_are_not_there(folder, extends, expected):
    (line,) = faults(child(folder, "", extends))
    assert line.startswith(f"{folder}/child.yaml:1:1: " + expected.format(folder=folder))


def test_circles_and_towers(folder):
    (folder / "other.yaml").write_text("extends: child.yaml\nname: other\n")
    (line,) = faults(child(folder, "", "other.yaml"))
    assert line == f"{folder}/other.yaml:1:1: extends: is circular: child.yaml -> other.yaml -> child.yaml"
    for i in range(MAX_EXTENDED + 1):
        (folder / f"{i}.yaml").write_text(f"extends: {f'{i - 1}.yaml' if i else 'parent/parent.yaml'}\nname: n{i}\n")
    load_scenario(folder / f"{MAX_EXTENDED - 2}.yaml")
    (line,) = faults(folder / f"{MAX_EXTENDED - 1}.yaml")
    assert (
        line == f"{folder}/0.yaml:1:1: extends: more than {MAX_EXTENDED} scenarios extend one another; "
        f"allowed: at most {MAX_EXTENDED}"
    )


def test_a_parent_that_is_no_yaml_is_named(folder):
    (folder / "parent" / "parent.yaml").write_text("name: [1\n")
    (line,) = faults(child(folder, ""))
    assert line.startswith(f"{folder}/parent/parent.yaml:")


def test_extends_cannot_be_overridden(folder):
    (line,) = faults(child(folder, ""), "extends=baseline")
    assert line == "overrides: extends=baseline: extends: can only stand in a scenario file"


def test_the_run_folder_needs_no_parent(folder, tmp_path):
    run = ffsm_mj.run(child(folder, OFF + "duration_s: 0.01\n"), out=tmp_path / "out", rerun=False)
    text = (tmp_path / "out" / "scenario.yaml").read_text()
    assert "extends" not in text
    assert load_scenario(tmp_path / "out" / "scenario.yaml")[0].phases == load_scenario(folder / "child.yaml")[0].phases
    assert run.name == "child"


@pytest.mark.long(one_of=5)
@pytest.mark.parametrize("name", scenario_names())
def test_editors_accept_the_shipped_files_as_they_stand(name):
    editor.check(json.loads(json.dumps(YAML(typ="safe").load(scenario_path(name)))))


@pytest.mark.parametrize(
    "change",
    [
        {"durations_s": 1.0},
        {"phases": [{"for_s": 1.0}]},
        {"phases": [{"name": "approach", "controller": {"kind": "osdre", "S": 1}}]},
        {"actuators": {"wheel": {"stall": 1.0}}},
        {"contacts": {"rules": [{"restitution": 0.5}]}},
        {"name": None},
    ],
)
def test_editors_refuse_what_is_wrong_in_a_child(change):
    with pytest.raises(editor.ValidationError):
        editor.check({"extends": "baseline", "name": "x"} | change)


def test_the_example_of_the_user_guide(tmp_path):
    page = (Path(__file__).parents[2] / "docs" / "scenario-file.md").read_text()
    path = tmp_path / "heavier-hit.yaml"
    path.write_text(re.search(r"```yaml\n(extends.*?)```", page, flags=re.DOTALL).group(1))
    scenario = prepare(path).scenario
    assert [phase.name for phase in scenario.phases] == ["approach", "safety_pause", "regulate"]
    assert scenario.phases[1].for_s == 4.0
    assert "thruster_x" not in scenario.actuators


def test_another_kind_by_an_override_replaces_the_mapping(folder):
    """As in a file: the keys of the former kind are gone, and overrides of the new one apply in any order."""
    file = child(folder, "")
    kind, gain = "phases.hold.controller.kind=off", "phases.hold.controller.kp=5.0"
    assert load_scenario(file, [kind])[0].phases[2].controller.kind == "off"
    same = load_scenario(file, ["phases.hold.controller.kind=pd", gain])[0].phases[2].controller
    assert (same.kp, same.kd) == (5.0, 4.0)
    for order in ([kind, gain], [gain, kind]):
        (line,) = faults(file, *order)
        assert line.startswith(f"overrides: {gain}: phases.2.controller.kp: unknown key")


def test_what_another_kind_misses_is_a_fault_of_its_override(folder):
    lines = faults(child(folder, OFF), "phases.0.controller.kind=pd")
    assert lines
    assert all(line.startswith("overrides: phases.0.controller.kind=pd: phases.0.controller.") for line in lines)
