"""``scene``: robot, objects and surroundings in one file, as in files of their own."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import InputError
from ffsm_mj.replay import replay_log
from tests.replays import assert_replayed

FILE = """<mujoco model="room"><option timestep="0.002"/>
<asset><mesh name="m" vertex="0 0 0 .3 0 0 0 .2 0 0 0 .1"/></asset>
<worldbody><light pos="0 0 3"/><geom name="floor" type="plane" size="3 3 .1" pos="0 0 -1"/><site name="door"/>
 <body name="shelf" pos="2 0 0"><geom name="shelf" type="box" size=".1 1 1"/></body>
 <body name="arm" pos="0 0 .5"><freejoint name="float"/><geom name="hull" type="box" size=".2 .2 .2" mass="20"/>
  <site name="eye"/><body name="link" pos=".2 0 0"><joint name="elbow" axis="0 1 0" damping="0.1"/>
   <geom name="link" type="capsule" fromto="0 0 0 .4 0 0" size=".03" mass="2"/><site name="tip" pos=".43 0 0"/></body></body>
 <body name="box.1" pos="1 0 .5"><freejoint name="box1"/><geom name="box1" type="box" size=".1 .1 .1" mass="3"/></body>
 <body name="stone" pos="1 0 -.5"><freejoint name="stone"/><geom name="stone" type="mesh" mesh="m" mass="1"/></body>
</worldbody>
<contact><exclude body1="arm" body2="box.1"/><exclude body1="world" body2="stone"/></contact>
<actuator><motor name="elbow" joint="elbow"/></actuator>
<sensor><jointpos name="angle" joint="elbow"/>
 <framepos name="seen" objtype="body" objname="stone" reftype="site" refname="eye"/></sensor>
<keyframe><key name="start" qpos="0 0 .5 1 0 0 0 .3 1 0 .5 1 0 0 0 1 0 -.5 1 0 0 0"
 qvel=".1 0 0 0 0 0 0 -.3 0 0 0 0 .2 .2 0 -.4 0 0 0"/>
 <key name="other" qpos="0 0 .7 1 0 0 0 .1 1 0 .5 1 0 0 0 1 0 0 1 0 0 0"/>
</keyframe></mujoco>"""
PHASES = [{"name": "coast", "until": "end", "controller": {"kind": "off"}}]


def room(folder: Path, text: str = FILE, **keys) -> Path:
    (folder / "room.xml").write_text(text)
    scene = {"mjcf": "room.xml", "robot": "arm"} | keys.pop("scene", {})
    path = folder / "room.yaml"
    contacts = {"default": {"restitution": 0.5}}
    data = {"name": "room", "duration_s": 3.0, "scene": scene, "contacts": contacts, "phases": PHASES}
    path.write_text(json.dumps(data | keys))
    return path


def test_trees_become_robot_and_objects(tmp_path):
    prepared = prepare(room(tmp_path))
    system = prepared.system
    assert [each.name for each in system.models] == ["robot", "box_1", "stone", "surroundings"]
    assert system.resolve("joint", "elbow") == "robot/elbow"
    assert system.resolve("geom", "floor") == "surroundings/floor"
    assert system.names("sensor") == ("robot/angle",)
    whole = mujoco.MjModel.from_xml_string(FILE)
    assert (system.mj.nq, system.mj.nv, system.mj.nu, system.mj.nmesh) == (whole.nq, whole.nv, whole.nu, 1)
    moving = np.flatnonzero(system.mj.body_weldid)
    assert system.mj.body_mass[moving].sum() == pytest.approx(26.0)


def test_the_first_keyframe_is_the_start_and_the_scenario_may_say_otherwise(tmp_path):
    """Coordinates and rates, joint by joint."""
    whole = mujoco.MjModel.from_xml_string(FILE)
    data = prepare(room(tmp_path)).assemble().plant.data
    assert data.qpos.tolist() == whole.key_qpos[0].tolist()
    assert data.qvel.tolist() == whole.key_qvel[0].tolist()
    initial = {"joints": {"elbow": -0.2}}
    data = prepare(room(tmp_path, scene={"keyframe": "other"}, initial=initial)).assemble().plant.data
    assert data.qpos.tolist() == [*whole.key_qpos[1][:7], -0.2, *whole.key_qpos[1][8:]]


def test_filters_between_trees_stay(tmp_path):
    """The file excludes robot and box, and the stone and the floor, but not the stone and the shelf."""
    contacts = prepare(room(tmp_path)).assemble().plant.scene
    pairs = {frozenset(each) for each in (("robot/hull", "stone/stone"), ("surroundings/floor", "robot/hull"))}
    found = {frozenset(pair.geoms) for pair in _pairs(contacts)}
    assert pairs <= found
    assert frozenset(("robot/hull", "box_1/box1")) not in found
    assert frozenset(("surroundings/floor", "stone/stone")) not in found
    assert frozenset(("surroundings/shelf", "stone/stone")) in found


def _pairs(scene):
    from ffsm_mj.assembly.contact_rules import resolve_contacts
    from ffsm_mj.scenario.contacts import ContactsConfig

    return resolve_contacts(ContactsConfig(), scene.system).pairs


@pytest.mark.long
def test_a_run_is_that_of_files_of_their_own(tmp_path):
    """Bit for bit: the same trees in the same order."""
    one = ffsm_mj.run(room(tmp_path), out=tmp_path / "out")
    assert one.outcome == "completed", one.message
    assert one.impacts
    assert [check for check in all_checks(one) if not check.passes] == []
    stated = {
        "robot": {"mjcf": "room.xml", "body": "arm"},
        "objects": {
            "box_1": {"mjcf": "room.xml", "body": "box.1"},
            "stone": {"mjcf": "room.xml", "body": "stone"},
            "surroundings": {"mjcf": "room.xml", "body": "world", "fixed": True},
        },
        "initial": {
            "joints": {"float": [0, 0, 0.5, 1, 0, 0, 0], "elbow": 0.3, "stone": [1, 0, -0.5, 1, 0, 0, 0]},
            "rates": {"float": [0.1, 0, 0, 0, 0, 0], "box1": [-0.3, 0, 0, 0, 0, 0.2], "stone": [0.2, 0, -0.4, 0, 0, 0]},
        },
    }
    other = json.loads((tmp_path / "room.yaml").read_text())
    del other["scene"]
    (tmp_path / "stated.yaml").write_text(json.dumps(other | stated))
    assert np.array_equal(ffsm_mj.run(tmp_path / "stated.yaml").qpos, one.qpos)
    assert_replayed(one)
    # The log has the file once, a run from the folder is the same, and so is a replay.
    assert [name for name in one.log.header.files if name.endswith(".xml")] == ["mjcf/robot/room.xml"]
    assert np.array_equal(ffsm_mj.run(tmp_path / "out").qpos, one.qpos)
    assert replay_log(one.log).agrees


def test_constraints_between_trees_hold(tmp_path):
    """The box is welded to the tip from the start; momentum is that of one body."""
    weld = '<equality><weld name="hold" body1="link" body2="box.1"/></equality></mujoco>'
    text = f"{FILE[: FILE.index('<keyframe>')]}{weld}"
    initial = {"rates": {"float": [0.1, 0, 0, 0, 0, 0], "box1": [0.1, 0, 0, 0, 0, 0]}}
    run = ffsm_mj.run(room(tmp_path, text, duration_s=0.5, initial=initial))
    assert run.outcome == "completed", run.message
    assert [check for check in all_checks(run) if not check.passes] == []
    assert run.qpos[-1, 8:11] - run.qpos[-1, :3] == pytest.approx([1.0, 0.0, 0.0], abs=1e-12)


def test_what_names_a_part_of_another_tree_goes_with_it(tmp_path):
    """Lights, cameras, pairs, sensors, and drives of the world: in one model they would name what it has not."""
    more = {
        '<light pos="0 0 3"/>': '<light pos="0 0 3" mode="targetbody" target="arm"/>',
        '<site name="tip"': '<camera name="watch" mode="targetbody" target="stone"/><site name="tip"',
        "<contact>": '<contact><pair geom1="floor" geom2="link"/><pair geom1="link" geom2="stone"/>',
        "<sensor>": '<sensor><framepos objtype="site" objname="door" reftype="body" refname="link"/><clock name="time"/>',
    }
    text = FILE
    for old, new in more.items():
        text = text.replace(old, new)
    system = prepare(room(tmp_path, text)).system
    assert system.names("sensor") == ("robot/time", "robot/angle")
    ends = zip(system.mj.pair_geom1.tolist(), system.mj.pair_geom2.tolist(), strict=True)
    pairs = {frozenset(system.mj.geom(geom).name for geom in pair) for pair in ends}
    assert pairs == {frozenset(("surroundings/floor", "robot/link")), frozenset(("robot/link", "stone/stone"))}
    assert sum("left out: sensor" in note for note in system.notes) == 2


def test_what_the_scenario_says_of_an_object_is_added(tmp_path):
    prepared = prepare(room(tmp_path, objects={"stone": None, "box_1": {"limits": "ignore"}}, robot={"strip": ["damping"]}))
    assert [each.name for each in prepared.system.models] == ["robot", "box_1", "surroundings"]
    assert any("damping" in note for note in prepared.system.notes)


@pytest.mark.parametrize(
    ("scene", "text", "expected"),
    [
        ({"robot": "amr"}, FILE, "scene.robot: unknown root of a moving tree 'amr' (did you mean 'arm'"),
        ({"robot": "shelf"}, FILE, "scene.robot: unknown root of a moving tree 'shelf'"),
        ({"keyframe": "begin"}, FILE, "scene.keyframe: unknown keyframe 'begin'"),
        ({"mjcf": "rom.xml"}, FILE, "scene.mjcf: no such model file: "),
        ({"sites": {}}, FILE, "scene.sites: unknown key"),
        ({}, FILE.replace('<freejoint name="box1"/>', ""), "scene.mjcf: keyframe 'start' has 22 numbers for 15"),
        (
            {},
            FILE.replace(
                "<actuator>",
                '<tendon><spatial name="rope"><site site="tip"/><site site="s"/></spatial></tendon><actuator>',
            ).replace('<geom name="stone"', '<site name="s"/><geom name="stone"'),
            "room.xml: tendon 'rope' joins two models",
        ),
    ],
)
def test_faults_are_named(tmp_path, scene, text, expected):
    path = room(tmp_path, text, scene=scene)
    with pytest.raises(InputError) as error:
        prepare(path)
    assert expected in "\n".join(error.value.lines)
