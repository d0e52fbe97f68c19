"""Models that attach and include others: all their files are copied to run folder and log."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.cli.main import main
from ffsm_mj.errors import InputError
from ffsm_mj.log.mcap.reader import read_log
from ffsm_mj.log.rerun.sink import write_recording
from ffsm_mj.model.files import read_model
from ffsm_mj.replay import replay_log
from ffsm_mj.report.plots import save
from tests.model.test_model_files import TETRA, write
from tests.scenes import HEAD, ball, compile_paths

ATTACH = '<attach model="{model}" body="{model}" prefix="{prefix}"/>'


def part(name: str, *, compiler: str = "", mesh: str = "part.obj", asset: str = "", inner: str = "") -> str:
    """A body with one hinge and one mesh, to be attached; ``inner`` is inserted in its body."""
    return f"""<mujoco>{HEAD}{compiler}<asset><mesh name="part" file="{mesh}"/>{asset}</asset>
      <worldbody><body name="{name}" pos="0.5 0 0"><joint name="joint" axis="0 0 1"/>
      <geom name="shape" type="mesh" mesh="part" mass="1"/>{inner}</body></worldbody>
      <actuator><motor joint="joint"/></actuator></mujoco>"""


def robot(asset: str, inner: str, head: str = "") -> str:
    return f"""<mujoco>{HEAD}{head}<asset>{asset}</asset><worldbody><body name="hub"><freejoint name="float"/>
      <geom name="hull" type="box" size="0.1 0.1 0.1" mass="5"/>{inner}</body></worldbody></mujoco>"""


@pytest.fixture
def models(tmp_path) -> Path:
    """A hub with two arms, each with a hand, in separate folders; all meshes have the name part.obj."""
    hand = part("hand", compiler='<compiler meshdir="meshes"/>')
    arm = (
        part("arm", compiler='<compiler meshdir="meshes"/>', inner=ATTACH.format(model="hand", prefix="h_"))
        # the hand is named in an included file
        .replace("<asset>", '<include file="hands.xml"/><asset>')
    )
    texts, named = {}, '<model name="hand" file="hand/hand.xml"/>'
    for side, length in (("left", 1), ("right", 2)):
        texts |= {
            f"{side}__arm_dot_xml": arm,
            f"{side}__meshes__part_dot_obj": TETRA.format(x=length),
            f"{side}__hands_dot_xml": f"<mujocoinclude><asset>{named}</asset></mujocoinclude>",
            f"{side}__hand__hand_dot_xml": hand,
            f"{side}__hand__meshes__part_dot_obj": TETRA.format(x=0.1 * length),
        }
    sides = "".join(f'<model name="{side}" file="../{side}/arm.xml"/>' for side in ("left", "right"))
    attach = "".join(f'<frame euler="0 0 {90 * i}"><attach model="{side}" body="arm" prefix="{side}_"/></frame>'
                     for i, side in enumerate(("left", "right")))  # fmt: skip
    texts["hub__hub_dot_xml"] = robot('<mesh name="hub" file="part.obj"/>' + sides,
                                      '<geom type="mesh" mesh="hub" mass="1"/>' + attach,
                                      '<compiler meshdir="shapes"/>')  # fmt: skip
    texts["hub__shapes__part_dot_obj"] = TETRA.format(x=3)
    return write(tmp_path / "models", **texts, ball_dot_xml=ball())


def scenario(models: Path, **changes: object) -> Path:
    path = models / "scene.yaml"
    data = {
        "name": "scene",
        "duration_s": 0.02,
        "robot": {"mjcf": "hub/hub.xml", "asset_folders": ["left", "right"]},
        "objects": {"ball": {"mjcf": "ball.xml"}},
        "initial": {"joints": {"ball/free": [0, 0, 5, 1, 0, 0, 0]}, "rates": {"left_h_joint": 0.5}},
        "phases": [{"name": "coast", "until": "end", "controller": {"kind": "off"}}],
    }
    path.write_text(json.dumps(data | changes))  # JSON is YAML
    return path


@pytest.mark.long
def test_run_folder_and_log_suffice_without_the_original_files(models, tmp_path, capsys):
    all_files = {path.relative_to(models).as_posix() for path in models.rglob("*.*")} - {"ball.xml"}
    run, alone = tmp_path / "run", tmp_path / "alone.mcap"
    assert main(["run", str(scenario(models)), "--out", str(run), "--no-rerun", "--allow-failed-checks"]) == 0
    first = read_log(run / "run.mcap")
    shutil.rmtree(models)
    shutil.copy(run / "run.mcap", alone)
    assert {name for name in first.header.files if "/ball/" not in name} == {f"mjcf/robot/{name}" for name in all_files}
    kept = {path.relative_to(run / "mjcf" / "robot").as_posix() for path in (run / "mjcf" / "robot").rglob("*.*")}
    assert kept == all_files
    assert main(["analyze", str(alone), "--plots", str(tmp_path / "plots")]) == 0
    assert main(["analyze", str(run)]) == 0
    assert save(ffsm_mj.load_run(run), tmp_path / "of-the-folder", ("motion",), ("png",))  # the only one that draws models
    for log in (run, alone):
        assert main(["export", str(log), "--gif", "--out", str(tmp_path / "film.gif")]) == 0
    write_recording(read_log(alone), tmp_path / "view.rrd")
    assert (tmp_path / "view.rrd").stat().st_size > 0
    assert replay_log(read_log(alone)).obstacle == ""
    again = ffsm_mj.run(run / "scenario.yaml")
    assert again.log.rows[:].tobytes() == first.rows[:].tobytes()
    assert again.log.header.files == first.header.files
    assert capsys.readouterr().err == ""


def test_each_attached_model_has_the_meshes_of_its_own_folder(models):
    """As in MuJoCo from disk, where all meshes are different."""
    from_disk = mujoco.MjSpec.from_file(str(models / "hub" / "hub.xml")).compile()
    from_memory = prepare(scenario(models)).system.mj
    assert from_memory.nmesh == 5
    assert np.array_equal(from_memory.mesh_vert, from_disk.mesh_vert)
    first = from_memory.mesh_vertadr
    spans = {float(np.ptp(vertices, axis=0).sum()) for vertices in np.split(from_memory.mesh_vert, first[1:])}
    assert len(spans) == 5


STRIP = '<compiler strippath="true"/>'


@pytest.mark.parametrize(
    ("outer", "inner", "used"),
    [("", STRIP, "a/sub/deep/part.obj"), (STRIP, "", "a/sub/part.obj"), (STRIP, STRIP, "a/sub/part.obj")],
)
def test_only_strippath_of_the_first_model_has_an_effect(tmp_path, outer, inner, used):
    """MuJoCo ignores the ``strippath`` of an attached model."""
    write(
        tmp_path,
        a__r_dot_xml=robot('<model name="s" file="sub/s.xml"/>', ATTACH.format(model="s", prefix="s_"), outer),
        a__sub__s_dot_xml=part("s", compiler=inner, mesh="deep/part.obj"),
        a__sub__part_dot_obj=TETRA.format(x=3),
        a__sub__deep__part_dot_obj=TETRA.format(x=5),
    )
    path = tmp_path / "a" / "r.xml"
    assert set(read_model(path).files) == {"r.xml", "sub/s.xml", used.removeprefix("a/")}
    from_disk = mujoco.MjSpec.from_file(str(path)).compile()
    assert np.array_equal(compile_paths(path).mj.mesh_vert, from_disk.mesh_vert)


@pytest.mark.parametrize("include", ["inc/two.xml", "inc/one.xml"])
def test_a_model_attached_by_an_included_file_is_beside_that_file(tmp_path, include):
    """In memory MuJoCo finds its files by their base names, so another file of the same name could be used instead."""
    write(
        tmp_path,
        r_dot_xml=robot("<!--other-->", ATTACH.format(model="s", prefix="s_"), f'<include file="{include}"/>'),
        inc__one_dot_xml='<mujocoinclude><include file="two.xml"/></mujocoinclude>',
        inc__two_dot_xml='<mujocoinclude><asset><model name="s" file="deep/s.xml"/></asset></mujocoinclude>',
        inc__deep__s_dot_xml=part("s"),
        inc__deep__part_dot_obj=TETRA.format(x=3),
        deep__s_dot_xml="nobody asks for this",
        part_dot_obj=TETRA.format(x=5),
    )
    path = tmp_path / "r.xml"
    from_disk = mujoco.MjSpec.from_file(str(path)).compile()
    assert "inc/deep/part.obj" in read_model(path).files
    assert np.array_equal(compile_paths(path).mj.mesh_vert, from_disk.mesh_vert)
    path.write_text(path.read_text().replace("<!--other-->", '<mesh name="other" file="part.obj"/>'))
    with pytest.raises(InputError) as error:
        read_model(path)
    (line,) = error.value.lines
    assert line.startswith(f"{tmp_path}/inc/deep/s.xml:1: inc/deep/part.obj and part.obj have the same name")


def test_stripped_names_of_several_models_stay_different(tmp_path):
    """Robot and objects of one scene, each with its own part.obj."""
    geom = '<geom type="mesh" mesh="p" mass="1"/>'
    for x in "12345":
        write(
            tmp_path / x,
            r_dot_xml=robot('<mesh name="p" file="meshes/part.obj"/>', geom, STRIP),
            part_dot_obj=TETRA.format(x=x),
        )
    alone = [mujoco.MjSpec.from_file(str(tmp_path / x / "r.xml")).compile().mesh_vert for x in "12345"]
    together = compile_paths(tmp_path / "1" / "r.xml", {f"o{x}": tmp_path / x / "r.xml" for x in "2345"})
    assert np.array_equal(together.mj.mesh_vert, np.concatenate(alone))


def test_a_setting_of_an_attached_model_is_noted_once_with_its_file(tmp_path, capfd):
    """Each model is parsed, attached and compiled more than once; a time step is none of the plant, and is not mentioned."""
    arm = part("s").replace("<asset>", '<option timestep="0.1" gravity="0 0 -1"/><asset>')
    for name in ("one", "two"):
        write(
            tmp_path / name,
            r_dot_xml=robot('<model name="s" file="s.xml"/>', ATTACH.format(model="s", prefix="s_")),
            s_dot_xml=arm,
            part_dot_obj=TETRA.format(x=1),
        )
    places = [tmp_path / name / "r.xml" for name in ("one", "two")]
    told_of = [
        f"{tmp_path}/{name}/s.xml:1: <option gravity='0 0 -1'> of an attached file has no effect" for name in ("one", "two")
    ]
    system = compile_paths(places[0], {"other": places[1]})
    assert [note.partition(", as in MuJoCo: write it in")[0] for note in system.notes] == told_of
    assert capfd.readouterr().err == ""
