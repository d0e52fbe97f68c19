"""Scenarios with terrain: height fields of fixed objects and open meshes as prisms, in impacts and in persistent contact."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import InputError
from ffsm_mj.log.drawing import shapes
from tests.replays import proved

BALL = """<mujoco><worldbody><body name="ball"><freejoint name="free"/><geom name="ball" size="0.1" mass="1"/></body>
  </worldbody></mujoco>"""
BOX = """<mujoco><worldbody><body name="ball"><inertial pos="0 0 0" mass="2" diaginertia="0.008 0.008 0.008"/>
  <freejoint name="free"/><geom name="ball" type="box" size="0.1 0.1 0.1" mass="0"/></body></worldbody></mujoco>"""
SIZE = np.array([1.5, 1.0, 0.3, 0.2])
ROWS, COLUMNS = 4, 7


def field(heights):
    """MJCF of a height field; its heights as shares of the greatest, row by row from the greatest y."""
    rows = "  ".join(" ".join(map(repr, row)) for row in heights[::-1].tolist())
    shape = f'nrow="{heights.shape[0]}" ncol="{heights.shape[1]}"'
    return (
        f'<mujoco><asset><hfield name="ground" {shape} size="1.5 1 0.3 0.2" elevation="{rows}"/></asset><worldbody>'
        '<geom name="ground" type="hfield" hfield="ground"/></worldbody></mujoco>'
    )


def sheet(points, faces):
    """MJCF of an open mesh."""
    vertices, corners = (" ".join(map(repr, np.asarray(numbers).reshape(-1).tolist())) for numbers in (points, faces))
    return (
        f'<mujoco><asset><mesh name="ground" inertia="shell" vertex="{vertices}" face="{corners}"/></asset><worldbody>'
        '<geom name="ground" type="mesh" mesh="ground"/></worldbody></mujoco>'
    )


def scenario(folder, ground, place, rate, *, robot=BALL, e=1.0, duration_s=1.0, more="", fixed="fixed: true"):
    (folder / "ball.xml").write_text(robot)
    (folder / "ground.xml").write_text(ground)
    path = folder / "terrain.yaml"
    path.write_text(
        f"""name: terrain
duration_s: {duration_s}
time_step_s: 0.005
control_period_s: 0.005
robot: {{mjcf: ball.xml}}
objects: {{ground: {{mjcf: ground.xml, {fixed}{more}}}}}
contacts: {{default: {{restitution: {e}}}}}
initial:
  joints: {{robot/free: [{", ".join(map(str, place))}, 1.0, 0.0, 0.0, 0.0]}}
  rates: {{robot/free: [{", ".join(map(str, rate))}, 0.0, 0.0, 0.0]}}
phases: [{{name: coast, until: end, controller: {{kind: "off"}}}}]
"""
    )
    return path


def velocity(run):
    return run.qvel[-1, :3]


@pytest.mark.parametrize("column", [0.3, 2.0, 3.5])
def test_a_ball_bounces_off_a_slope_as_off_a_plane(tmp_path, column):
    """At the middle of a triangle, at a grid line and on a diagonal: the mirror image of its velocity, when it is due."""
    slope = np.arange(COLUMNS) / (COLUMNS - 1) + np.zeros((ROWS, 1))
    normal = np.array([-SIZE[2] / (2 * SIZE[0]), 0.0, 1.0])
    normal /= np.linalg.norm(normal)
    hit = np.array([-SIZE[0] + 2 * SIZE[0] * column / (COLUMNS - 1), 1.0 / 3.0, SIZE[2] * column / (COLUMNS - 1)])
    rate = np.array([0.2, -0.1, -1.0])
    start = hit + 0.1 * normal - 0.4 * rate
    run = proved(ffsm_mj.run(scenario(tmp_path, field(slope), start, rate)))
    (impact,) = run.impacts
    # Event location ends at gaps of 1e-13 m, at 1 m/s.
    assert impact.time_s == pytest.approx(0.4, abs=1e-12)
    assert velocity(run) == pytest.approx(rate - 2.0 * (rate @ normal) * normal, abs=1e-12)


def test_a_ball_bounces_off_the_triangle_that_it_hits(tmp_path):
    heights = np.random.default_rng(8).uniform(0.0, 1.0, (ROWS, COLUMNS))
    heights[0, 0], heights[-1, -1] = 0.0, 1.0
    a, b, c = heights[1, 2], heights[1, 3], heights[2, 3]  # right below a diagonal
    x, y = 2 * SIZE[0] / (COLUMNS - 1), 2 * SIZE[1] / (ROWS - 1)
    normal = np.array([-(b - a) * SIZE[2] / x, -(c - b) * SIZE[2] / y, 1.0])
    normal /= np.linalg.norm(normal)
    hit = np.array([-SIZE[0] + x * (2 + 2 / 3), -SIZE[1] + y * (1 + 1 / 3), SIZE[2] * (a + b + c) / 3.0])
    # A small ball that comes along the normal touches nothing else.
    run = proved(
        ffsm_mj.run(
            scenario(
                tmp_path, field(heights), hit + 0.31 * normal, -normal, robot=BALL.replace("0.1", "0.01"), duration_s=0.5
            )
        )
    )
    (impact,) = run.impacts
    assert impact.time_s == pytest.approx(0.3, abs=1e-12)
    assert velocity(run) == pytest.approx(normal, abs=1e-12)


def test_a_box_slides_over_the_seams_of_a_flat_field(tmp_path):
    """From one prism to others, whose lines cross its way, without impact: a bump far from it parts the plane."""
    heights = np.zeros((ROWS, COLUMNS))
    heights[3, 0] = 1.0
    heights[0, 6] = 0.0
    run = ffsm_mj.run(scenario(tmp_path, field(heights), (0.2, 0.1, 0.1), (0.5, -0.2, 0.0), robot=BOX, e=0.0))
    proved(run)
    assert len(prepare(tmp_path / "terrain.yaml").system.pieces) == 1
    assert len(next(iter(prepare(tmp_path / "terrain.yaml").system.pieces.values()))) > 3
    assert run.impacts == ()
    assert run.qpos[-1, :3] == pytest.approx((0.7, -0.1, 0.1), abs=1e-12)


def test_the_surface_of_a_height_field_is_drawn(tmp_path):
    """Its area along z is that of the field, its heights at grid points are those of the field."""
    heights = np.random.default_rng(4).uniform(0.0, 1.0, (ROWS, COLUMNS))
    system = prepare(scenario(tmp_path, field(heights), (0, 0, 2), (0, 0, 0))).system
    (ground,) = [shape for shape in shapes(system) if shape.name == "ground"]
    a, b, c = ground.vertices[ground.triangles].swapaxes(0, 1)
    assert 0.5 * np.cross(b - a, c - a)[:, 2].sum() == pytest.approx(4.0 * SIZE[0] * SIZE[1], rel=1e-14)
    shares = (heights - heights.min()) / np.ptp(heights)
    assert set(np.round(ground.vertices[:, 2], 12)) == set(np.round(SIZE[2] * shares.ravel(), 12))


ROOF = np.array([[-1.0, -1, 0], [0, -1, 0.5], [1, -1, 0], [-1, 1, 0], [0, 1, 0.5], [1, 1, 0]])
TRIANGLES = [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]]
PRISMS = ", decompose: {mesh: ground, method: prisms, depth_m: 0.2}"


def test_a_ball_bounces_off_an_open_mesh_of_prisms(tmp_path):
    normal = np.array([0.5, 0.0, 1.0]) / np.sqrt(1.25)
    start = np.array([0.4, 0.0, 0.3]) + 0.4 * normal
    path = scenario(tmp_path, sheet(ROOF, TRIANGLES), start, -normal, duration_s=0.6, more=PRISMS)
    run = proved(ffsm_mj.run(path))
    (impact,) = run.impacts
    assert impact.time_s == pytest.approx(0.3, abs=1e-12)
    assert velocity(run) == pytest.approx(normal, abs=1e-12)
    assert any("ground/ground: 4 pieces by prisms 1" in line for line in prepare(path).describe())


@pytest.mark.parametrize(
    ("ground", "more", "fixed", "message"),
    [
        (sheet(ROOF, TRIANGLES), PRISMS, "fixed: false", "'method: prisms' is for objects with 'fixed: true'"),
        (sheet(ROOF, TRIANGLES), ", decompose: {mesh: ground, method: prisms}", "fixed: true", "'depth_m'"),
        (sheet(ROOF, TRIANGLES), PRISMS.replace("prisms,", "planes,"), "fixed: true", "'depth_m'"),
        (
            sheet(ROOF[:5], [[0, 1, 2], [2, 1, 4], [0, 2, 4], [0, 4, 1]]),
            PRISMS,
            "fixed: true",
            "closed mesh has no upper side",
        ),
    ],
)
def test_what_is_no_terrain_is_refused(tmp_path, ground, more, fixed, message):
    with pytest.raises(InputError, match=message):
        prepare(scenario(tmp_path, ground, (0, 0, 2), (0, 0, 0), more=more, fixed=fixed))
