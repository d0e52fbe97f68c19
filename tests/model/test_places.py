"""Faults name an element with its file and line, however that file is included or attached."""

from __future__ import annotations

import pytest

from ffsm_mj.errors import InputError
from tests.model.test_model_files import write
from tests.scenes import HEAD, compile_paths

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
