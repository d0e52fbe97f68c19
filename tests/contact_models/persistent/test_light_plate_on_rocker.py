"""A light plate that is pressed on both edges of a heavy body which turns: the edges are hit in turn, and it rests at last.

The rocker turns about the middle of its face, at angle q; the plate, on a slide across the face, is pressed on it. Up to the
square of q the plate rises by a |q| on the edge that is up. There the load turns the rocker back with P a, and the light
plate stops as slowly as the heavy rocker does, although its load alone would stop it in no time.
"""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from tests.replays import proved
from tests.scenes import HEAD, scene

A, PLATE, INERTIA, PRESS = 0.01, 0.01, 2.0, 8.0
"""Half width of the face, m; mass of the plate, kg; inertia of the rocker, kg m^2; load of the plate, N."""
MOVED = INERTIA + PLATE * A**2
FAR = 1e6


def plate_on_rocker(folder, angle, rate, *, torque=0.0, duration):
    """The plate on one edge of the rocker, which turns at some rate, under a constant torque on it."""
    # Robots are one tree: both are on a base that slides along y, where nothing pushes it.
    robot = f"""<mujoco>{HEAD}<worldbody><body name="base"><joint name="y" type="slide" axis="0 1 0"/>
      <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      <body name="rocker"><joint name="turn" axis="0 1 0"/><inertial pos="0 0 0" mass="1" diaginertia="2 {INERTIA} 2"/>
        <geom name="rocker" type="box" pos="0 0 -0.05" size="{A} 0.1 0.05" mass="0"/></body>
      <body name="plate"><joint name="rise" type="slide" axis="0 0 1"/>
        <inertial pos="0 0 0" mass="{PLATE}" diaginertia="1 1 1"/>
        <geom name="plate" type="box" pos="0 0 0.01" size="0.05 0.2 0.01" mass="0"/></body>
      </body></worldbody><actuator><motor name="turn" joint="turn"/><motor name="rise" joint="rise"/></actuator></mujoco>"""
    # Of a target this far, the part of the load that the position changes is below rounding of what is asserted.
    push = {"joints": ["turn", "rise"], "kp": [abs(torque) / FAR, PRESS / FAR], "target": [np.copysign(FAR, torque), -FAR]}
    start = {
        "joints": {"turn": angle, "rise": A * np.sin(abs(angle))},
        "rates": {"turn": rate, "rise": A * np.cos(angle) * np.sign(angle) * rate},
    }
    return ffsm_mj.run(
        scene(
            folder,
            robot,
            {},
            duration_s=duration,
            time_step_s=1e-3,
            initial=start,
            contacts={"rules": [{"between": ["plate", "rocker"], "restitution": 0.0}]},
            phases=[{"name": "press", "until": "end", "controller": {"kind": "pd", "kd": 0.0, **push}}],
        )
    )


def angles(run):
    """Times and angles of the rocker."""
    return run.time, run["state.q_robot_turn_rad"]


def test_a_light_plate_does_not_stop_the_rocker_that_it_lies_on(tmp_path):
    """It swings from edge to edge: MOVED q'' = -P a, and each hit leaves (I - m a^2) / (I + m a^2) of the rate.

    The gap of the edge that is left opens at 8e-5 m/s. Against 8 N on 0.01 kg that would be a height of 4e-12 m.
    """
    start, fall = 1e-4, PRESS * A / MOVED
    run = proved(plate_on_rocker(tmp_path, -start, 0.0, duration=0.2))
    time, angle = angles(run)
    meets = np.sqrt(2.0 * start / fall)
    rate = fall * meets * (INERTIA - PLATE * A**2) / MOVED
    after = (time > meets) & (time < 2.9 * meets)
    expected = rate * (time - meets) - 0.5 * fall * (time - meets) ** 2
    # The lever is a cos q, and the plate rises by a sin q: both differ by q^2 / 2 = 5e-9 of the motion.
    assert angle[after] == pytest.approx(expected[after], abs=1e-8 * start)


def test_what_rocks_to_rest_leaves_an_edge_that_the_load_opens(tmp_path):
    """A torque beyond P a opens one edge: it is hit at 1.5e-7 m/s, is at rest, and opens again from there.

    Both edges are held before one opens. With one alone at rest, the rocker would turn onto the other again, for ever.
    """
    torque, start, meeting = -0.084, 1e-5, 7.5e-6
    slows = (-torque - PRESS * A) / MOVED
    speed = np.sqrt(meeting**2 + 2.0 * slows * start)
    run = proved(plate_on_rocker(tmp_path, -start, speed, torque=torque, duration=0.2))
    (hit,) = {impact.time_s for impact in run.impacts}
    time, angle = angles(run)
    # Another point is found 2e-10 m below the edges that are held, up to which this one takes a few steps.
    assert (speed - meeting) / slows < hit < (speed - meeting) / slows + 4e-3
    after = time > hit
    # The rate that the hit leaves is taken away: it would take the rocker by 1e-7 rad from here.
    assert angle[after] == pytest.approx(-0.5 * slows * (time[after] - hit) ** 2, abs=1e-11)
