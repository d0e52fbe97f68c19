"""Rows of equality constraints: as MuJoCo states them, their rates, and motions in space against independent codes."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from ffsm_mj.dynamics.loops.closed_loops import ClosedLoops
from ffsm_mj.dynamics.loops.equalities import equalities_of
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.projection import no_contacts, project
from ffsm_mj.tolerances import MECHANISM_RANK
from tests.mechanisms.models import CHAIN

TREE = """<mujoco><option gravity="0 0 0"/><worldbody>
<body name="b"><freejoint/><geom size=".1" mass="3"/><site name="s0" pos=".2 .1 .3" euler="20 30 40"/>
 <body name="c" pos=".3 0 0" euler="10 20 30"><joint name="j1" axis="0 .6 .8" ref="10"/><geom size=".1" pos=".1 0 0"/>
  <body name="d" pos=".3 .1 0"><joint name="j2" axis="1 0 0"/><geom size=".1" pos=".1 .1 0"/>
   <site name="s1" pos=".1 .2 .3" euler="50 10 20"/></body></body>
 <body name="e" pos="-.3 0 0"><joint name="j3" type="slide" axis="1 1 0"/><geom size=".1" pos=".1 0 0"/>
  <site name="s2" pos=".1 0 .3"/></body></body></worldbody>
<tendon><spatial name="t1"><site site="s0"/><site site="s1"/><pulley divisor="2"/>
  <site site="s0"/><site site="s2"/></spatial>
 <fixed name="t2"><joint joint="j1" coef="2"/><joint joint="j2" coef="-1"/></fixed></tendon>
<equality>{}</equality></mujoco>"""
KINDS = (
    '<connect body1="c" body2="e" anchor=".1 .2 .3"/>',
    '<connect site1="s1" site2="s2"/>',
    '<weld body1="d" body2="e" anchor=".1 .2 .3"/>',
    '<weld body1="d" body2="e" relpose=".1 .2 .3 .9 .1 .2 .3"/>',
    '<weld site1="s1" site2="s2"/>',
    '<weld body1="d" body2="e" torquescale="0"/>',
    '<joint joint1="j1" joint2="j2" polycoef=".1 .2 .3 .4 .5"/>',
    '<joint joint1="j1" polycoef=".3 0 0 0 0"/>',
    '<tendon tendon1="t1" tendon2="t2" polycoef=".1 .2 .3 .4 .5"/>',
    '<tendon tendon1="t1"/>',
)


def loops_of(model, data, *, rank=MECHANISM_RANK):
    return ClosedLoops(model, data, [each.source for each in equalities_of(model)], rank=rank)


@pytest.mark.parametrize("kind", KINDS)
def test_rows_are_the_rates_of_the_errors_of_mujoco(kind, rng):
    """Errors have the norms of MuJoCo's, J qdot is their derivative, and gamma the derivative of J qdot at zero qddot."""
    model = mujoco.MjModel.from_xml_string(TREE.format(kind))
    data = mujoco.MjData(model)
    mujoco.mj_integratePos(model, data.qpos, 0.3 * rng.normal(size=model.nv), 1.0)
    data.qvel[:] = rng.normal(size=model.nv)
    mujoco.mj_forward(model, data)
    loops = loops_of(model, data)
    errors, rows = loops.errors(), loops.rows()
    place = slice(0, 3) if "body" in kind or "site1" in kind else slice(0, 1)
    # Those of a connect and a weld are along the axes of body 1 here, of the world there.
    assert np.linalg.norm(errors[place]) == pytest.approx(np.linalg.norm(data.efc_pos[place]), abs=1e-14)

    def after(t):
        moved = mujoco.MjData(model)
        moved.qpos[:], moved.qvel[:] = data.qpos, data.qvel
        mujoco.mj_integratePos(model, moved.qpos, data.qvel, t)
        mujoco.mj_forward(model, moved)
        there = loops_of(model, moved)
        return there.errors(), there.rows().J @ moved.qvel

    # Central differences over 2e-5 s: truncation 1e-10 of third derivatives of some 10.
    ahead, behind = after(1e-5), after(-1e-5)
    rates = [(a - b) / 2e-5 for a, b in zip(ahead, behind, strict=True)]
    np.testing.assert_allclose(rows.J[place] @ data.qvel, rates[0][place], rtol=0, atol=1e-8)
    np.testing.assert_allclose(rows.gamma, rates[1], rtol=1e-9, atol=1e-8)
    stage = loops._stage
    loops.choose()
    stage.evaluate()
    T, _ = loops.get_state()
    np.testing.assert_allclose(stage.J, rows.J, rtol=0, atol=1e-14)
    np.testing.assert_allclose(stage.gamma, T @ rows.gamma, rtol=0, atol=1e-12)
    np.testing.assert_allclose(stage.errors(), T @ errors, rtol=0, atol=1e-13)


FINAL = (0.170352977151, 0.258820461808, 0.352213627361)
JOINTS = (1.953840585776, -1.151877767300, 0.395175204375)
RATES = (1.616946866986, -0.369509026362, -1.291496621470)


def curve(z):
    return 0.05 + 0.8 * z - 0.3 * z**2 + 0.2 * z**3 - 0.1 * z**4, 0.8 - 0.6 * z + 0.6 * z**2 - 0.4 * z**3


def chain(step_s):
    """M2 after 1 s, without projection: positions, joints, rates, and the error of the row."""
    model = mujoco.MjModel.from_xml_string(CHAIN)
    model.opt.timestep = step_s
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
    data = mujoco.MjData(model)
    quaternion = np.array((0.9, 0.1, -0.2, 0.3))
    value, slope = curve(0.5 - 0.1)
    data.qpos[:] = 0.1, 0.2, 0.3, *quaternion / np.linalg.norm(quaternion), 0.5, -0.4, -0.2 + value
    data.qvel[:] = 0.05, -0.03, 0.02, 0.2, -0.1, 0.15, 1.2, -0.9, slope * 1.2
    mujoco.mj_forward(model, data)
    motion = Motion(model, data)
    loops = motion.loops = loops_of(model, data)
    assert np.abs(loops.errors()).max() < 1e-15

    def torques(data):
        data.qfrc_applied[6:] += 0.3 * np.sin(2 * data.time), -0.2, 0.1

    def push(data):
        force = data.qfrc_passive - data.qfrc_bias + data.qfrc_applied
        data.qfrc_applied[:] += loops.generalised(force)

    motion.push_with([torques], [push])
    for _ in range(round(1.0 / step_s)):
        motion.step(step_s)
    return data.qpos[:3].copy(), data.qpos[7:].copy(), data.qvel[6:].copy(), float(np.abs(loops.errors()).max())


def test_a_joint_that_follows_a_polynomial_in_space():
    """M2: digits by elimination; order 4, and the drift of the row too."""
    errors = []
    for step_s in (4e-3, 2e-3):
        position, joints, rates, drift = chain(step_s)
        errors.append(max(*np.abs(position - FINAL), *np.abs(joints - JOINTS), *np.abs(rates - RATES)))
        assert drift < 1e-8
    assert errors[1] < 1e-10
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.4)


def test_references_count():
    """x0 and y0 are those of ref: without them the follower would start at .394, not at .132."""
    model = mujoco.MjModel.from_xml_string(CHAIN)
    ((_, source),) = equalities_of(model)
    value, slope, _ = source.law.at(0.5)
    assert value == pytest.approx(0.132, abs=5e-4)
    assert slope == pytest.approx(curve(0.4)[1], abs=1e-15)
    assert curve(0.5)[0] > 0.35


def test_a_state_beside_the_constraints_is_projected_onto_them(rng):
    """A row that is off by 1e-6 is closed."""
    model = mujoco.MjModel.from_xml_string(CHAIN)
    data = mujoco.MjData(model)
    data.qpos[9] = -0.2 + curve(-0.1)[0] + 1e-6
    data.qvel[:] = rng.normal(size=model.nv)
    mujoco.mj_forward(model, data)
    motion = Motion(model, data)
    motion.loops = loops_of(model, data)
    project(motion, lambda: no_contacts(model.nv), np.ones(6, dtype=np.bool_), np.empty((0, 6)))
    assert np.abs(motion.loops.errors()).max() < 1e-12  # one step of Newton's method squares the error
    assert np.abs(motion.loops.rows().J @ data.qvel).max() < 1e-13
