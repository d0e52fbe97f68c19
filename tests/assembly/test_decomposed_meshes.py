"""Scenarios with meshes as convex pieces: what check says, runs, their folders and logs."""

from __future__ import annotations

import dataclasses
import shutil

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.decomposition.stored import FOLDER
from ffsm_mj.log.scenario import compile_log, scenario_data
from ffsm_mj.model import decompose
from ffsm_mj.verification.independent.impacts import contact_geometry
from ffsm_mj.verification.independent.scene import LoggedScene
from tests.decomposition import meshes
from tests.replays import assert_passes

PLATE = meshes.plate()
SCENARIO = """name: hole
duration_s: 1.0
time_step_s: 0.005
control_period_s: 0.005
robot: {{mjcf: ball.xml}}
objects: {{plate: {{mjcf: plate.xml{keys}}}}}
contacts: {{default: {{restitution: 1.0}}}}
initial: {{rates: {{ball_joint: [0.0, 0.0, -1.0, 0.0, 0.0, 0.0]}}}}
phases: [{{name: coast, until: end, controller: {{kind: "off"}}}}]
"""


def scenario(folder, *, x=0.0, pieces=True, part=PLATE, fixed=False):
    """A ball of 8 cm flies at a plate with a hole of 20 cm, along the axis of the hole at a distance."""
    numbers, faces = (" ".join(map(repr, array.reshape(-1).tolist())) for array in part)
    (folder / "plate.xml").write_text(
        f'<mujoco><asset><mesh name="plate" vertex="{numbers}" face="{faces}"/></asset><worldbody>'
        f'<body name="plate">{"" if fixed else "<freejoint/>"}<geom name="plate" type="mesh" mesh="plate" density="1000"/>'
        "</body></worldbody></mujoco>"
    )
    (folder / "ball.xml").write_text(
        f'<mujoco><worldbody><body name="ball" pos="{x} 0 0.5"><freejoint/><geom name="ball" size="0.04" mass="1"/>'
        "</body></worldbody></mujoco>"
    )
    path = folder / "hole.yaml"
    keys = (", decompose: {mesh: plate}" if pieces else "") + (", fixed: true" if fixed else "")
    path.write_text(SCENARIO.format(keys=keys))
    return path


def test_check_says_what_collides(tmp_path):
    lines = prepare(scenario(tmp_path)).describe()
    (line,) = [line for line in lines if "pieces by planes" in line]
    assert line.startswith("    plate/plate: 4 pieces by planes 1, at least ")
    assert not any("convex hull" in line for line in lines)
    vertices, faces = meshes.frame()
    hull = prepare(scenario(tmp_path, pieces=False, part=(vertices, faces))).describe()
    # Its hull is a cube of 0.8 m; the middle of a side is 0.37 m off the bars, and some points of the sides are looked at.
    (line,) = [line for line in hull if line.startswith("note: meshes collide as their convex hulls, at least this far off")]
    assert 0.0 < float(line.partition("plate/plate ")[2].removesuffix(" mm")) <= 370.0
    lines = prepare(scenario(tmp_path, part=(vertices, faces))).describe()
    assert not any("convex hull" in line for line in lines)


@pytest.mark.parametrize(("x", "hits"), [(0.0, False), (0.055, False), (0.065, True), (0.2, True)])
def test_a_ball_flies_through_a_hole(tmp_path, x, hits):
    """It touches the rim where its centre is less than its radius from the side of the hole, at 0.1 m."""
    run = ffsm_mj.run(scenario(tmp_path, x=x), out=tmp_path / "out")
    assert bool(run.impacts) == hits
    assert_passes(run)


def test_contact_geometry_is_that_of_the_pieces(tmp_path):
    """The check takes the piece at the point, not the hull: it passes as logged, and fails by an angle put in.

    With the ball of radius r moved away by d along a normal that is off by a, the line between the nearest points is off by
    a r / (r + d); the least of some distances up to 0.2 m counts.
    """
    run = ffsm_mj.run(scenario(tmp_path, x=0.065), out=tmp_path / "out")
    system, (record,) = compile_log(run.log), run.impacts
    angle = 1e-3
    x, y, z = record.normal
    turned = (x * np.cos(angle) - z * np.sin(angle), y, x * np.sin(angle) + z * np.cos(angle))
    for normal, residual in ((record.normal, 0.0), (turned, angle * 0.04 / 0.24)):
        log = dataclasses.replace(run.log, events=[dataclasses.replace(record, normal=normal)])
        scene = LoggedScene(log, run.log.header.layout, system, scenario_data(run.log))
        (finding,) = contact_geometry(scene)
        assert finding.residual == pytest.approx(residual, abs=1e-7)


def test_run_folder_and_log_need_no_other_files(tmp_path, monkeypatch):
    """A rerun from the folder and a compilation from the log take the pieces that the run had."""
    (tmp_path / "work").mkdir()
    run = ffsm_mj.run(scenario(tmp_path / "work", x=0.2), out=tmp_path / "out")
    (kept,) = (tmp_path / "work" / FOLDER).iterdir()
    assert (tmp_path / "out" / "mjcf" / "plate" / FOLDER / kept.name).read_bytes() == kept.read_bytes()
    shutil.rmtree(tmp_path / "work")
    decompose._decomposed.cache_clear()
    monkeypatch.setattr(decompose, "decompose", None)
    again = ffsm_mj.run(tmp_path / "out", out=tmp_path / "again")
    np.testing.assert_array_equal(again.log.rows, run.log.rows)
    system = compile_log(ffsm_mj.load_run(tmp_path / "again").log)
    (pieces,) = system.pieces.values()
    assert len(pieces) == 4


@pytest.mark.parametrize("shape", ['type="sphere" size="0.04"', 'type="box" size="0.03 0.04 0.04" euler="0 0 20"'])
def test_a_body_slides_over_the_seams_of_a_plate(tmp_path, shape):
    """One impact without restitution, then a straight way over the seams of the pieces beside the hole, without an event."""
    path = scenario(tmp_path, fixed=True)
    ball = (tmp_path / "ball.xml").read_text()
    (tmp_path / "ball.xml").write_text(ball.replace('size="0.04"', shape).replace('pos="0.0 0 0.5"', 'pos="0.2 -0.25 0.1"'))
    text = path.read_text().replace("restitution: 1.0", "restitution: 0.0").replace("0.0, 0.0, -1.0,", "0.01, 0.5, -0.2,")
    path.write_text(text)
    run = ffsm_mj.run(path, out=tmp_path / "out")
    assert len({record.event for record in run.impacts}) == 1
    # It falls 4 cm at 0.2 m/s, and keeps what it has along the plate.
    (time_s,) = {record.time_s for record in run.impacts}
    assert time_s == pytest.approx(0.2, abs=1e-9)
    last = run.log.rows[-1]
    place = [last[run.log.header.layout.index[f"state.q_robot_ball_joint_{axis}_m"]] for axis in "xyz"]
    np.testing.assert_allclose(place, [0.21, 0.25, 0.06], atol=1e-9)
    assert_passes(run)
