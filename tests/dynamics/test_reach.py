"""Reach of an arm: no pose takes the tip out of the sphere, and a stretched arm touches it."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_mj.dynamics.reach import reach_of
from tests.scenes import HEAD, compile_paths

ARM = f"""<mujoco>{HEAD}<worldbody><body name="base" pos="1 2 3"><freejoint name="free"/><geom size=".1" mass="5"/>
  <site name="mount"/>
  <body name="upper" pos=".5 0 0"><joint name="shoulder" axis="0 0 1"/><geom size=".1" mass="1"/>
    <body name="fore" pos="1 0 0"><joint name="elbow" axis="0 1 0" pos="0 .2 0"/><geom size=".1" mass="1"/>{{}}
      <site name="tip" pos="0 .2 .7"/></body></body></body></worldbody></mujoco>"""
SLIDE = '<joint name="slide" type="slide" axis="1 0 0" {}/>'


@pytest.fixture
def arm(tmp_path):
    def compiled(more: str = ""):
        (tmp_path / "arm.xml").write_text(ARM.format(more))
        return compile_paths(tmp_path / "arm.xml")

    return compiled


def posed(system, rng):
    data = mujoco.MjData(system.mj)
    data.qpos[7:] = rng.uniform(-np.pi, np.pi, system.mj.nq - 7)
    mujoco.mj_forward(system.mj, data)
    return data


def test_the_radius_is_the_length_of_the_chain_in_every_pose(arm, rng):
    """From the shoulder: |(1, 0.2)| to the elbow's anchor, 0.7 to the tip. Rounding of numbers of size 3."""
    system, site = arm(), None
    site = system.index("site", "tip")
    for _ in range(20):
        data = posed(system, rng)
        reach = reach_of(system, data, site)
        assert reach is not None
        assert (reach.tip, reach.joint) == ("robot/tip", "robot/shoulder")
        assert reach.radius_m == pytest.approx(np.hypot(1.0, 0.2) + 0.7, abs=1e-14)
        np.testing.assert_allclose(reach.centre_m, data.xanchor[1], atol=0)
        assert np.linalg.norm(data.site_xpos[site] - reach.centre_m) <= reach.radius_m + 1e-14


def test_a_slide_joint_adds_its_travel(arm):
    system = arm(SLIDE.format('range="-.1 .3" limited="true"'))
    data = mujoco.MjData(system.mj)
    data.qpos[-1] = 0.1
    mujoco.mj_forward(system.mj, data)
    site = system.index("site", "tip")
    reach = reach_of(system, data, site)
    assert reach is not None
    for travel in (-0.1, 0.3):
        data.qpos[-1] = travel
        mujoco.mj_forward(system.mj, data)
        assert np.linalg.norm(data.site_xpos[site] - reach.centre_m) <= reach.radius_m
    endless = arm(SLIDE.format(""))
    data = mujoco.MjData(endless.mj)
    mujoco.mj_forward(endless.mj, data)
    without = reach_of(endless, data, endless.index("site", "tip"))
    assert without is not None
    assert without.radius_m == np.inf


def test_a_site_of_the_base_has_no_reach(arm):
    system = arm()
    data = mujoco.MjData(system.mj)
    mujoco.mj_forward(system.mj, data)
    assert reach_of(system, data, system.index("site", "mount")) is None
