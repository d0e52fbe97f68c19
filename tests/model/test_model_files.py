"""Files of a model: those that it uses, below its folder, are read, compiled from memory and stored in the log."""

from __future__ import annotations

import os
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image

from ffsm_mj.errors import InputError
from ffsm_mj.model.files import logged_model, read_model
from ffsm_mj.model.source import load_spec
from tests.model.repeated import repeated
from tests.scenario.test_scenario import faults
from tests.scenes import HEAD, compile_paths, scene

TETRA = "v 0 0 0\nv {x} 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
BODY = '<worldbody><body name="r"><freejoint name="free"/><geom name="g" size="0.1" mass="1"/>{geoms}</body></worldbody>'
LINK = """<link name="l"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<{kind}><geometry><mesh filename="{mesh}"/></geometry></{kind}></link>"""


def write(folder: Path, **texts: str) -> Path:
    """Write files by name, with ``__`` for a slash and ``_dot_`` for a dot; a PNG if the text is empty."""
    for key, text in texts.items():
        path = folder / key.replace("__", "/").replace("_dot_", ".")
        path.parent.mkdir(parents=True, exist_ok=True)
        if text:
            path.write_text(text)
        else:
            Image.new("RGB", (4, 4), (200, 10, 10)).save(path)
    return folder


def model(inner: str, geoms: str = "") -> str:
    return f"<mujoco>{HEAD}{inner}{BODY.format(geoms=geoms)}</mujoco>"


def scene_of(folder: Path, robot: str) -> Path:
    """A scenario of 2 ms with an existing file as robot."""
    path = scene(folder, model(""), {}, duration_s=0.002)
    path.write_text(path.read_text().replace('"robot.xml"', f'"{robot}"'))
    return path


@pytest.fixture
def many(tmp_path) -> Path:
    """A robot of many files: includes, one of them beside its including file, meshes, textures, an attached model."""
    asset = '<asset><mesh name="a" file="a.obj"/><texture name="t" type="2d" file="t.png"/>'
    ignored = '<texture name="flat" type="2d" builtin="flat" width="2" height="2" file="private.png"/>'
    cube = '<texture name="cube" type="cube" file="t.png" fileup="private.png"/>'
    attached = '<model name="sub" file="sub/sub.xml"/></asset>'
    sub = '<compiler meshdir="meshes"/><asset><mesh name="b" file="b.obj"/></asset><worldbody><body name="s">'
    return write(
        tmp_path / "many",
        robot_dot_xml=model(
            '<compiler meshdir="m"/><include file="inc/one.xml"/>' + asset + ignored + cube + attached,
            '<geom type="mesh" mesh="a" mass="1"/><attach model="sub" body="s" prefix="s_"/>',
        ),
        inc__one_dot_xml='<mujocoinclude><compiler texturedir="t"/><include file="two.xml"/></mujocoinclude>',
        inc__two_dot_xml='<mujocoinclude><asset><material name="mat" rgba="1 0 0 1"/></asset></mujocoinclude>',
        m__a_dot_obj=TETRA.format(x=1),
        t__t_dot_png="",
        t__private_dot_png="",
        private_dot_png="",
        unused_dot_obj=TETRA.format(x=2),
        sub__sub_dot_xml=f'<mujoco>{sub}<geom type="mesh" mesh="b" mass="1"/></body></worldbody></mujoco>',
        sub__meshes__b_dot_obj=TETRA.format(x=3),
    )


USED = {"robot.xml", "inc/one.xml", "inc/two.xml", "m/a.obj", "t/t.png", "sub/sub.xml", "sub/meshes/b.obj"}


def test_exactly_the_files_that_mujoco_uses_are_read(many):
    files = read_model(many / "robot.xml")
    assert set(files.files) == USED
    from_disk = mujoco.MjSpec.from_file(str(many / "robot.xml")).compile()
    with mujoco.MjVfs() as vfs:
        from_memory = load_spec(files, vfs).compile(vfs=vfs)
    for name in ("mesh_vert", "tex_data", "body_mass", "body_inertia", "geom_size", "mat_rgba"):
        assert np.array_equal(getattr(from_memory, name), getattr(from_disk, name)), name
    for missing in USED - {"robot.xml"}:
        with pytest.raises(InputError, match=rf"x/.*\.xml:1: x/.*{missing[-7:]} is not in the log"):
            logged_model("robot.xml", {k: v for k, v in files.files.items() if k != missing}, "x/")


@pytest.mark.parametrize("missing", sorted(USED - {"robot.xml"}))
def test_each_of_these_files_is_needed(many, missing):
    (many / missing).unlink()
    with pytest.raises(ValueError, match="Error"):
        mujoco.MjSpec.from_file(str(many / "robot.xml")).compile()


def test_a_run_is_repeatable_from_its_files(many, tmp_path):
    run, _ = repeated(scene_of(tmp_path, "many/robot.xml"), tmp_path / "run", many)
    assert set(run.log.header.files) == {f"mjcf/robot/{name}" for name in USED}
    copied = tmp_path / "run" / "mjcf" / "robot"
    assert {file.relative_to(copied).as_posix() for file in copied.rglob("*.*")} == USED


def test_meshes_of_the_same_name_stay_different(tmp_path):
    """MuJoCo caches compiled meshes by name and a weak checksum; two different meshes of one name stay different."""
    text = model('<asset><mesh name="a" file="a.obj"/></asset>', '<geom name="m" type="mesh" mesh="a" mass="1"/>')
    for x in "13579":
        write(tmp_path / x, o_dot_xml=text, a_dot_obj=TETRA.format(x=x))
    wide = [np.ptp(compile_paths(tmp_path / x / "o.xml").mj.mesh_vert, axis=0).max() for x in "13579"]
    alone = [np.ptp(mujoco.MjSpec.from_file(str(tmp_path / x / "o.xml")).compile().mesh_vert, axis=0).max() for x in "13579"]
    assert wide == alone
    assert len(set(wide)) == 5
    both = compile_paths(tmp_path / "1" / "o.xml", {"x": tmp_path / "3" / "o.xml", "y": tmp_path / "1" / "o.xml"})
    assert both.mj.nmesh == 3


# --- outside the folders ----------------------------------------------------------------------------------------------

MESH = '<asset><mesh name="a" file="{file}"/></asset>'


def refused(path: Path, *folders: Path) -> str:
    with pytest.raises(InputError) as error:
        read_model(path, folders)
    (line,) = error.value.lines
    return line


@pytest.mark.parametrize(
    ("inner", "expected"),
    [
        (
            MESH.format(file="../out/a.obj"),
            "{root}/out/a.obj is outside the folder of the model: move it",
        ),
        (MESH.format(file="{root}/out/a.obj"), "'{root}/out/a.obj' is not a path relative to the model"),
        (
            '<compiler meshdir="{root}/out"/>' + MESH.format(file="a.obj"),
            "'{root}/out/a.obj' is not a path relative to the model",
        ),
        (MESH.format(file="link.obj"), "{root}/in/link.obj is outside"),
        (MESH.format(file="linked/a.obj"), "{root}/in/linked/a.obj is outside"),
        (MESH.format(file="package://p/a.obj"), "'package://p/a.obj' is not a path relative to the model"),
        (MESH.format(file="m\\a.obj"), "is not a path relative to the model with forward slashes"),
        (MESH.format(file="absent.obj"), "{root}/in/absent.obj: no such file"),
        (MESH.format(file="pipe"), "{root}/in/pipe: not a file"),
        ('<include file="../out/i.xml"/>', "{root}/out/i.xml is outside"),
        ('<include file="self.xml"/>', "'self.xml' includes itself"),
        ('<asset><model name="s" file="r.xml"/></asset>', "'r.xml' includes itself"),
        ('<extension><plugin plugin="mujoco.pid"/></extension>', "<extension>: plugins are not modelled"),
    ],
)
def test_files_elsewhere_are_refused_with_file_and_line(tmp_path, inner, expected):
    write(
        tmp_path,
        out__a_dot_obj=TETRA.format(x=1),
        out__i_dot_xml="<mujocoinclude><size/></mujocoinclude>",
        in__self_dot_xml='<mujocoinclude><include file="self.xml"/></mujocoinclude>',
        in__r_dot_xml="<mujoco>\n" + model(inner.replace("{root}", str(tmp_path))).removeprefix("<mujoco>"),
    )
    (tmp_path / "in" / "link.obj").symlink_to(tmp_path / "out" / "a.obj")
    (tmp_path / "in" / "linked").symlink_to(tmp_path / "out")
    os.mkfifo(tmp_path / "in" / "pipe")
    line = refused(tmp_path / "in" / "r.xml")
    place = "self.xml:1" if "self" in inner else "r.xml:2"
    assert line.startswith(f"{tmp_path}/in/{place}: ")
    assert expected.format(root=tmp_path) in line


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('<!DOCTYPE m [<!ENTITY a "b">]><mujoco/>', "r.xml:1: <!DOCTYPE>"),
        ("<mujoco>\n<worldbody></mujoco>", "r.xml:2:14: malformed XML: mismatched tag"),
        ("", "r.xml:1:1: malformed XML: no element found"),
        ("<mujoco>" + "<a>" * 300, "r.xml:1: more than 200 levels"),
        ('<?xml version="1.0" encoding="cp037"?><mujoco>\xe9</mujoco>', "r.xml:1:47: malformed XML"),
    ],
)
def test_xml_with_hidden_references_is_refused(tmp_path, text, expected):
    (tmp_path / "r.xml").write_text(text, encoding="latin-1")
    assert expected in refused(tmp_path / "r.xml")


def test_a_scenario_names_further_folders(tmp_path):
    inner = '<compiler meshdir="../meshes"/>' + MESH.format(file="a.obj")
    write(tmp_path, models__robot_dot_xml=model(inner), meshes__a_dot_obj=TETRA.format(x=1))
    path = scene_of(tmp_path, "models/robot.xml")
    (line,) = faults(path=path)
    assert line.startswith(f"{tmp_path}/models/robot.xml:1: {tmp_path}/meshes/a.obj is outside")
    run, _ = repeated(path, tmp_path / "run", overrides=['robot.asset_folders=["meshes"]'])
    assert set(run.log.header.files) == {"mjcf/robot/models/robot.xml", "mjcf/robot/meshes/a.obj"}
    (line,) = faults('robot.asset_folders=["absent"]', path=path)
    assert line.endswith(f"robot.asset_folders.0: no such folder: {tmp_path}/absent")


@pytest.mark.parametrize(
    ("kind", "mesh", "settings", "used"),
    [
        ("collision", "m/a.obj", "", {"m/a.obj"}),
        ("visual", "m/a.obj", "", set()),
        ("visual", "m/a.obj", '<mujoco><compiler discardvisual="false"/></mujoco>', {"m/a.obj"}),
        ("collision", "package://p/a.obj", '<mujoco><compiler strippath="true" meshdir="m"/></mujoco>', {"m/a.obj"}),
    ],
)
def test_urdf_reads_its_meshes(tmp_path, kind, mesh, settings, used):
    text = f'<robot name="r">{settings}{LINK.format(kind=kind, mesh=mesh)}<include file="x.xml"/></robot>'
    write(tmp_path, r_dot_urdf=text, m__a_dot_obj=TETRA.format(x=1), x_dot_xml="<secret/>")
    assert set(read_model(tmp_path / "r.urdf").files) == {"r.urdf", *used}
    assert compile_paths(tmp_path / "r.urdf").mj.nmesh == len(used)


def test_two_files_that_mujoco_could_confuse_are_refused(tmp_path):
    write(
        tmp_path,
        r_dot_xml=model('<include file="a/i.xml"/><include file="b/j.xml"/>'),
        a__i_dot_xml='<mujocoinclude><include file="same.xml"/></mujocoinclude>',
        a__same_dot_xml="<mujocoinclude><size/></mujocoinclude>",
        b__j_dot_xml='<mujocoinclude><include file="b/same.xml"/></mujocoinclude>',
        b__same_dot_xml="<mujocoinclude><size/></mujocoinclude>",
    )
    assert "a/same.xml and b/same.xml have the same name" in refused(tmp_path / "r.xml")


def test_models_of_too_many_bytes_are_refused_before_they_are_read(tmp_path):
    write(tmp_path, r_dot_xml=model(MESH.format(file="a.obj")))
    with (tmp_path / "a.obj").open("wb") as huge:
        huge.truncate(8 << 30)  # a hole: it takes no space
    line = refused(tmp_path / "r.xml")
    assert line.startswith(f"{tmp_path}/r.xml:1: {tmp_path}/a.obj: with this file the model exceeds 1000 files and 256 MiB")
