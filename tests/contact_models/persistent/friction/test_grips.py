"""Grips that hold by friction, lose it when Coulomb says so, and swing, by closed forms and trees of joints."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

import ffsm_mj
from tests.contact_models.persistent.friction.scenes import (
    BALL_TIP,
    PAD,
    PLATE,
    cube,
    final,
    gripped,
    heat,
    load,
    slips,
    thrust,
)
from tests.replays import proved
from tests.scenes import HEAD

FINER = [pytest.param(step, marks=pytest.mark.long) for step in (1e-2, 2e-3, 1e-3, 5e-4)]


def lost(run):
    """Velocity of the cube's origin over that of the base, and how far it has slipped, world axes."""
    speed = final(run, "v_cube_free")[:3] - final(run, "v_robot_free")[:3]
    return speed, final(run, "q_cube_free")[:3] - final(run, "q_robot_free")[:3]


@pytest.mark.long
@pytest.mark.parametrize("step", [4e-3, *FINER])
@pytest.mark.parametrize("tip", [PLATE, BALL_TIP])
def test_a_grip_loses_what_is_too_heavy(tmp_path, step, tip):
    """2 mu N Mtot / (48 m) = 0.5 s; then the cube falls back: -24 (t - 0.5)^2 / 10, in line with the thrust."""
    path = gripped(
        tmp_path,
        tip,
        cube(2.0, 0.05, 0.004),
        mu=0.4,
        grip_N=5.0,
        loads=[thrust((0, 0, 0), (0, 0, 48))],
        step=step,
        duration=0.6,
    )
    run = proved(ffsm_mj.run(path), records=tip == BALL_TIP)
    # Bracketed to 1e-12 s.
    assert slips(run) == [pytest.approx(0.5, abs=1e-11)] * 2
    before = run.time < 0.499
    assert np.abs((run["state.v_cube_free_vz_m_s"] - run["state.v_robot_free_vz_m_s"])[before]).max() < 1e-13
    speed, way = lost(run)
    np.testing.assert_allclose(speed, [0, 0, -0.024], atol=1e-12)
    np.testing.assert_allclose(way, [0, 0, -0.0008], atol=1e-12)
    assert heat(run) == pytest.approx(0.0032, abs=1e-12)
    # The load grows with time, and is shared alike by all points.
    np.testing.assert_allclose(run["contact.left_friction_use"], np.minimum(run.time / 0.5, 1.0), atol=1e-10)


def test_pads_hold_a_cube_off_centre_as_long_as_any_pressure_does(tmp_path):
    """Its mass centre at x = 0.02 m turns it in the pads: both centres of pressure may shift alike, until the same load.

    The thrust of 480 t goes through the common mass centre. The margin is known to 1e-11 N of 80 N/s.
    """
    path = gripped(
        tmp_path,
        PLATE,
        cube(2.0, 0.05, 0.004, (0.02, 0, 0)),
        mu=0.4,
        grip_N=5.0,
        loads=[thrust((0, 0, 0), (0, 0, 480), at_m=(0.04 / 12, 0, 0))],
        step=2e-3,
        duration=0.052,
    )
    run = proved(ffsm_mj.run(path))
    assert slips(run)[0] == pytest.approx(0.05, abs=1e-11)
    before = run.time < 0.0499
    assert np.abs((run["state.v_cube_free_vz_m_s"] - run["state.v_robot_free_vz_m_s"])[before]).max() < 1e-13
    # Equal springs need more friction than the best shares of the load, which replace them where they leave a cone.
    use, least = run["contact.left_friction_use"][before], (run.time / 0.05)[before]
    assert np.all((use >= least - 1e-6) & (use <= 1.0))
    assert use[-1] == pytest.approx(least[-1], abs=1e-5)
    assert use[5] > 1.2 * least[5]


SWING_ERRORS = {1e-2: 8e-10, 4e-3: 1.8e-11, 2e-3: 1.2e-12, 1e-3: 7e-14, 5e-4: 7e-14}


@pytest.mark.parametrize("step", [4e-3, *FINER])
def test_a_cube_swings_about_ball_tips_as_on_a_hinge(tmp_path, step):
    """Its mass centre is 2 cm off the line of the tips, under a constant thrust; the tree has a hinge there."""
    path = gripped(
        tmp_path,
        BALL_TIP,
        cube(2.0, 0.05, 0.004, (0.02, 0, 0)),
        mu=0.4,
        grip_N=10.0,
        loads=[thrust((0, 0, 12))],
        step=step,
        duration=0.3,
    )
    run = proved(ffsm_mj.run(path))
    w, _, y, _ = final(run, "q_cube_free")[3:]
    angle = 2.0 * math.atan2(y, w)
    assert angle == pytest.approx(0.383815560117, abs=3 * SWING_ERRORS[step] + 1e-12)
    assert angle == pytest.approx(swung_on_a_hinge(), abs=3 * SWING_ERRORS[step] + 1e-12)
    assert heat(run) == 0.0


def swung_on_a_hinge():
    """Angle of the cube on a hinge at the base's origin after 0.3 s, by MuJoCo's RK4 at 0.25 ms."""
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>{HEAD}<worldbody><body name="base">
      <inertial pos="0 0 0" mass="10" diaginertia="1 1 1"/><joint type="slide" axis="1 0 0"/>
      <joint type="slide" axis="0 0 1"/><body><inertial pos="0.02 0 0" mass="2" diaginertia="0.004 0.004 0.004"/>
      <joint name="hinge" axis="0 1 0"/></body></body></worldbody></mujoco>""")
    model.opt.timestep, model.opt.integrator = 2.5e-4, mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(model)
    data.xfrc_applied[1, 2] = 12.0
    for _ in range(1200):
        mujoco.mj_step(model, data)
    return float(data.joint("hinge").qpos[0])


SOFT = {"base_kg": 10.0, "finger_kg": 0.2, "mu": 0.7, "grip_N": 10.0, "half_m": 0.05}
LIMIT_N = 2 * 0.7 * 10.0 * 12.4 / 2.0
"""Thrust on the base of 10.4 kg under which a cube of 2 kg needs 2 mu N."""


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_pads_hold_below_the_limit_and_not_above(tmp_path, share):
    """7 m/s^2 is all that friction gives the cube of 2 kg; the base then has (F - 14 N) / 10.4 kg."""
    thrust_N = share * LIMIT_N
    held = cube(2.0, 0.05, 0.004)
    path = gripped(tmp_path, PAD, held, loads=[thrust((thrust_N, 0, 0))], step=4e-3, duration=0.04, **SOFT)
    run = proved(ffsm_mj.run(path))
    at_once = final(run, "v_cube_free")[0] / 0.04, final(run, "v_robot_free")[0] / 0.04
    expected = (thrust_N / 12.4,) * 2 if share < 1.0 else (7.0, (thrust_N - 14.0) / 10.4)
    assert at_once == pytest.approx(expected, rel=1e-12)
    assert share < 1.0 or expected[1] == pytest.approx(7.083462, abs=1e-6)


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_pads_hold_a_twist_by_their_corners(tmp_path, share):
    """Under even pressure eight corners of 2.5 N at 2 sqrt(2) cm resist mu sum N r = 0.39598 N m, and no more."""
    most = 0.7 * 8 * 2.5 * 0.02 * math.sqrt(2)
    assert most == pytest.approx(0.39598, abs=1e-5)
    inertia = 0.004
    twist = [load("cube/cube", "robot/base", torque_N_m=[[0, share * most, 0]], axes="robot/base")]
    path = gripped(tmp_path, PAD, cube(2.0, 0.05, inertia), loads=twist, step=4e-3, duration=0.04, **SOFT)
    run = proved(ffsm_mj.run(path))
    rate = 0.0 if share < 1.0 else (share - 1.0) * most / inertia
    assert final(run, "v_cube_free")[4] == pytest.approx(0.04 * rate, abs=1e-10)
    # The base of 0.9 kg m^2 takes the reaction.
    assert final(run, "v_robot_free")[4] == pytest.approx(-0.04 * rate * inertia / 0.9, abs=1e-10)


def test_a_pinch_lets_go_of_both_sides_at_once(tmp_path):
    """20 t N on a base of 18 kg, 2 kg between ball tips of 10 N, mu 0.5: sticks for 5 s, then both fingers slide.

    Freed one after the other they would end at another relative speed, 0.366 m/s for 0.5556 m/s after a second.
    """
    path = gripped(
        tmp_path,
        BALL_TIP,
        cube(2.0, 0.5, 0.3),
        mu=0.5,
        grip_N=10.0,
        loads=[thrust((0, 0, 0), (20, 0, 0))],
        step=0.05,
        duration=6.0,
        base_kg=17.0,
        finger_kg=0.5,
        half_m=0.5,
    )
    run = proved(ffsm_mj.run(path))
    assert slips(run) == [pytest.approx(5.0, abs=1e-10)] * 2
    speed, way = lost(run)
    np.testing.assert_allclose(speed, [-5 / 9, 0, 0], atol=1e-10)
    np.testing.assert_allclose(way, [-5 / 27, 0, 0], atol=1e-9)
    assert heat(run) == pytest.approx(50 / 27, abs=1e-9)


def test_a_grip_at_half_the_limit_does_not_creep(tmp_path):
    """In 10 s, over 175 m: no slip but rounding of the places, and no heat."""
    path = gripped(
        tmp_path,
        PAD,
        cube(2.0, 0.05, 0.004),
        loads=[thrust((0.5 * LIMIT_N, 0, 0))],
        step=0.1,
        duration=10.0,
        **SOFT,
    )
    run = proved(ffsm_mj.run(path))
    way = run["state.q_cube_free_x_m"] - run["state.q_robot_free_x_m"]
    assert run["state.q_robot_free_x_m"][-1] == pytest.approx(175.0, rel=1e-9)
    assert np.abs(way).max() < 1e-11
    assert heat(run) == 0.0
    assert not slips(run)
