"""Models with values that MuJoCo accepts, or hangs on, but a run cannot use: one line with file, line and element."""

from __future__ import annotations

import re

import pytest

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import InputError
from tests.scenes import ball, scene

_BODY = '<body name="ball">'


def faults(folder, robot, **scenario):
    """Lines of the error for a robot."""
    with pytest.raises(InputError) as caught:
        prepare(scene(folder, robot, {"target": ball("target")}, **scenario))
    return caught.value.lines


def with_asset(text):
    return ball("ball", joints="x").replace("<worldbody>", f"<asset>{text}</asset><worldbody>")


def with_body(text):
    return ball("ball", joints="x", extra=text)


@pytest.mark.parametrize(
    ("robot", "expected"),
    [
        (
            ball("ball").replace('mass="1.0"', 'mass="nan"'),
            ".xml:2: <inertial mass='nan'>: every number must be finite",
        ),
        (ball("ball").replace('type="sphere"', 'type="sphere" rgba="-inf 0 0 1"'), "<geom rgba='-inf 0 0 1'>: every number"),
        (with_asset('<mesh name="m" vertex="nan 0 0 1 0 0 0 1 0 0 0 1"/>'), "<mesh vertex='nan 0 0 1 0"),
        (
            with_asset('<hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/>'),
            "the images of the model have more than",
        ),
        (
            with_asset('<texture name="t" type="2d" builtin="flat" width="90000" height="9000"/>'),
            "the images of the model have more than",
        ),
        (with_body('<replicate count="100000000"><geom size="1"/></replicate>'), "more than 200000 elements"),
        (
            with_body('<replicate count="9000">' * 3 + '<geom size="1"/>' + "</replicate>" * 3),
            "more than 200000 elements",
        ),
        (ball("ball").replace("<worldbody>", '<size memory="100G"/><worldbody>'), "<size memory='100G'> requests more"),
        (
            ball("ball").replace("<worldbody>", '<size nuser_geom="1000000"/><worldbody>'),
            "<size nuser_geom='1000000'> requests",
        ),
        (ball("ball").replace('type="sphere"', 'type="sphere" class="%s%n"'), "must not contain a percent sign; rename it"),
        (ball("ball", mass=1e300), "robot.xml:1: body 'ball' has a mass or inertia of 1e+300; at most 1e+20 kg"),
        (with_body('<geom name="far" size="1e20" mass="0"/>'), "geom 'far' has a length of 1e+20 m; at most 1e+10 m"),
        (
            with_body('<geom name="red" size="1" rgba="255 0 0 1" mass="0"/>'),
            "geom 'red' has rgba 255 0 0 1; each is",
        ),
        (with_asset('<material name="red" rgba="2 0 0 1"/>'), "material 'red' has rgba 2 0 0 1; each is from 0 to 1"),
        (
            ball("ball").replace("</worldbody>", '</worldbody><contact><pair geom1="ball" geom2="ball"/></contact>'),
            "geom 'ball' is in a <contact><pair> with itself; remove it",
        ),
        (
            ball("ball").replace("</mujoco>", "<compiler/></mujoco>").replace("<worldbody>", "<worldbody><compiler/>"),
            "Element",
        ),
    ],
)
def test_one_line_with_file_and_element(tmp_path, robot, expected):
    (line,) = faults(tmp_path, robot)
    assert line.startswith(f"{tmp_path / 'robot.xml'}")
    assert expected in line
    assert "line 0" not in line


def test_a_percent_sign_in_a_file_name_is_refused(tmp_path):
    path = scene(tmp_path, ball("ball"), {"target": ball("target")})
    path.write_text(path.read_text().replace('"robot.xml"', '"%n.xml"'))
    (tmp_path / "%n.xml").write_text(ball("ball"))
    with pytest.raises(InputError, match="the name of a model file must not contain a percent sign"):
        prepare(path)


def test_keyframes_need_no_name(tmp_path):
    keys = "</worldbody><keyframe><key/><key/></keyframe>"
    prepare(scene(tmp_path, ball("ball").replace("</worldbody>", keys), {"target": ball("target")}))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('<tendon><fixed stiffness="1"><joint joint="x" coef="1"/></fixed></tendon>', "tendon of 'x' has stiffness"),
        ('<equality><joint joint1="x"/></equality>', "equality joint of 'x' couples joint 'robot/x' of a base"),
    ],
)
def test_elements_without_a_name_are_found_too(tmp_path, text, expected):
    (line,) = faults(tmp_path, ball("ball", joints="x").replace("</worldbody>", f"</worldbody>{text}"))
    assert line.startswith(f"{tmp_path / 'robot.xml'}:")
    assert expected in line


def test_a_name_may_look_like_a_number(tmp_path):
    prepare(scene(tmp_path, with_body('<site name="nan"/>'), {"target": ball("target")}))


def test_a_singular_mass_matrix_is_refused(tmp_path):
    """Two joints about one axis have equal columns in the mass matrix."""
    twice = with_body(
        '<body name="tip"><joint name="a" axis="0 0 1"/><joint name="b" axis="0 0 1"/><geom size="0.1"/></body>'
    )
    (line,) = faults(tmp_path, twice)
    assert ": initial: the mass matrix is singular to " in line
    assert "at joint 'robot/b'" in line or "at joint 'robot/a'" in line


def test_an_inertia_below_rounding_is_refused(tmp_path):
    """1e-12 kg m^2 about one axis of a body turned in space and 1e6 about the others: the sum knows it to 1e-10."""
    needle = re.sub('diaginertia="[^"]*"', 'diaginertia="1e-12 1e6 1e6" euler="10 20 30"', ball("ball", joints="x"))
    pair = {"between": ["ball", "target/target"]}
    start = {"joints": {"target/free": [2, 0, 0, 1, 0, 0, 0]}}
    (line,) = faults(tmp_path, needle, contacts={"rules": [pair]}, initial=start)
    assert "contacts.rules.0: a moment of inertia of robot/ball or target/target is less than rounding of the others" in line


def test_warnings_of_mujoco_are_not_printed(tmp_path, capfd):
    deprecated = ball("ball").replace("<worldbody>", '<statistic meaninertia="3"/><worldbody>')
    prepare(scene(tmp_path, deprecated, {}))
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("name", ["model", "model.obj", "model.mjb"])
def test_the_format_of_a_model_follows_from_its_suffix(tmp_path, name):
    path = scene(tmp_path, ball("ball"), {"target": ball("target")})
    path.write_text(path.read_text().replace('"robot.xml"', f'"{name}"'))
    (tmp_path / name).write_text(ball("ball"))
    with pytest.raises(InputError, match=r"not the name of a model file: MJCF ends in \.xml, URDF in \.urdf"):
        prepare(path)
