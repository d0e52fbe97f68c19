"""Joint limits as constraints: gap, rates and the bound on the rate by the kinetic energy."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact.motion_bound import rate_per_root_energy
from ffsm_mj.dynamics.rigid_body import mass_matrix
from tests.conftest import MJCF
from tests.scenes import HEAD, compile_paths

CHAIN = """<mujoco>{head}<compiler angle="radian"/><worldbody><body name="base"><freejoint/>
  <inertial pos="0.1 -0.2 0.05" mass="{base}" diaginertia="0.3 0.4 0.5"/>
  <body name="a" pos="0.3 0.1 0"><joint name="slide" type="slide" axis="0.6 0 0.8" range="-1 2"/>
    <inertial pos="0.2 0 0.1" mass="0.7" diaginertia="0.01 0.02 0.02"/>
    <body name="b" pos="0.5 0 0"><joint name="hinge" axis="0 0.6 0.8" pos="0.1 0 0.2" range="-0.5 1.5"/>
      <inertial pos="0.25 0.1 0" mass="0.4" diaginertia="0.003 0.002 0.004"/>
      <body name="c" pos="0.1 0 0"><inertial pos="0.1 0 0" mass="0.2" diaginertia="0.001 0.001 0.001"/></body>
      <body name="d" pos="0.2 0 0"><joint name="one" axis="1 0 0" range="-1 1" {armature}/><joint name="two" axis="0 1 0"/>
        <inertial pos="0.1 0 0" mass="0.2" diaginertia="0.001 0.001 0.001"/></body>
    </body></body></body></worldbody></mujoco>"""


@pytest.fixture
def chain(tmp_path):
    """Compiles the chain; the base is light, so that it matters."""

    def compiled(armature="", base=2.0):
        (tmp_path / "robot.xml").write_text(CHAIN.format(head=HEAD, armature=armature, base=base))
        return compile_paths(tmp_path / "robot.xml").mj

    return compiled


def random_state(model, rng):
    data = mujoco.MjData(model)
    mujoco.mj_integratePos(model, data.qpos, rng.uniform(-2, 2, model.nv), 1.0)
    data.qvel[:] = rng.uniform(-1, 1, model.nv)
    mujoco.mj_forward(model, data)
    return data


def test_gap_rate_and_second_rate(chain, rng):
    """Second rates against central differences of the rate along the motion: 1e-6 of the change over 1e-5 s."""
    model = chain()
    for name, side in (("robot/slide", "lower"), ("robot/hinge", "upper")):
        joint = model.joint(name).id
        limit, data = JointLimit(model, joint, side, 0.5), random_state(model, rng)
        near = limit.proximity(model, data)
        q, low, high = data.qpos[limit.qpos], *model.jnt_range[joint]
        assert near.gap == limit.gap(model, data, math.inf) == (q - low if side == "lower" else high - q)
        assert near.rate == limit.rate(data) == (1 if side == "lower" else -1) * data.qvel[limit.dof]
        assert limit.gap(model, data, -7.0) == -7.0
        assert limit.feature.at(data).point_rate == (0.0, 0.0, 0.0)
        assert limit.unit == ("m" if name == "robot/slide" else "rad")
        second = limit.second_rate(model, data, near, near.points[0])
        rates = []
        for step in (-1e-5, 1e-5):
            model.opt.timestep, moved = step, mujoco.MjData(model)
            moved.qpos[:], moved.qvel[:] = data.qpos, data.qvel
            mujoco.mj_step(model, moved)
            rates.append(limit.rate(moved))
        assert second.value == pytest.approx((rates[1] - rates[0]) / 2e-5, rel=1e-6, abs=1e-8)
        np.testing.assert_allclose(near.points[0], data.xanchor[joint])


@pytest.mark.parametrize("base", [0.05, 2.0, 1e4])
def test_the_rate_is_bounded_by_the_energy_in_every_configuration(chain, rng, base):
    """sqrt((M^-1)_jj) never exceeds the bound, which is computed in one configuration; for two bodies it is nearly sharp."""
    model = chain(base=base)
    joints = [model.joint(f"robot/{name}").id for name in ("slide", "hinge")]
    bounds = {j: rate_per_root_energy(model, random_state(model, rng), j) for j in joints}
    largest = dict.fromkeys(joints, 0.0)
    for _ in range(300):
        data = random_state(model, rng)
        inverse = np.linalg.inv(mass_matrix(model, data))
        for j in joints:
            dof = model.jnt_dofadr[j]
            largest[j] = max(largest[j], math.sqrt(inverse[dof, dof]))
            assert abs(data.qvel[dof]) <= bounds[j] * math.sqrt(data.qvel @ mass_matrix(model, data) @ data.qvel) * (
                1 + 1e-12
            )
    for j in joints:
        assert 0.2 * bounds[j] < largest[j] <= bounds[j] * (1 + 1e-12)


def test_the_rate_of_one_of_several_joints_of_a_body(chain, rng):
    """Energy does not bound it in general, as the body between the two has no inertia; its armature does."""
    plain, geared = chain(), chain('armature="0.04"')
    joint = plain.joint("robot/one").id
    assert rate_per_root_energy(plain, random_state(plain, rng), joint) == math.inf
    assert rate_per_root_energy(geared, random_state(geared, rng), joint) == pytest.approx(5.0)


def test_two_bodies_of_one_hinge_have_a_sharp_bound(tmp_path, rng):
    """Centres of mass on the axis, which is a principal one: 1 / I_a + 1 / I_b exactly, and less by the armature."""
    text = f"""<mujoco>{HEAD}<worldbody><body name="a"><freejoint/><inertial pos="0 0 0" mass="5" diaginertia="0.3 0.3 0.3"/>
      <body name="b"><joint name="j" axis="0 0 1" armature="0.01"/><inertial pos="0 0 1" mass="1" diaginertia="1 1 0.02"/>
      </body></body></worldbody></mujoco>"""
    (tmp_path / "robot.xml").write_text(text)
    model = compile_paths(tmp_path / "robot.xml").mj
    data = random_state(model, rng)
    bound = rate_per_root_energy(model, data, model.joint("robot/j").id)
    assert bound == pytest.approx(1 / math.sqrt(0.01 + 1 / (1 / 0.3 + 1 / 0.02)))
    assert bound == pytest.approx(math.sqrt(np.linalg.inv(mass_matrix(model, data))[6, 6]))


def test_shipped_arms_are_bounded(rng):
    model = compile_paths(MJCF / "spacecraft_7dof.xml").mj
    for _ in range(50):
        data = random_state(model, rng)
        inverse = np.linalg.inv(mass_matrix(model, data))
        for joint in range(model.njnt):
            if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE:
                dof = model.jnt_dofadr[joint]
                assert math.sqrt(inverse[dof, dof]) <= rate_per_root_energy(model, data, joint) * (1 + 1e-12)
