"""Content of a page of ``ffsm export --html``; :mod:`tests.browser` tests its display."""

from __future__ import annotations

import json
import re
import sys
import zlib
from base64 import b64decode
from dataclasses import replace

import msgpack
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run import Run
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.contact_models.impact.records import IMPACT
from ffsm_mj.errors import MissingPackageError
from ffsm_mj.log.drawing import shapes
from ffsm_mj.log.markers import DrawnMark
from ffsm_mj.records.kinds import Mark
from ffsm_mj.records.signals import Layout, Signal, coordinate_keys
from ffsm_mj.report.page import scene, write_page
from ffsm_mj.report.page.document import _check
from ffsm_mj.report.page.scene import Poses, plumes
from ffsm_mj.report.page.solids import arrow_solid, triangles
from tests.changed_logs import with_records
from tests.contact_models.grasp.scenes import grasping
from tests.log.markers import scale_of
from tests.log.test_viewer_topics import ALL_SHAPES
from tests.scenes import CHAIN, HEAD, compile_paths, three_balls, two_balls


@pytest.fixture(scope="module", autouse=True)
def one_figure():
    """Limit a page to one figure: figures take most of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("ffsm_mj.report.page.document._FIGURES", {"energies": "Energies"})
        yield


@pytest.fixture(scope="module")
def hit(tmp_path_factory):
    return ffsm_mj.run(two_balls(tmp_path_factory.mktemp("hit"), duration_s=0.5, gap=0.0123456))


@pytest.fixture(scope="module")
def page(hit, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "run.html"
    assert write_page(hit, path).startswith("27 poses over 0.5 s, 1 of them at events, ")
    return path


def part(page, name):
    return re.search(rf'<script type="[a-z/]+" id="{name}">(.*?)</script>', page.read_text())[1]


def drawn(page):
    """Objects of the scene, as K3D's viewer gets them."""
    return msgpack.unpackb(zlib.decompress(b64decode(part(page, "snapshot"))))["objects"]


def volume(corners, faces):
    """Signed volume, positive if the triangles face outwards."""
    a, b, c = corners[faces].transpose(1, 0, 2)
    return np.sum(a * np.cross(b, c)) / 6


def test_solids_enclose_the_volumes_of_their_geoms(tmp_path):
    """To second order in the angle between edges, 40 per turn: (2 pi / 40)^2 / 6 for a circle, twice that for a ball."""
    (tmp_path / "all.xml").write_text(ALL_SHAPES)
    found = {}
    for shape in shapes(compile_paths(tmp_path / "all.xml")):
        found.setdefault((shape.kind, tuple(shape.size)), volume(*triangles(shape)))
    box, ball, ellipsoid, cylinder, capsule, wedge = found.values()
    assert abs(box - 8 * 0.1 * 0.2 * 0.3) < 1e-12
    assert abs(wedge - 1 / 6) < 1e-6  # MuJoCo keeps corners in single precision
    for made, exact in (
        (ball, 4 / 3 * np.pi * 0.1**3),
        (ellipsoid, 4 / 3 * np.pi * 0.1 * 0.2 * 0.3),
        (cylinder, np.pi * 0.1**2 * 0.4),
        (capsule, np.pi * 0.1**2 * 0.4 + 4 / 3 * np.pi * 0.1**3),
    ):
        assert 0.985 < made / exact < 1.0
    assert volume(*arrow_solid(0.1)) > 0


def test_planes_are_drawn_below_their_surface(tmp_path):
    plane = '<geom type="plane" size="2 0 1" pos="0 0 3" euler="90 0 0"/>'
    body = '<body name="b"><freejoint/><geom size="1"/></body>'
    (tmp_path / "b.xml").write_text(f"<mujoco>{HEAD}<worldbody>{plane}{body}</worldbody></mujoco>")
    system = compile_paths(tmp_path / "b.xml")
    (plane,) = [shape for shape in shapes(system) if shape.kind == "box"]
    corners, _ = triangles(plane)
    np.testing.assert_allclose([corners.min(axis=0), corners.max(axis=0)], [[-2, 0, -7], [2, 2e-3, 13]], atol=1e-9)


def test_a_page_has_the_pose_at_the_exact_time_of_an_event(hit, page):
    """An impact between two of the evenly spaced times; its pose is that of the record."""
    told = json.loads(part(page, "data"))
    (record,) = hit.impacts
    assert told["start"] == record.time_s
    robot = next(each for each in drawn(page) if each["type"] == "Mesh" and "data" not in each["model_matrix"])
    matrix = robot["model_matrix"][repr(1000.0 * record.time_s)]
    x = np.frombuffer(matrix["data"], dtype=matrix["dtype"]).reshape(4, 4)[0, 3]
    assert abs(x - record.qpos[0]) < 1e-7  # single precision


def test_a_page_draws_the_marks_of_all_records(tmp_path):
    """Two impacts: each has an arrow along its impulse, of the drawn length, and a text."""
    run = ffsm_mj.run(three_balls(tmp_path, CHAIN))
    marks = run.log.marks()
    assert len(marks) >= 2
    write_page(run, tmp_path / "x.html")
    objects = drawn(tmp_path / "x.html")
    texts = [each["text"] for each in objects if each["type"] == "Label"]
    assert texts == [f'<span class="mark">{mark.text}</span>' for _, _, mark in marks]
    arrows = [each for each in objects if each["type"] == "Mesh" and isinstance(each["visible"], dict)]
    for each, (_, time, mark) in zip(arrows, marks, strict=True):
        matrix = np.frombuffer(each["model_matrix"]["data"], dtype=np.float32).reshape(4, 4)
        tip = matrix @ [0, 0, 1, 1]
        np.testing.assert_allclose(tip[:3], mark.point_m, atol=1e-6)
        along = scale_of(run) * np.clip(mark.magnitude, 0.4, 1.5) * np.array(mark.direction)
        np.testing.assert_allclose(matrix[:3, 2], along, atol=1e-6)
        assert each["visible"][repr(1000.0 * time)] is True


def test_texts_of_marks_are_escaped():
    drawn = DrawnMark(IMPACT, 0.0, 0, 0, Mark((0.0, 0.0, 0.0), text="<script>x</script>"), np.zeros(3))
    label = scene._label(drawn, [drawn.mark.text], 1.0)
    assert label.text == '<span class="mark">&lt;script&gt;x&lt;/script&gt;</span>'


def test_thrusters_that_fire_have_plumes(tmp_path):
    """A cone from the site of the jet, opposite to its force, while it fires; none for a jet that never fires."""
    system = compile_jets(tmp_path)
    rows = np.zeros((5, 14))
    rows[:, 0], rows[:, 4], rows[1:3, 8] = 0.1 * np.arange(5), 1.0, 1.5
    rows[:, 9:11], rows[:, 12:14] = (0.0, 2.0), (0.0, 2.0)
    names = [f"actuators.robot_{jet}_{what}_N" for jet in ("left", "right") for what in ("applied", "lower", "upper")]
    keys = ["state.time_s", *coordinate_keys(system.joints.values()), *names]
    layout = Layout(tuple(Signal(*key.split("."), "N", "") for key in keys))
    positions, quaternions = np.zeros((5, 2, 3)), np.tile([1.0, 0, 0, 0], (5, 2, 1))
    found = list(plumes(layout, system, Poses(rows[:, 0], rows, positions, quaternions, 0), 0.5))
    (cone,) = found
    assert [time for time, on in cone.visible.items() if on] == ["100.0", "200.0"]
    matrix = cone.model_matrix["100.0"]
    np.testing.assert_allclose(matrix[:3, 3], [0, 0.1, 0], atol=1e-7)
    np.testing.assert_allclose(matrix[:3, 2], [0, 0.5 * 0.9 * 1.5 / 2.0, 0], atol=1e-7)  # 0.9 m at the greatest force, 2 N


def compile_jets(folder):
    """A body with two opposite jets."""
    jets = f"""<mujoco>{HEAD}<worldbody><body name="bus"><freejoint name="free"/><geom size=".1" mass="1"/>
      <site name="left" pos="0 .1 0"/><site name="right" pos="0 -.1 0"/></body></worldbody><actuator>
      <motor name="left" site="left" gear="0 -1 0 0 0 0"/><motor name="right" site="right" gear="0 1 0 0 0 0"/>
      </actuator></mujoco>"""
    (folder / "jets.xml").write_text(jets)
    return compile_paths(folder / "jets.xml")


def test_a_page_lists_grasps(hit, tmp_path):
    """With both times and the impulse on the object, as the records have them; without a grasp there is no such row."""
    run = ffsm_mj.run(grasping(tmp_path))
    (closed,), (released,) = run.records["grasp_impulses"], run.records["releases"]
    write_page(run, tmp_path / "run.html")
    page = (tmp_path / "run.html").read_text()
    times = f"{closed.time_s:.6f} s to {released.time_s:.6f} s"
    assert f">{times}: grasp, {np.linalg.norm(closed.impulse_N_s):.4g} N s at closing<" in page
    assert ">grasps</th>" not in hit._repr_html_()


def test_a_page_lists_the_checks(hit, page):
    text = page.read_text()
    assert text.count('<tr class="passes">') == len(all_checks(hit))
    assert f"all {len(all_checks(hit))} checks pass" in text
    assert text.count("<figure>") == 1
    assert "http:" not in re.sub(r'xmlns(:xlink)?="[^"]*"', "", text)  # but for what K3D's own code names, packed


def test_checks_that_pass_and_fail_have_styles_of_their_own(hit, page):
    """The rows of both kinds name classes that the style sheet of the page contains."""
    (check, *_) = all_checks(hit)
    rows = [_check(check), _check(replace(check, residual=1.0))]
    classes = [re.search('<tr class="([a-z]+)">', row)[1] for row in rows]
    assert len(set(classes)) == 2
    assert all(f".{name} td" in page.read_text() for name in classes)


def test_the_same_run_gives_the_same_page(hit, page, tmp_path):
    write_page(hit, tmp_path / "x.html")
    a, b = page.read_text(), (tmp_path / "x.html").read_text()
    assert re.sub('id="snapshot">.*?<', "", a) == re.sub('id="snapshot">.*?<', "", b)


def test_without_k3d_the_extra_is_named(hit, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "k3d", None)
    with pytest.raises(MissingPackageError, match=r"--html needs the package k3d; install .* --inexact --extra html"):
        write_page(hit, tmp_path / "x.html")
    assert not (tmp_path / "x.html").exists()


def test_a_run_that_diverged_is_drawn(hit, tmp_path):
    """A page contains only numbers that JSON and browsers accept."""
    rows = hit.log.rows.copy()
    rows[100:, 1:] = np.nan
    rows[50:100, 1] = 1e300
    (record,) = hit.impacts
    lost = replace(record, point_m=(np.inf, 0.0, 0.0), qpos=(np.nan, 0.0))
    log = with_records(replace(hit.log, rows=rows), {"impacts": (lost,)})
    write_page(Run(log), tmp_path / "x.html")
    told = json.loads(part(tmp_path / "x.html", "data"), parse_constant=pytest.fail)
    assert np.isfinite([*told["centre"], *told["to_eye"]]).all()
    for each in drawn(tmp_path / "x.html"):
        matrices = [each["model_matrix"]] if "data" in each["model_matrix"] else each["model_matrix"].values()
        assert all(np.isfinite(np.frombuffer(matrix["data"], dtype=np.float32)).all() for matrix in matrices)
