"""Decomposed meshes of models: their numbers in every format, their axes, mass and inertia, what is kept and logged."""

from __future__ import annotations

import struct
from pathlib import Path

import mujoco
import numpy as np
import pytest

from ffsm_mj.decomposition import coacd, stored
from ffsm_mj.decomposition.stored import FOLDER
from ffsm_mj.errors import InputError, ScenarioFaults
from ffsm_mj.model import decompose
from ffsm_mj.model.composition import compile_system
from ffsm_mj.model.decompose import Decompose, with_logged_pieces, with_pieces
from ffsm_mj.model.files import read_model
from tests.decomposition import meshes

ROBOT = """<mujoco><worldbody><body name="bus"><freejoint/><geom size="0.1" mass="1"/></body></worldbody></mujoco>"""
DENSITY = 2700.0


def numbers(values):
    return " ".join(map(repr, np.asarray(values).reshape(-1).tolist()))


def inline(vertices, faces):
    return f'vertex="{numbers(vertices)}" face="{numbers(faces)}"', {}


def obj(vertices, faces):
    rows = [f"v {numbers(vertex)}" for vertex in vertices]
    # The last face counts its vertices from the end.
    last = [index - len(vertices) for index in faces[-1]]
    rows += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces[:-1]] + ["f {} {} {}".format(*last)]
    return 'file="part.obj"', {"part.obj": "\n".join(["# a part", *rows]).encode()}


def stl(vertices, faces):
    triangles = b"".join(struct.pack("<12fH", 0, 0, 0, *vertices[face].reshape(-1), 0) for face in faces)
    return 'file="part.stl"', {"part.stl": bytes(80) + struct.pack("<i", len(faces)) + triangles}


def msh(vertices, faces):
    head = struct.pack("<4i", len(vertices), 0, 0, len(faces))
    return 'file="part.msh"', {"part.msh": head + vertices.astype("<f4").tobytes() + faces.astype("<i4").tobytes()}


def write_model(folder, written, *, mesh="", body="", geom=""):
    """A floating object with one mesh, and the robot."""
    attributes, files = written
    (folder / "part.xml").write_text(
        f'<mujoco><asset><mesh name="part" {attributes} {mesh}/></asset><worldbody>'
        f'<body name="part" pos="0.5 -0.2 0.1" quat="0.9 0.1 0.3 -0.2"><freejoint/>{body}'
        f'<geom name="shape" type="mesh" mesh="part" density="{DENSITY}" {geom}/></body></worldbody></mujoco>'
    )
    (folder / "robot.xml").write_text(ROBOT)
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return folder / "part.xml"


def compiled(path, **options):
    robot = read_model(path.parent / "robot.xml")
    part = with_pieces(read_model(path), [Decompose(mesh="part", **options)], path.parent, ("objects", "part"))
    return compile_system(robot, {"part": part}, time_step_s=1e-3)


def pieces_in_world(system):
    data = mujoco.MjData(system.mj)
    mujoco.mj_kinematics(system.mj, data)
    geom = system.index("geom", "part/shape")
    return [piece.moved(data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)) for piece in system.pieces[geom]]


@pytest.mark.parametrize("written", [inline, obj, stl, msh])
@pytest.mark.parametrize("mesh", ["", 'scale="1 -0.5 2" refpos="0.1 0.2 -0.3" refquat="0.8 0 0.6 0"'])
def test_pieces_are_where_mujoco_has_the_mesh(tmp_path, written, mesh):
    """In every format, mirrored and moved: corners agree with MuJoCo's to single precision, and pieces have no more.

    The mesh is 0.3 m across, at most 0.6 m scaled; single precision is 6e-8 of that, and MuJoCo rounds four times.
    """
    path = write_model(tmp_path, written(*meshes.slot()), mesh=mesh, geom='pos="0.3 0.1 0" quat="0.5 0.5 0.5 -0.5"')
    system = compiled(path)
    (pieces,) = system.pieces.values()
    assert len(pieces) == 5
    of_mujoco = system.mj.mesh_vert.astype(np.float64)
    for piece in pieces:
        assert np.linalg.norm(piece.vertices[:, None] - of_mujoco, axis=2).min(axis=1).max() < 2e-7
    # Vertices of the mesh within its edges are corners of no piece.
    heights = [(of_mujoco @ piece.normals.T - piece.offsets).max(axis=1) for piece in pieces]
    assert np.abs(np.min(heights, axis=0)).max() < 2e-7


def test_pieces_keep_double_precision(tmp_path):
    """In the world, corners are where the numbers of the file and the poses of the model put them."""
    vertices, faces = meshes.bracket()
    vertices += np.array([1.0 / 3.0, -1.0 / 7.0, 0.0])  # no numbers of single precision
    system = compiled(write_model(tmp_path, inline(vertices, faces)))
    data = mujoco.MjData(system.mj)
    mujoco.mj_kinematics(system.mj, data)
    body = system.index("body", "part/part")
    expected = data.xpos[body] + vertices @ data.xmat[body].reshape(3, 3).T
    corners = np.concatenate([piece.vertices for piece in pieces_in_world(system)])
    # The axes of the geom are single precision away from those of the file, and their pose says so exactly.
    assert np.linalg.norm(expected[:, None] - corners, axis=2).min(axis=0).max() < 2e-15


def inertia_of(pieces):
    """Mass over density, centre and inertia about it over density of polytopes: sums over tetrahedra of their faces."""
    tetrahedra = np.array(
        [
            (piece.vertices.mean(axis=0), *piece.vertices[[face[0], face[k], face[k + 1]]])
            for piece in pieces
            for face in piece.faces
            for k in range(1, len(face) - 1)
        ]
    )
    volumes = np.linalg.det(tetrahedra[:, 1:] - tetrahedra[:, :1]) / 6.0
    centre = np.einsum("t,tx->x", volumes, tetrahedra.mean(axis=1)) / volumes.sum()
    off = tetrahedra - centre
    sums = off.sum(axis=1)
    # Second moments of a tetrahedron: V/20 (sum of x x^T over corners + (sum x)(sum x)^T).
    second = np.einsum("t,tkx,tky->xy", volumes / 20.0, off, off) + np.einsum("t,tx,ty->xy", volumes / 20.0, sums, sums)
    return volumes.sum(), centre, np.trace(second) * np.eye(3) - second


@pytest.mark.parametrize("written", [inline, obj, stl])
@pytest.mark.parametrize("flipped", [False, True])
def test_mass_and_inertia_are_of_the_volume(tmp_path, flipped, written):
    """MuJoCo's default counts overlaps twice; numbers of the mesh in single precision give 1e-6 of mass and inertia."""
    vertices, faces = meshes.frame()
    system = compiled(write_model(tmp_path, written(vertices, faces[:, ::-1] if flipped else faces)))
    volume, centre, inertia = inertia_of(pieces_in_world(system))
    body = system.index("body", "part/part")
    data = mujoco.MjData(system.mj)
    mujoco.mj_kinematics(system.mj, data)
    assert volume == pytest.approx(12 * 0.8 * 0.03**2 - 16 * 0.03**3, rel=1e-12)  # each corner is in three bars
    assert system.mj.body_mass[body] == pytest.approx(DENSITY * volume, rel=1e-6)
    np.testing.assert_allclose(data.xipos[body], centre, atol=1e-7)
    axes = data.ximat[body].reshape(3, 3)
    expected = DENSITY * inertia
    np.testing.assert_allclose((axes * system.mj.body_inertia[body]) @ axes.T, expected, atol=2e-6 * expected.max())
    assert any("mass and inertia of part are of the volume of mesh 'part'" in note for note in system.notes)
    assert system.files["part"].pieces["part"].turned == flipped


def test_an_inertial_of_the_file_stays(tmp_path):
    body = '<inertial pos="0 0 0" mass="3" diaginertia="1 1 1"/>'
    system = compiled(write_model(tmp_path, inline(*meshes.frame()), body=body))
    assert system.mj.body_mass[system.index("body", "part/part")] == 3.0
    assert not any("mass and inertia" in note for note in system.notes)


def test_pieces_beside_the_model_are_taken(tmp_path, monkeypatch):
    """The second time nothing is decomposed; other options are other pieces; a mesh that changes has none."""
    path = write_model(tmp_path, obj(*meshes.bracket()))
    first = compiled(path)
    (file,) = (tmp_path / FOLDER).iterdir()
    decompose._decomposed.cache_clear()

    def refuse(request):
        raise AssertionError(request.mesh)

    with monkeypatch.context() as patched:
        patched.setattr(decompose, "decompose", refuse)
        second = compiled(path)
        for one, other in zip(*(next(iter(system.pieces.values())) for system in (first, second)), strict=True):
            for array in ("vertices", "normals", "offsets"):
                np.testing.assert_array_equal(getattr(one, array), getattr(other, array))
        with pytest.raises(AssertionError):
            compiled(path, tolerance_m=1e-6)
        write_model(tmp_path, obj(*meshes.slot()))
        with pytest.raises(AssertionError):
            compiled(path)
    write_model(tmp_path, obj(*meshes.bracket()))
    file.write_bytes(file.read_bytes()[:-100])
    decompose._decomposed.cache_clear()
    with pytest.raises(InputError, match=r"part-.*\.json: is not a file with the pieces of a mesh, or damaged; remove it"):
        compiled(path)


def test_a_folder_that_cannot_be_written_is_no_fault(tmp_path):
    path = write_model(tmp_path, inline(*meshes.bracket()))
    (tmp_path / FOLDER).write_text("in the way")
    assert [len(pieces) for pieces in compiled(path).pieces.values()] == [2]


def test_a_log_has_the_pieces(tmp_path, monkeypatch):
    """Also those of a version that is no longer there; without them it is refused."""
    path = write_model(tmp_path, inline(*meshes.bracket()))
    wanted = [Decompose(mesh="part")]
    kept = with_pieces(read_model(path), wanted, path.parent, ())
    monkeypatch.setitem(stored._VERSIONS, "planes", "2")
    logged = with_logged_pieces(read_model(path), wanted, kept.files)
    assert logged.files == kept.files
    assert logged.pieces["part"].version == "1"
    with pytest.raises(InputError, match="its pieces by planes are not in the log"):
        with_logged_pieces(read_model(path), wanted, {})


@pytest.mark.parametrize(
    ("wanted", "what"),
    [
        ([Decompose(mesh="parts")], "unknown mesh 'parts'"),
        ([Decompose(mesh="part"), Decompose(mesh="part", method="coacd")], "mesh 'part' is listed twice"),
    ],
)
def test_unknown_meshes_are_faults_of_their_keys(tmp_path, wanted, what):
    path = write_model(tmp_path, inline(*meshes.bracket()))
    with pytest.raises(ScenarioFaults, match=what) as refused:
        with_pieces(read_model(path), wanted, path.parent, ("objects", "part"))
    assert refused.value.faults[0].path == ("objects", "part", "decompose", len(wanted) - 1, "mesh")


def test_bad_meshes_are_refused_by_place(tmp_path):
    vertices, faces = meshes.bracket()
    path = write_model(tmp_path, obj(vertices, faces[1:]))
    with pytest.raises(InputError, match=r"part\.xml:1: mesh 'part' \(part\.obj\): is not closed"):
        compiled(path)
    path = write_model(tmp_path, (f'vertex="{numbers(vertices)}"', {}))
    with pytest.raises(InputError, match=r"part\.xml:1: mesh 'part': has no faces"):
        compiled(path)


@pytest.mark.parametrize("options", [{}, {"method": "prisms", "depth_m": 0.1}])
@pytest.mark.parametrize(("written", "first"), [(obj, 1), (inline, 0), (msh, 0)])
def test_vertices_are_counted_as_in_the_format(tmp_path, written, first, options):
    vertices, faces = meshes.bracket()
    path = write_model(tmp_path, written(vertices, np.vstack(([0, 1, 50], faces))))
    what = f"a face names vertex {50 + first}; it has {len(vertices)}, counted from {first}$"
    with pytest.raises(InputError, match=what):
        compiled(path, **options)


@pytest.mark.parametrize("options", [{}, {"method": "prisms", "depth_m": 0.1}])
def test_a_vertex_that_is_not_finite_is_shown_as_in_the_file(tmp_path, options):
    """Turned and scaled, all its coordinates would be nan."""
    vertices, faces = meshes.bracket()
    vertices[3] = [np.nan, -0.1, 0.06]
    path = write_model(tmp_path, obj(vertices, faces), mesh='scale="2 2 2" refquat="0.8 0 0.6 0"')
    with pytest.raises(
        InputError, match=r"vertex 4, counted from 1, is \(nan -0\.1 0\.06\); every coordinate must be finite"
    ):
        compiled(path, **options)


@pytest.mark.parametrize(
    ("file", "content", "what"),
    [
        ("a.obj", "# a\nv 0 0 0\nv 1 2\n", r"OBJ: line 3 is malformed: 'v 1 2'$"),
        ("a.obj", "v 0 \\\n0 0\r\nv a b c", r"OBJ: line 3 is malformed: 'v a b c'$"),
        ("a.obj", "v 0 0 0\nf 0 1 1", r"OBJ: line 2 is malformed: 'f 0 1 1'$"),
        ("a.obj", "v 0 0 0\nf 1 1 -2", r"OBJ: line 2 is malformed: 'f 1 1 -2'$"),
        ("a.obj", f"v 0 0 0\nf 1 1 {10**30}", r"OBJ: its content is not of this format, or cut off$"),
        ("a.stl", "solid a", r"STL: its content is not of this format, or cut off$"),
        ("a.msh", "", r"MSH: its content is not of this format, or cut off$"),
    ],
)
def test_files_that_cannot_be_read_say_where(tmp_path, file, content, what):
    path = write_model(tmp_path, (f'file="{file}"', {file: content.encode()}))
    with pytest.raises(InputError, match=rf"part\.xml:1: mesh 'part' \({file}\): cannot be read as {what}"):
        compiled(path)


def test_a_missing_package_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(coacd, "installed_version", lambda: None)
    path = write_model(tmp_path, inline(*meshes.bracket()))
    with pytest.raises(InputError, match="'method: coacd' needs the package coacd; install it: ") as refused:
        compiled(path, method="coacd")
    assert len(refused.value.lines) == 1
    assert Path(tmp_path, FOLDER).exists() is False
