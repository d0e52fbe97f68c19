"""Which geoms can collide: every contact that MuJoCo lists is among them, and each of them it lists where they overlap."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_mj.contact.watch import collidable

TREE = """<mujoco><option gravity="0 0 0">{flag}</option><default><geom size="0.2"/></default>
<worldbody><geom name="ground" pos="0 0 0"/>
<body name="base"><freejoint/><geom name="base"/><geom name="skin" contype="0" conaffinity="0"/>
  <body name="bracket"><geom name="bracket"/>
    <body name="upper"><joint axis="0 0 1"/><geom name="upper"/>
      <body name="lower"><joint axis="0 1 0"/><geom name="lower"/><geom name="only" contype="2" conaffinity="1"/></body>
    </body></body>
  <body name="panel"><joint axis="0 1 0"/><geom name="panel"/></body></body>
<body name="rock"><freejoint/><geom name="rock"/><geom name="fancy" contype="4" conaffinity="2"/></body>
<body name="stone"><freejoint/><geom name="stone"/></body>
</worldbody><contact><exclude body1="stone" body2="lower"/><exclude body1="base" body2="rock"/>
<pair geom1="skin" geom2="stone"/><pair geom1="rock" geom2="panel"/></contact></mujoco>"""


@pytest.mark.parametrize("flag", ["", '<flag filterparent="disable"/>'])
def test_it_is_what_mujoco_lists_if_everything_overlaps(flag):
    """All geoms are at one place: MuJoCo's narrow phase sees every pair that its filters let through."""
    model = mujoco.MjModel.from_xml_string(TREE.format(flag=flag))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    listed = np.zeros((model.ngeom, model.ngeom), dtype=bool)
    for a, b in data.contact.geom:
        listed[a, b] = listed[b, a] = True
    found = collidable(model)
    names = [model.geom(i).name for i in range(model.ngeom)]
    differ = [(names[a], names[b]) for a, b in np.argwhere(found != listed) if a < b]
    assert not differ
    assert found.sum() > 20
