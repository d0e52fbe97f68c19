"""Dry friction that is refused, each with file, line and element, whether a scenario is conservative or not."""

from __future__ import annotations

import pytest

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import InputError
from tests.scenes import scene

ROBOT = """<mujoco><option gravity="0 0 0"/><worldbody><site name="world"/>
<body name="sled"><joint name="x" type="slide" axis="1 0 0" {base}/><geom size="0.1" mass="2"/>
<body name="link" pos="0.2 0 0">
<joint name="wrist" type="{kind}" {joint}/><geom size="0.1" mass="1"/><site name="tip" pos="0.2 0 0"/>
</body></body></worldbody>
<tendon>
{tendon}
</tendon></mujoco>"""
FIXED = '<fixed name="t" frictionloss="2"><joint joint="{}" coef="1"/></fixed>'
STRING = '<spatial name="t" frictionloss="2"><site site="world"/><site site="tip"/></spatial>'


def robot(**parts):
    return ROBOT.format(**{"base": "", "kind": "hinge", "joint": "", "tendon": ""} | parts)


@pytest.mark.parametrize("conservative", [True, False])
@pytest.mark.parametrize(
    ("parts", "message"),
    [
        (
            {"kind": "ball", "joint": 'frictionloss="0.5"'},
            r"robot\.xml:4: joint 'wrist' has frictionloss 0\.5 on a ball joint, where limits by axis would depend on the "
            "frame; hinges and slides between links may have it",
        ),
        (
            {"base": 'frictionloss="3"'},
            r"robot\.xml:2: joint 'x' has frictionloss 3 on a joint of the base, which acts on the world",
        ),
        (
            {"tendon": FIXED.format("x")},
            r"robot\.xml:7: tendon 't' has frictionloss 2 and acts on the world; tendons between links may have it",
        ),
        ({"tendon": STRING}, r"robot\.xml:7: tendon 't' has frictionloss 2 and acts on the world"),
        ({"joint": 'frictionloss="inf"'}, r"robot\.xml:4: .*frictionloss"),
        ({"joint": 'frictionloss="-1"'}, r"robot\.xml:4: joint 'wrist' has frictionloss -1 below zero"),
        (
            {"tendon": FIXED.format("wrist").replace('"2"', '"-2"')},
            r"robot\.xml:7: tendon 't' has frictionloss -2 below zero",
        ),
    ],
)
def test_what_is_refused(tmp_path, parts, message, conservative):
    with pytest.raises(InputError, match=message):
        prepare(scene(tmp_path, robot(**parts), {}, conservative=conservative))


@pytest.mark.parametrize("parts", [{"joint": 'frictionloss="1"'}, {"tendon": FIXED.format("wrist")}])
def test_a_flag_that_switches_it_off_is_refused(tmp_path, parts):
    text = robot(**parts).replace('gravity="0 0 0"/>', 'gravity="0 0 0"><flag frictionloss="disable"/></option>')
    message = (
        r"robot\.xml:1: <flag frictionloss=\"disable\"> has no effect in a scene; remove the frictionloss of joints and"
    )
    with pytest.raises(InputError, match=message):
        prepare(scene(tmp_path, text, {}))


@pytest.mark.parametrize(
    "parts", [{"kind": "ball", "joint": 'frictionloss="0.5"'}, {"base": 'frictionloss="3"'}, {"tendon": STRING}]
)
def test_it_can_be_stripped(tmp_path, parts):
    model = prepare(scene(tmp_path, robot(**parts), {}), {"robot.strip": ["frictionloss"]}).system.mj
    assert not model.dof_frictionloss.any()
    assert not model.tendon_frictionloss.any()
