"""URDFs of ``example-robot-data``, each hit by a ball: they run with all that they state of their joints, and replay."""

from __future__ import annotations

import numpy as np
import pytest

from ffsm_mj.model.composition import compile_system
from ffsm_mj.model.files import read_model
from tests.robots.menagerie import tried
from tests.robots.urdfs import robots, stated, with_spheres, write_urdf

pytestmark = pytest.mark.robots

ROBOTS = tuple(robots())
REFUSED = (
    *("alex_description/alex_psyonic_hands", "finger_edu_description/finger_edu", "human_description/human"),
    *("allegro_hand_description/allegro_left_hand", "allegro_hand_description/allegro_right_hand"),
    *(
        "anymal_b_simple_description/anymal",
        "anymal_b_simple_description/anymal-kinova",
        "anymal_c_simple_description/anymal",
    ),
    *("b1_description/b1", "b1_description/b1-z1", "go1_description/go1", "hyq_description/hyq_no_sensors"),
    *("icub_description/icub", "icub_description/icub_reduced", "pr2_description/pr2"),
    *("romeo_description/romeo", "romeo_description/romeo_laas_small", "romeo_description/romeo_small"),
    *("tiago_description/tiago", "tiago_description/tiago_dual", "tiago_description/tiago_no_hand"),
)
"""Robots that MuJoCo refuses: the inertia of a link is that of no body, or a link that moves has none."""


def test_the_package_is_there():
    assert len(ROBOTS) > len(REFUSED)
    assert set(REFUSED) < set(ROBOTS)


@pytest.mark.long
@pytest.mark.parametrize("robot", ROBOTS)
def test_a_ball_hits_every_robot(robot):
    """Unmodified but for meshes; those that are refused name the link."""
    result = tried(robot, 400.0, write=write_urdf)
    if robot in REFUSED:
        assert "inertia" in result.refused[0]
        assert "Element name" in result.refused[0]
    else:
        assert result.passes, result


@pytest.mark.parametrize("robot", [robot for robot in ROBOTS if robot not in REFUSED])
def test_what_a_file_states_of_its_joints_is_modelled(robot, tmp_path):
    """Each coupling is a row, each friction and each largest effort a limit of its joint."""
    main = write_urdf(robot, tmp_path)
    said = stated((tmp_path / "robot" / "robot.urdf").read_bytes())
    system = compile_system(read_model(main), {}, time_step_s=1e-3)
    model = system.mj
    assert {each.name.removeprefix("robot/") for each in system.robot.joints} >= set(said.joints)
    assert {model.joint(j).name.removeprefix("robot/") for j in model.eq_obj1id.tolist()} == set(said.mimics)
    for name in said.joints:
        joint = model.joint(f"robot/{name}")
        assert model.dof_frictionloss[joint.dofadr[0]] == said.frictions.get(name, 0.0)
        if name in said.efforts:
            np.testing.assert_array_equal(model.jnt_actfrcrange[joint.id], np.array((-1.0, 1.0)) * said.efforts[name])


def test_a_mesh_becomes_a_sphere():
    urdf = b"""<robot name="r"><link name="a"><visual><geometry><mesh filename="m.dae"/></geometry></visual>
      <collision><geometry><mesh filename="m.stl"/></geometry></collision></link></robot>"""
    assert with_spheres(urdf).count(b'<sphere radius="0.02" />') == 2
    assert b"mesh" not in with_spheres(urdf)
