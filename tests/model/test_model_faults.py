"""Faults name an element with its file and line, also for values that MuJoCo accepts or hangs on, but a run cannot use."""

from __future__ import annotations

import re

import pytest

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import InputError
from tests.model.test_model_files import write
from tests.scenes import HEAD, ball, compile_paths, scene

ATTACH = '<attach model="sub" body="s" prefix="{0}"/>'
SUB = f"""<mujoco>{HEAD}
<default><joint damping="-2"/></default><asset>{{asset}}</asset>
<worldbody><body name="s">
<joint name="j"/><geom name="g" size="0.1" mass="1"/>
<body name="tip" pos="0.3 0 0">

<joint axis="0 1 0"/>
<geom size="0.1" mass="1"/><site name="a"/><site name="z" pos="1 0 0"/>{{inner}}</body></body></worldbody>
<tendon>
<spatial damping="-2"><site site="a"/><site site="z"/></spatial></tendon>
<equality>
<weld body1="s" body2="tip"/>
<connect name="pin" body1="s" body2="tip" anchor="0 0 0"/></equality>
</mujoco>"""


def told(folder) -> list[str]:
    with pytest.raises(InputError) as error:
        compile_paths(folder / "r.xml")
    return [line.removeprefix(f"{folder}/").split("; remove it")[0] for line in error.value.lines]


def test_each_element_with_its_own_file_and_line(tmp_path):
    nested = SUB.format(asset="", inner="")
    write(
        tmp_path,
        r_dot_xml=f"""<mujoco>{HEAD}<asset><model name="sub" file="sub/s.xml"/></asset><include file="inc.xml"/>
<worldbody><body name="r"><freejoint/><geom size="0.1"/><include file="b.xml"/>{ATTACH.format("one_")}</body></worldbody>
<equality><weld body1="one_s" body2="b"/></equality></mujoco>""",
        inc_dot_xml="""<mujocoinclude>

<tendon><fixed damping="-3"><joint joint="bj" coef="1"/></fixed></tendon>
<equality>
<joint joint1="bj" joint2="one_j"/></equality></mujocoinclude>""",
        b_dot_xml="""<mujocoinclude>

<body name="b"><replicate count="2" euler="0 0 1"><body>
<joint name="k" axis="1 0 0" damping="-1"/><geom size="0.1" mass="1"/></body></replicate>
<joint name="bj" axis="1 0 0" damping="-3"/><geom size="0.1" mass="1"/></body></mujocoinclude>""",
        sub__s_dot_xml=SUB.format(asset='<model name="sub" file="deep/s.xml"/>', inner=ATTACH.format("two_")),
        sub__deep__s_dot_xml="\n\n" + nested,
    )
    assert set(told(tmp_path)) == {
        "b.xml:4: joint 'k0' has damping -1, which drives the joint at some rates",
        "b.xml:4: joint 'k1' has damping -1, which drives the joint at some rates",
        "b.xml:5: joint 'bj' has damping -3, which drives the joint at some rates",
        "inc.xml:3: tendon of 'bj' has damping that drives the tendon at some rates",
        "sub/s.xml:4: joint 'one_j' has damping -2, which drives the joint at some rates",
        "sub/s.xml:7: joint 'one_tip_joint' has damping -2, which drives the joint at some rates",
        "sub/s.xml:10: tendon of 'one_a' and 'one_z' has damping that drives the tendon at some rates",
        "sub/deep/s.xml:6: joint 'one_two_j' has damping -2, which drives the joint at some rates",
        "sub/deep/s.xml:9: joint 'one_two_tip_joint' has damping -2, which drives the joint at some rates",
        "sub/deep/s.xml:12: tendon of 'one_two_a' and 'one_two_z' has damping that drives the tendon at some rates",
    }
    bound = compile_paths(tmp_path / "r.xml", conservative=False).equalities.values()
    assert {each.removeprefix(f"{tmp_path}/") for each in bound} == {
        "inc.xml:5: equality joint of 'bj' and 'one_j'",
        "r.xml:3: equality weld of 'one_s' and 'b'",
        "sub/s.xml:12: equality weld of 'one_s' and 'one_tip'",
        "sub/s.xml:13: equality 'one_pin'",
        "sub/deep/s.xml:14: equality weld of 'one_two_s' and 'one_two_tip'",
        "sub/deep/s.xml:15: equality 'one_two_pin'",
    }


def test_an_ambiguous_element_is_reported_with_both_files(tmp_path):
    """Joints without a name on the same line of two files."""
    body = '<body name="s"><joint damping="-1"/><geom size="0.1" mass="1"/></body>'
    sides = ("left", "right")
    write(
        tmp_path,
        r_dot_xml=f"<mujoco>{HEAD}<asset>"
        + "".join(f'<model name="{side}" file="{side}.xml"/>' for side in sides)
        + '</asset><worldbody><body name="r"><freejoint/><geom size="0.1" mass="1"/>'
        + "".join(f'<attach model="{side}" body="s" prefix="{side}_"/>' for side in sides)
        + "</body></worldbody></mujoco>",
        **{f"{side}_dot_xml": f"<mujoco>{HEAD}\n<worldbody>{body}</worldbody></mujoco>" for side in sides},
    )
    assert told(tmp_path) == [
        f"left.xml:2 or {tmp_path}/right.xml:2: joint '{side}_s_joint' has damping -1, which drives the joint at some rates"
        for side in sides
    ]


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
