"""Public robots as their makers wrote them, each hit by a ball: they run, pass every check, and replay."""

from __future__ import annotations

import mujoco
import pytest

from tests.robots.menagerie import FILES, FOLDER, tried, without_meshes, write_robot

REFUSED = {"flybody": "adhesion", "shadow_dexee": "plugins are not modelled", "honi_robot": "one tree of moving bodies"}
"""Robots that are refused, with what the reason names; the last is an arm fixed to the world that is welded to a vehicle."""
_SLOW = "the steps of their stiff servos take minutes"
NOT_YET = dict.fromkeys(("pal_talos", "unitree_g1"), _SLOW)
"""Robots that may take longer than the test allows, and why."""

pytestmark = pytest.mark.skipif(not FOLDER.is_dir(), reason=f"no robots in {FOLDER}; FFSM_MENAGERIE names their folder")


@pytest.mark.long(one_of=5)
@pytest.mark.parametrize("robot", FILES)
def test_every_robot_compiles_with_spheres_for_meshes(robot, tmp_path):
    """MuJoCo takes each file, and no geom shows a mesh."""
    model = mujoco.MjModel.from_xml_path(str(write_robot(robot, tmp_path)))
    assert model.njnt
    assert not (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH).any()


def test_a_mesh_becomes_a_sphere_with_the_same_name_class_and_contype():
    xml = b"""<mujoco><default><default class="seen"><geom type="mesh" density="7" group="2"/></default></default>
      <asset><mesh name="m" file="m.obj"/><texture name="t" type="2d" file="t.png"/>
      <material name="red" texture="t" rgba="1 0 0 1"/></asset><worldbody><body><freejoint/>
      <geom name="a" class="seen" mesh="m" contype="4" material="red"/><geom name="b" size="1 1 1" type="box"/></body>
      </worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(without_meshes(xml).decode())
    geom = model.geom("a")
    assert (geom.type[0], geom.size[0], geom.contype[0], geom.group[0]) == (mujoco.mjtGeom.mjGEOM_SPHERE, 0.02, 4, 2)
    assert model.body_mass[1] == pytest.approx(7.0 * 4.0 / 3.0 * 3.141592653589793 * 0.02**3 + 8000.0)
    assert model.ntex == 0


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("robot", FILES)
def test_a_ball_hits_every_robot(robot, request):
    """Unmodified but for meshes; those that are refused are so for a reason that names what is not modelled."""
    if robot in NOT_YET:
        request.applymarker(pytest.mark.xfail(reason=NOT_YET[robot]))
    result = tried(robot)
    if robot in REFUSED:
        assert REFUSED[robot] in " ".join(result.refused)
    else:
        assert result.passes, result
