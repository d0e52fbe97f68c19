"""Contact rules of a scenario: sides, the last rule that wins, names, changes by name, and what is said of them."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.cli.main import main
from ffsm_mj.errors import InputError
from ffsm_mj.scenario.schema import scenario_schema
from tests.scenes import ARM, CHAIN, self_hit, three_balls


def test_links_that_always_overlap_are_refused_at_the_start(tmp_path):
    (line,) = refused(self_hit(tmp_path, pair=("upper", "round")))
    assert "contacts.rules.0.between: geoms 'robot/upper' and 'robot/round' are on one rigid body" in line
    arm = ARM.replace('<geom name="round" size="0.04"', '<geom name="round" size="0.06"')
    (tmp_path / "robot.xml").write_text(arm)
    (tmp_path / "scene.yaml").write_text(
        (tmp_path / "scene.yaml").read_text().replace('"upper", "round"', '"hull", "round"')
    )
    (line,) = refused(tmp_path / "scene.yaml")
    assert "contacts.rules.0: robot/hull and robot/round overlap by 0.01 m at the start; move one of them" in line


def refused(path, *overrides):
    with pytest.raises(InputError) as error:
        prepare(path, overrides)
    return error.value.lines


@pytest.mark.parametrize(
    ("pair", "expected"),
    [
        (
            {"between": ["tip", "finger"]},
            "rules.0.between: geoms 'robot/tip' and 'robot/finger' are on one rigid body",
        ),
        ({"between": ["tip", "tip"]}, "contacts.rules.0.between: names one geom twice"),
        ({"between": ["tip", "wall"]}, "contacts.rules.0.between: geom 'robot/wall' is fixed to the world"),
        ({"between": ["tip", "hul"]}, "contacts.rules.0.between.1: unknown model, body or geom 'hul' (did you mean"),
        ({"between": ["tip"]}, "contacts.rules.0.between: "),
        ({"between": ["tip", "hull", "rock"]}, "contacts.rules.0.between: "),
        ({"restitution": 0.5}, "contacts.rules.0.between: is missing"),
        (
            {"between": ["upper", "robot/lower/*"]},
            "rules.0.between: names no two geoms that can collide: MuJoCo's filters exclude those of one body",
        ),
        ({"between": ["wall", "rock"]}, "contacts.rules.0.between: no geom of 'wall' can collide with anything"),
        ({"between": ["tip/*", "rock"]}, "contacts.rules.0.between.0: unknown model, body or geom 'tip/*'"),
        ({"between": ["tip", "hull"], "name": "3"}, "the name '3' would be ambiguous with a position in the list"),
        ({"between": ["tip", "hull"], "name": ""}, "contacts.rules.0.name: "),
    ],
)
def test_pairs_that_are_none(tmp_path, pair, expected):
    path = self_hit(tmp_path, contacts={"rules": [pair]})
    wall = '<worldbody><geom name="wall" size="0.1" pos="0 -5 0"/>'
    (tmp_path / "robot.xml").write_text(ARM.replace("<worldbody>", wall))
    (line,) = refused(path)
    assert line.startswith(f"{path}:1:")
    assert expected in line


def test_names_are_unique(tmp_path):
    """Two different pairs under one name, given or not; and one pair twice, either way round."""
    named = [{"between": ["ball", "left/left"], "name": "behind"}, CHAIN[1]]
    (line,) = refused(three_balls(tmp_path, named))
    assert "contacts.rules.1.name: another rule or pair has the name 'behind'; give this rule a name of its own" in line
    taken = [CHAIN[0], CHAIN[1] | {"name": "ball-left/left"}]
    (line,) = refused(three_balls(tmp_path, taken))
    assert "contacts.rules.1.name: " in line
    (line,) = refused(three_balls(tmp_path, [CHAIN[0], {"between": ["left/left", "ball"]}]))
    assert "contacts.rules.0: has no effect: every pair that it names is in later rules, which win" in line


def test_overrides_by_name(tmp_path):
    path = three_balls(tmp_path, [CHAIN[0], CHAIN[1] | {"name": "far.behind"}])
    keys = ["contacts.rules.ball-left/left.restitution=0.5", "contacts.rules.far.behind.restitution=0.25"]
    changed = prepare(path, [*keys, "phases.coast.name=fly"]).scenario
    assert [rule.restitution for rule in changed.contacts.rules] == [0.5, 0.25]
    assert changed.phases[0].name == "fly"
    renamed = prepare(path, ["contacts.rules.0.name=first", "contacts.rules.first={between: [ball, right/right]}"]).scenario
    assert renamed.contacts.rules[0].name == "ball-right/right"
    for wrong in ("contacts.rules.nobody.restitution=0.5", "contacts.rules.2.restitution=0.5", "contacts.rules.far=1"):
        (line,) = refused(path, wrong)
        meant = " (did you mean 'far.behind'?)" * wrong.startswith("contacts.rules.far")
        assert line == (
            f"overrides: {wrong}: contacts.rules is a list of 2{meant}: "
            "its positions are 0 to 1, its names ball-left/left, far.behind"
        )
    (line,) = refused(path, "contacts.rules.far.behind.restitution=-1")
    assert line.startswith("overrides: contacts.rules.far.behind.restitution=-1: contacts.rules.1.restitution: ")


def test_a_child_changes_a_pair_by_its_name(tmp_path):
    three_balls(tmp_path, CHAIN)
    child = tmp_path / "child.yaml"
    text = "extends: scene.yaml\nname: child\ncontacts:\n  rules:\n"
    child.write_text(text + "  - {name: behind, restitution: 0.1}\n  - {name: ball-left/left, super_elastic: true}\n")
    first, second = prepare(child).scenario.contacts.rules
    assert (first.between, first.restitution) == (("left/left", "right/right"), 0.1)
    assert (second.between, second.restitution, second.super_elastic) == (("ball", "left/left"), 0.8, True)


@pytest.mark.parametrize(
    ("rule", "whole", "child"),
    [
        ({"between": ["a", "b"]}, True, True),
        ({"between": ["a", "b"], "name": "x"}, True, True),
        ({"name": "x", "restitution": 0.5}, False, True),
        ({"between": ["a"]}, False, False),
    ],
)
def test_editors_know_a_rule_and_a_change_of_one(tmp_path, rule, whole, child):
    schema = Draft202012Validator(scenario_schema())
    scenario = json.loads(three_balls(tmp_path, [rule]).read_text())
    assert schema.is_valid(scenario) == whole
    assert schema.is_valid({"extends": "baseline", "name": "x", "contacts": {"rules": [rule]}}) == child


def test_viewers_are_told_the_pair(tmp_path):
    """In ``run.mcap`` without this package, in its text and its scene, and in the recording for Rerun."""
    ffsm_mj.run(three_balls(tmp_path, CHAIN), out=tmp_path / "out")
    told: dict[str, list[Any]] = {}
    with open(tmp_path / "out" / "run.mcap", "rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages(topics=["/ffsm/impact", "/log"]):
            told.setdefault(channel.topic, []).append(message)
    assert [(hit.pair, *hit.geoms) for hit in told["/ffsm/impact"]] == [
        ("ball-left/left", "robot/ball", "left/left"),
        ("behind", "left/left", "right/right"),
    ]
    assert [hit.robot_geom for hit in told["/ffsm/impact"]] == ["robot/ball", ""]
    (line,) = (line.message for line in told["/log"] if "behind" in line.message)
    assert line.startswith("impact behind: impulse 0.81 N s, e = 0.5, approach ")
    command = [sys.executable, "-m", "rerun", "rrd", "print", "-v", str(tmp_path / "out" / "run.rrd")]
    recorded = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert "/world/impacts/1/behind_1" in recorded


def test_what_is_said_of_a_pair(tmp_path, capsys):
    """Summary, table, resolved scenario, log, comparison and terminal; robot and object where it is robot on object."""
    path = three_balls(tmp_path, CHAIN)
    folder, other = tmp_path / "a", tmp_path / "b"
    assert main(["run", str(path), "--out", str(folder), "--no-rerun"]) == 0
    assert "1  0.100000  ball-left/left  0.8" in capsys.readouterr().out
    first, second = json.loads((folder / "summary.json").read_text())["impacts"]
    assert (first["pair"], first["geoms"]) == ("ball-left/left", ["robot/ball", "left/left"])
    assert (first["robot_geom"], first["object_geom"]) == ("robot/ball", "left/left")
    assert (second["pair"], second["geoms"]) == ("behind", ["left/left", "right/right"])
    assert not {"robot_geom", "object_geom"} & second.keys()

    run = ffsm_mj.load_run(folder)
    assert run.impacts == ffsm_mj.run(path).impacts
    columns = run.table("impacts").columns
    assert columns["pair"].tolist() == ["ball-left/left", "behind"]
    assert columns["geoms_a"].tolist() == ["robot/ball", "left/left"]
    assert columns["geoms_b"].tolist() == ["left/left", "right/right"]
    assert columns["robot_geom"].tolist() == ["robot/ball", ""]
    assert main(["export", str(folder), "--csv", "--table", "impacts", "--out", str(tmp_path / "impacts.csv")]) == 0
    assert '"behind","left/left","right/right","","",' in (tmp_path / "impacts.csv").read_text()

    again = ["run", str(folder), "--out", str(other), "--no-rerun", "-s", "contacts.rules.behind.restitution=1.0"]
    assert main(again) == 0
    capsys.readouterr()
    assert main(["analyze", str(folder), str(other), "--compare"]) == 0
    compared = capsys.readouterr().out
    assert "contacts.rules.1.restitution: 0.5 -> 1.0" in compared
    assert "2  behind" in compared
