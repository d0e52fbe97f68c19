"""Impact pairs in a scenario: which geoms may be one, names, changes by name, and what is said of them."""

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
    assert "impact_pairs.0: geoms 'robot/upper' and 'robot/round' are on one rigid body" in line
    arm = ARM.replace('<geom name="round" size="0.04"', '<geom name="round" size="0.06"')
    (tmp_path / "robot.xml").write_text(arm)
    (tmp_path / "scene.yaml").write_text(
        (tmp_path / "scene.yaml").read_text().replace('"upper", "round"', '"hull", "round"')
    )
    (line,) = refused(tmp_path / "scene.yaml")
    assert "impact_pairs.0: robot/hull and robot/round overlap by 0.01 m at the start; move one of them" in line


def refused(path, *overrides):
    with pytest.raises(InputError) as error:
        prepare(path, overrides)
    return error.value.lines


@pytest.mark.parametrize(
    ("pair", "expected"),
    [
        ({"geoms": ["tip", "finger"]}, "impact_pairs.0: geoms 'robot/tip' and 'robot/finger' are on one rigid body"),
        ({"geoms": ["tip", "tip"]}, "impact_pairs.0: geoms 'robot/tip' and 'robot/tip' are on one rigid body"),
        ({"geoms": ["tip", "wall"]}, "impact_pairs.0: geom 'robot/wall' is fixed to the world"),
        (
            {"geoms": ["tip", "hul"]},
            "impact_pairs.0.geoms.1: unknown geom 'hul' (did you mean 'robot/hull'?); allowed: robot/finger, ",
        ),
        ({"geoms": ["tip"]}, "impact_pairs.0.geoms: "),
        ({"geoms": ["tip", "hull", "rock"]}, "impact_pairs.0.geoms: "),
        ({"geoms": ["tip", "hull"], "robot_geom": "tip"}, "a pair needs 'geoms: [a, b]', or 'robot_geom' and 'object_geom'"),
        ({"robot_geom": "tip"}, "a pair needs 'geoms: [a, b]', or 'robot_geom' and 'object_geom'"),
        ({"robot_geom": "tip", "object_geom": "hull"}, "impact_pairs.0.object_geom: robot/hull is not a geom of an object"),
        ({"geoms": ["tip", "hull"], "name": "3"}, "the name '3' would be ambiguous with a position in the list"),
        ({"geoms": ["tip", "hull"], "name": ""}, "impact_pairs.0.name: "),
    ],
)
def test_pairs_that_are_none(tmp_path, pair, expected):
    path = self_hit(tmp_path, impact_pairs=[pair])
    wall = '<worldbody><geom name="wall" size="0.1" pos="0 -5 0"/>'
    (tmp_path / "robot.xml").write_text(ARM.replace("<worldbody>", wall))
    (line,) = refused(path)
    assert line.startswith(f"{path}:1:")
    assert expected in line


def test_names_are_unique(tmp_path):
    """Two different pairs under one name, given or not; and one pair twice, either way round."""
    named = [{"geoms": ["ball", "left/left"], "name": "behind"}, CHAIN[1]]
    (line,) = refused(three_balls(tmp_path, named))
    assert "impact_pairs.1.name: left/left - right/right and robot/ball - left/left have the name 'behind'" in line
    taken = [CHAIN[0], CHAIN[1] | {"name": "ball-left/left"}]
    (line,) = refused(three_balls(tmp_path, taken))
    assert "impact_pairs.1.name: " in line
    (line,) = refused(three_balls(tmp_path, [CHAIN[0], {"geoms": ["left/left", "ball"]}]))
    assert "impact_pairs.1: left/left - robot/ball is listed twice" in line


def test_overrides_by_name(tmp_path):
    path = three_balls(tmp_path, [CHAIN[0], CHAIN[1] | {"name": "far.behind"}])
    keys = ["impact_pairs.ball-left/left.restitution=0.5", "impact_pairs.far.behind.restitution=0.25"]
    pairs = prepare(path, [*keys, "phases.coast.name=fly"]).scenario
    assert [pair.restitution for pair in pairs.impact_pairs] == [0.5, 0.25]
    assert pairs.phases[0].name == "fly"
    renamed = prepare(path, ["impact_pairs.0.name=first", "impact_pairs.first={geoms: [ball, right/right]}"]).scenario
    assert renamed.impact_pairs[0].name == "ball-right/right"
    for wrong in ("impact_pairs.nobody.restitution=0.5", "impact_pairs.2.restitution=0.5", "impact_pairs.far=1"):
        (line,) = refused(path, wrong)
        meant = " (did you mean 'far.behind'?)" * wrong.startswith("impact_pairs.far")
        assert line == (
            f"overrides: {wrong}: impact_pairs is a list of 2{meant}: "
            "its positions are 0 to 1, its names ball-left/left, far.behind"
        )
    (line,) = refused(path, "impact_pairs.far.behind.restitution=-1")
    assert line.startswith("overrides: impact_pairs.far.behind.restitution=-1: impact_pairs.1.restitution: ")


def test_a_child_changes_a_pair_by_its_name(tmp_path):
    three_balls(tmp_path, CHAIN)
    child = tmp_path / "child.yaml"
    text = "extends: scene.yaml\nname: child\nimpact_pairs:\n"
    child.write_text(text + "  - {name: behind, restitution: 0.1}\n  - {name: ball-left/left, super_elastic: true}\n")
    first, second = prepare(child).scenario.impact_pairs
    assert (first.geoms, first.restitution) == (("left/left", "right/right"), 0.1)
    assert (second.robot_geom, second.restitution, second.super_elastic) == ("ball", 0.8, True)


@pytest.mark.parametrize(
    ("pair", "whole", "child"),
    [
        ({"geoms": ["a", "b"]}, True, True),
        ({"robot_geom": "a", "object_geom": "b", "name": "x"}, True, True),
        ({"name": "x", "restitution": 0.5}, False, True),
        ({"robot_geom": "a"}, False, False),
        ({"geoms": ["a"]}, False, False),
        ({"geoms": ["a", "b"], "robot_geom": "a", "object_geom": "b"}, False, True),  # nothing or null may take it away
    ],
)
def test_editors_know_both_ways_to_write_a_pair(tmp_path, pair, whole, child):
    schema = Draft202012Validator(scenario_schema())
    scenario = json.loads(three_balls(tmp_path, [pair]).read_text())
    assert schema.is_valid(scenario) == whole
    assert schema.is_valid({"extends": "baseline", "name": "x", "impact_pairs": [pair]}) == child


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

    again = ["run", str(folder), "--out", str(other), "--no-rerun", "-s", "impact_pairs.behind.restitution=1.0"]
    assert main(again) == 0
    capsys.readouterr()
    assert main(["analyze", str(folder), str(other), "--compare"]) == 0
    compared = capsys.readouterr().out
    assert "impact_pairs.1.restitution: 0.5 -> 1.0" in compared
    assert "2  behind" in compared
