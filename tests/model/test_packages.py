"""``package://NAME/path`` in a URDF: the file that it refers to, which is stored with a run like any other mesh."""

from __future__ import annotations

import json

import numpy as np
import pytest

from ffsm_mj.errors import InputError
from ffsm_mj.model.composition import compile_system
from ffsm_mj.model.files import read_model
from tests.model.repeated import repeated
from tests.model.test_attached_models import robot
from tests.model.test_model_files import LINK, TETRA, write
from tests.scenario.test_scenario import faults
from tests.scenes import ball, compile_paths

MESH = "package://pk/m/a.obj"


def urdf(mesh: str = MESH, settings: str = "") -> str:
    return f'<robot name="r">\n{settings}\n{LINK.format(kind="collision", mesh=mesh)}</robot>'


def scenario(folder, model: str, **robot) -> str:
    (folder / "rock.xml").write_text(ball("rock"))
    data = {
        "name": "scene",
        "duration_s": 0.002,
        "robot": {"mjcf": model, **robot},
        "objects": {"rock": {"mjcf": "rock.xml"}},
        "initial": {"joints": {"rock/free": [9, 0, 0, 1, 0, 0, 0]}},
        "phases": [{"name": "coast", "until": "end", "controller": {"kind": "off"}}],
    }
    (folder / "scene.yaml").write_text(json.dumps(data))
    return folder / "scene.yaml"


# Each holds two files that could be meant, of another size each: the one named first is.
@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("up/pk/urdf/pk/m/a.obj", "up/pk/m/a.obj"),  # beside the model
        ("up/pk/m/a.obj", "pk/m/a.obj"),  # around it, the nearest first
        ("pk/m/a.obj", "given/pk/m/a.obj"),  # a sibling of a folder above comes before what the scenario names
        ("given/pk/m/a.obj", "elsewhere/pk/m/a.obj"),
        ("elsewhere/pk/m/a.obj", "nowhere/pk/m/a.obj"),  # 'package_paths' may name a package itself
    ],
)
def test_the_nearest_package_is_used(tmp_path, first, second):
    write(tmp_path, up__pk__urdf__r_dot_urdf=urdf())
    for path, size in ((first, 2), (second, 3)):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(TETRA.format(x=size))
    files = read_model(tmp_path / "up/pk/urdf/r.urdf", (), [tmp_path / "given", tmp_path / "elsewhere" / "pk"])
    assert files.main == "r.urdf"
    assert files.files["pk/m/a.obj"].decode() == TETRA.format(x=2)
    assert set(files.files) == {"r.urdf", "pk/m/a.obj"}


def test_meshes_of_one_name_in_two_folders_stay_different(tmp_path):
    both = urdf().replace(
        "</link>", urdf("package://pk/n/a.obj").partition("</inertial>")[2].partition("</link>")[0] + "</link>"
    )
    assert both.count("package://") == 2
    write(tmp_path, r_dot_urdf=both, pk__m__a_dot_obj=TETRA.format(x=1), pk__n__a_dot_obj=TETRA.format(x=3))
    model = compile_paths(tmp_path / "r.urdf").mj
    sizes = [
        np.ptp(model.mesh_vert[start : start + count], axis=0).max()
        for start, count in zip(model.mesh_vertadr, model.mesh_vertnum, strict=True)
    ]
    # The longest edge of each tetrahedron, sqrt(2) and sqrt(10), lies along one principal axis or another: no two are alike.
    assert len(sizes) == 2
    assert sizes[1] > 1.5 * sizes[0]


def test_an_attached_urdf_finds_packages_around_itself(tmp_path):
    """As alone; a package near the attaching model is not used."""
    write(
        tmp_path,
        bus__bus_dot_xml=robot('<model name="r" file="../arms/urdf/r.urdf"/>', '<attach model="r" body="l" prefix="a_"/>'),
        arms__urdf__r_dot_urdf=urdf(),
        arms__pk__m__a_dot_obj=TETRA.format(x=2),
        bus__pk__m__a_dot_obj=TETRA.format(x=3),
    )
    files = read_model(tmp_path / "bus/bus.xml", [tmp_path / "arms"])
    assert set(files.files) == {"bus/bus.xml", "arms/urdf/r.urdf", "arms/urdf/pk/m/a.obj"}
    assert files.files["arms/urdf/pk/m/a.obj"].decode() == TETRA.format(x=2)
    alone = compile_paths(tmp_path / "arms/urdf/r.urdf").mj
    attached = compile_system(files, {}, time_step_s=1e-3).mj
    assert np.array_equal(attached.mesh_vert, alone.mesh_vert)


SETTINGS = ["", '<mujoco><compiler meshdir="../mm"/></mujoco>']


@pytest.mark.parametrize("settings", SETTINGS)
def test_a_run_contains_package_files_of_an_attached_urdf(tmp_path, settings):
    write(
        tmp_path,
        bus_dot_xml=robot('<model name="r" file="robots/r.urdf"/>', '<attach model="r" body="l" prefix="a_"/>'),
        robots__r_dot_urdf=urdf(settings=settings),
        share__pk__m__a_dot_obj=TETRA.format(x=1),
    )
    path = scenario(tmp_path, "bus.xml", package_paths=["share"])
    run, system = repeated(path, tmp_path / "run", tmp_path / "share", tmp_path / "robots")
    below = "mjcf/robot/mm/pk/m/a.obj" if settings else "mjcf/robot/robots/pk/m/a.obj"
    assert run.log.header.files[below].decode() == TETRA.format(x=1)
    assert system.mj.nmesh == 1


def test_a_run_contains_package_files_of_a_urdf_in_an_attached_model(tmp_path):
    """MJCF that attaches MJCF that attaches a URDF, twice: run folder and log contain all files."""
    attach = '<attach model="{0}" body="{1}" prefix="{2}"/>'
    arm = robot('<model name="r" file="../arms/urdf/r.urdf"/>', attach.format("r", "l", "a_"))
    models = '<model name="arm" file="mid/arm.xml"/><model name="other" file="mid/arm.xml"/>'
    write(
        tmp_path,
        bus_dot_xml=robot(models, attach.format("arm", "hub", "x_") + attach.format("other", "hub", "y_")),
        mid__arm_dot_xml=arm.replace('<freejoint name="float"/>', ""),
        arms__urdf__r_dot_urdf=urdf(),
        arms__pk__m__a_dot_obj=TETRA.format(x=2),
    )
    _, system = repeated(scenario(tmp_path, "bus.xml"), tmp_path / "run", tmp_path / "arms", tmp_path / "mid")
    assert system.mj.nmesh == 2


@pytest.mark.parametrize("settings", SETTINGS)
def test_a_run_contains_package_files(tmp_path, settings):
    write(tmp_path, robots__r_dot_urdf=urdf(settings=settings), share__pk__m__a_dot_obj=TETRA.format(x=1))
    path = scenario(tmp_path, "robots/r.urdf", package_paths=["share"], asset_folders=["."])
    run, system = repeated(path, tmp_path / "run", tmp_path / "share", tmp_path / "robots")
    below = "mjcf/robot/mm/pk/m/a.obj" if settings else "mjcf/robot/pk/m/a.obj"
    assert (tmp_path / "run" / below).read_text() == TETRA.format(x=1) == run.log.header.files[below].decode()
    assert system.mj.nmesh == 1


@pytest.mark.parametrize(
    ("mesh", "there", "expected"),
    [
        (MESH, "", "no folder 'pk' above the model or in 'package_paths'; list the folder that contains it in"),
        (MESH, "pk/m/b.obj", "no m/a.obj in {folder}/pk; list the folder that contains it in 'package_paths'"),
        ("package://pk", "pk", "'package://pk' is not of the form package://NAME/path"),
        ("package://pk/../secret.obj", "secret.obj", "is not of the form package://NAME/path"),
        ("package:///m/a.obj", "m/a.obj", "is not a path relative to the model"),
        ("package://" + "x" * 300 + "/a.obj", "", "no folder 'xxx"),
        ("model://pk/m/a.obj", "pk/m/a.obj", "is not a path relative to the model"),
    ],
)
def test_a_missing_package_file_gives_one_line_with_a_remedy(tmp_path, mesh, there, expected):
    write(tmp_path, robots__r_dot_urdf=urdf(mesh))
    if there:
        write(tmp_path, **{there.replace("/", "__").replace(".", "_dot_"): TETRA.format(x=1)})
    (line,) = faults(path=scenario(tmp_path, "robots/r.urdf"))
    assert line.startswith(f"{tmp_path}/robots/r.urdf:4: '")
    assert expected.format(folder=tmp_path) in line


def test_a_symbolic_link_out_of_a_package_is_outside(tmp_path):
    write(tmp_path, robots__r_dot_urdf=urdf(), private__a_dot_obj=TETRA.format(x=1))
    (tmp_path / "pk" / "m").mkdir(parents=True)
    (tmp_path / "pk" / "m" / "a.obj").symlink_to(tmp_path / "private" / "a.obj")
    with pytest.raises(InputError, match=r"r\.urdf:4: .*pk/m/a\.obj is outside the folder of the model"):
        read_model(tmp_path / "robots" / "r.urdf")
    assert len(read_model(tmp_path / "robots" / "r.urdf", [tmp_path / "private"]).files) == 2


def test_a_folder_of_packages_must_exist(tmp_path):
    write(tmp_path, r_dot_urdf=urdf(), pk__m__a_dot_obj=TETRA.format(x=1))
    (line,) = faults('robot.package_paths=["absent"]', path=scenario(tmp_path, "r.urdf"))
    assert line.endswith(f"robot.package_paths.0: no such folder: {tmp_path}/absent")
