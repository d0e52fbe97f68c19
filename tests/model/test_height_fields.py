"""Prisms of the height fields of fixed objects: the numbers of the file, in double precision, where MuJoCo has them."""

from __future__ import annotations

import io
import struct
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image

from ffsm_mj.model.composition import compile_system
from ffsm_mj.model.files import read_model
from ffsm_mj.model.properties import Pose
from tests.scenes import ball

X, Y, TOP, BASE = 1.5, 1.0, 0.3, 0.1
ROWS, COLUMNS = 4, 7


def compiled(folder: Path, field: str, *, fixed: bool = True):
    """A ball and an object with a height field of some attributes."""
    free = "" if fixed else '<freejoint name="free"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    asset = f'<hfield name="field" size="{X} {Y} {TOP} {BASE}" {field}/>'
    (folder / "ground.xml").write_text(
        f"""<mujoco><asset>{asset}</asset><worldbody><body name="ground">{free}
        <geom name="ground" type="hfield" hfield="field" pos="1 2 3" mass="0"/></body></worldbody></mujoco>"""
    )
    (folder / "ball.xml").write_text(ball())
    ground = replace(read_model(folder / "ground.xml"), pose=Pose() if fixed else None)
    return compile_system(read_model(folder / "ball.xml"), {"ground": ground}, time_step_s=1e-3)


def written(numbers):
    """A slope as elevations of a file, whose first row is the one at the greatest y."""
    rows = "  ".join(" ".join(f"{x:.2f}" for x in row) for row in numbers[::-1])
    return f'nrow="{ROWS}" ncol="{COLUMNS}" elevation="{rows}"'


SLOPE = np.array([[0.1 * column + 0.07 * row for column in range(COLUMNS)] for row in range(ROWS)])


def in_a_file(folder, numbers):
    (folder / "slope.bin").write_bytes(struct.pack("ii", ROWS, COLUMNS) + numbers.astype("<f4").tobytes())
    return 'file="slope.bin"'


@pytest.mark.parametrize("where", ["text", "binary file"])
def test_a_slope_of_even_steps_is_one_plane(tmp_path, where):
    """In single precision 0.1 is not a third of 0.3: as MuJoCo has them its triangles are in many planes."""
    system = compiled(tmp_path, written(SLOPE) if where == "text" else in_a_file(tmp_path, SLOPE))
    (prism,) = system.pieces[system.index("geom", "ground/ground")]
    slope = np.array([0.1 * (COLUMNS - 1) / (2 * X), 0.07 * (ROWS - 1) / (2 * Y)]) * TOP / SLOPE.max()
    normal = np.array([*-slope, 1.0]) / np.sqrt(1.0 + slope @ slope)
    # Rounding of some operations on numbers of 1.
    assert prism.normals[0] == pytest.approx(normal, abs=1e-15)
    assert prism.offsets[0] == pytest.approx(normal @ (X, Y, TOP), abs=1e-15)
    assert prism.offsets[1] == BASE


def test_an_image_has_its_levels(tmp_path):
    """White is high and the top row is at the greatest y: levels 51 to 204 of a slope of even steps are one plane."""
    levels = np.array([[51 + 17 * column + 17 * row for column in range(COLUMNS)] for row in range(ROWS)], dtype=np.uint8)
    with io.BytesIO() as buffer:
        Image.fromarray(levels[::-1]).save(buffer, "png")
        (tmp_path / "slope.png").write_bytes(buffer.getvalue())
    system = compiled(tmp_path, 'file="slope.png"')
    (prism,) = system.pieces[system.index("geom", "ground/ground")]
    slope = np.array([TOP * 6 / 9 / (2 * X), TOP * 3 / 9 / (2 * Y)])
    assert -prism.normals[0, :2] / prism.normals[0, 2] == pytest.approx(slope, abs=1e-15)


@pytest.mark.parametrize("seed", range(2))
def test_prisms_are_where_mujoco_has_the_field(tmp_path, seed):
    """A ray from above meets the surface of MuJoCo, in single precision, at the height of the prism there."""
    rng = np.random.default_rng(seed)
    system = compiled(tmp_path, written(rng.uniform(0.0, 1.0, (ROWS, COLUMNS))))
    pieces = system.pieces[system.index("geom", "ground/ground")]
    data = mujoco.MjData(system.mj)
    mujoco.mj_forward(system.mj, data)
    for _ in range(30):
        place = rng.uniform(-1.0, 1.0, 2) * (X, Y)
        above, down = np.array([place[0] + 1.0, place[1] + 2.0, 9.0]), np.array([0.0, 0.0, -1.0])
        hit = mujoco.mj_ray(system.mj, data, above, down, None, 1, 0, np.zeros(1, np.int32))
        heights = []
        for piece in pieces:
            outside = piece.normals[2:] @ (*place, 0.0) - piece.offsets[2:]
            if outside.max() <= 0.0:
                heights.append((piece.offsets[0] - piece.normals[0, :2] @ place) / piece.normals[0, 2])
        assert heights == pytest.approx([9.0 - hit - 3.0] * len(heights), abs=1e-6)
        assert heights


def test_one_that_moves_has_none(tmp_path):
    assert compiled(tmp_path, written(SLOPE), fixed=False).pieces == {}
