"""Which geoms viewers show, in which colours, and how large markers are."""

from __future__ import annotations

import numpy as np
import pytest

from ffsm_mj.log.drawing import NOMINAL_M, colour_of, geoms_to_draw, marker_scale, shapes
from ffsm_mj.log.palette import ROBOT, WHITE, mixed, object_colour, shares
from tests.scenes import HEAD, compile_paths

HULL = '<geom name="hull" type="box" size=".1 .1 .2" mass="1"/>'


def link(geoms: str) -> str:
    return f"""<mujoco>{HEAD}<asset>
      <texture name="checks" type="2d" builtin="checker" rgb1="1 0 0" rgb2="0 0 1" width="8" height="8"/>
      <material name="steel" rgba=".2 .3 .4 1"/><material name="tiles" texture="checks" rgba="1 1 1 .5"/></asset>
      <worldbody><body name="link"><freejoint name="free"/>{geoms}</body></worldbody></mujoco>"""


def drawn(system):
    return {system.mj.geom(geom).name.removeprefix("robot/") for geom in geoms_to_draw(system.mj)}


@pytest.fixture
def compiled(tmp_path):
    def compile_link(geoms: str):
        (tmp_path / "link.xml").write_text(link(geoms))
        return compile_paths(tmp_path / "link.xml")

    return compile_link


NO_CONTACT = 'contype="0" conaffinity="0" mass="0"'


@pytest.mark.parametrize(
    ("geoms", "shown"),
    [
        # A shell of two parts covers the hull, each about half of it, as the meshes of a vendor's link do.
        (
            f'{HULL}<geom name="low" type="box" size=".1 .1 .1" pos="0 0 -.1" {NO_CONTACT}/>'
            f'<geom name="high" type="box" size=".1 .1 .1" pos="0 0 .1" {NO_CONTACT}/>',
            {"low", "high"},
        ),
        # A dish on the hull is decoration: the hull is what one sees.
        (f'{HULL}<geom name="dish" type="ellipsoid" size=".1 .1 .02" pos="0 0 .22" {NO_CONTACT}/>', {"hull", "dish"}),
        # A collision geom as large as another one hides nothing.
        (f'{HULL}<geom name="same" type="box" size=".1 .1 .2" mass="0"/>', {"hull", "same"}),
        # Group 3 is not drawn, unless there is nothing else.
        (f'{HULL}<geom name="pad" size=".05" group="3"/>', {"hull"}),
        ('<geom name="only" size=".05" group="3"/>', {"only"}),
    ],
)
def test_visual_geoms_are_shown_instead_of_the_collision_geoms_that_they_cover(compiled, geoms, shown):
    assert drawn(compiled(geoms)) == shown


@pytest.mark.parametrize(("angle", "shown"), [(0, {"hull", "shell"}), (90, {"shell"})])
def test_a_visual_geom_covers_the_hull_in_its_own_frame(compiled, angle, shown):
    """Two equal plates: across each other they share a fifth of their boxes, along each other everything."""
    hull = '<geom name="hull" type="box" size=".02 .1 .2" mass="1"/>'
    assert (
        drawn(compiled(f'{hull}<geom name="shell" type="box" size=".2 .1 .02" euler="0 {angle} 0" {NO_CONTACT}/>')) == shown
    )


def test_colours_are_those_of_mujoco(compiled):
    """A geom's own colour, else that of its material; a texture counts with its mean: half red, half blue."""
    geom = '<geom name="{}" size=".1" material="{}" {}/>'
    looks = (("own", "steel", 'rgba="1 0 0 1"'), ("steel", "steel", ""), ("tiles", "tiles", ""))
    system = compiled("".join(geom.format(*look) for look in looks))
    found = [colour_of(system, system.index("geom", name)) for name in ("own", "steel", "tiles")]
    # Colours are single precision, and texels integers.
    np.testing.assert_allclose(found, [(1, 0, 0, 1), (0.2, 0.3, 0.4, 1), (0.5, 0, 0.5, 0.5)], atol=5e-3)


def test_bodies_without_colours_have_tints_of_the_colours_of_figures(tmp_path):
    """Robot and object differ, and so do successive links."""
    link = '<body name="{}" pos="1 0 0"><{} name="j"/><geom size=".1"/>{}</body>'
    arm, rock = link.format("a", "freejoint", link.format("b", 'joint type="hinge"', "")), link.format("c", "freejoint", "")
    for name, bodies in (("robot", arm.replace('name="j"', 'name="f"', 1)), ("rock", rock)):
        (tmp_path / f"{name}.xml").write_text(f"<mujoco>{HEAD}<worldbody>{bodies}</worldbody></mujoco>")
    system = compile_paths(tmp_path / "robot.xml", {"rock": tmp_path / "rock.xml"})
    root, link_, rock = (colour_of(system, geom) for geom in range(3))
    assert root == shares(mixed(ROBOT, WHITE, 0.25))
    assert link_ == shares(mixed(ROBOT, WHITE, 0.45))
    assert rock == shares(mixed(object_colour(0), WHITE, 0.25))


@pytest.mark.parametrize("size", [0.01, 1.0, 300.0])
def test_markers_scale_with_the_robot(compiled, size):
    """The diagonal of a cube of edge 2a is 2 sqrt(3) a; geoms are stored in double precision."""
    system = compiled(f'<geom type="box" size="{size} {size} {size}"/>')
    assert marker_scale(system) == pytest.approx(2.0 * np.sqrt(3.0) * size / NOMINAL_M, rel=1e-12)


OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvn 0 0 -1\nvn 0 -1 0\nvn -1 0 0\nvn .577350 .577350 .577350\n"
FACES = "f 1//1 3//1 2//1\nf 1//2 2//2 4//2\nf 1//3 4//3 3//3\nf 2//4 3//4 4//4\n"


def test_meshes_have_the_normals_of_their_files(tmp_path):
    """A tetrahedron with four flat faces: each corner of a face has its normal. MuJoCo keeps both in single precision."""
    (tmp_path / "wedge.obj").write_text(OBJ + FACES)
    mesh, body = (
        '<mesh name="wedge" file="wedge.obj"/>',
        '<body name="b"><freejoint/><geom type="mesh" mesh="wedge"/></body>',
    )
    (tmp_path / "b.xml").write_text(f"<mujoco>{HEAD}<asset>{mesh}</asset><worldbody>{body}</worldbody></mujoco>")
    (shape,) = shapes(compile_paths(tmp_path / "b.xml"))
    assert shape.vertices.shape == shape.normals.shape == (12, 3)
    a, b, c = shape.vertices[shape.triangles.T]
    flat = np.cross(b - a, c - a)
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    np.testing.assert_allclose(shape.normals[shape.triangles], np.repeat(flat[:, None], 3, axis=1), atol=1e-5)
