"""Contacts that last against numbers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.assembly.run import simulate
from tests.replays import proved
from tests.scenes import HEAD, ball, scene


def sprung(folder, step, speed=0.5):
    """A base of 4 kg with a pad of 0.5 kg on a spring of 50 N/m, at rest length, meets a ball of 1.5 kg at e = 0."""
    robot = f"""<mujoco>{HEAD}<worldbody><body name="base"><joint name="x" type="slide" axis="1 0 0"/>
      <inertial pos="0 0 0" mass="4" diaginertia="1 1 1"/>
      <body name="rod"><inertial pos="0 0 0" mass="0.5" diaginertia="1 1 1"/>
      <joint name="rod" type="slide" axis="1 0 0" stiffness="50"/><geom name="pad" type="sphere" size="0.1" mass="0"/>
      </body></body></worldbody><actuator><motor name="push" joint="rod"/></actuator></mujoco>"""
    return scene(
        folder,
        robot,
        {"ball": ball("ball", mass=1.5, joints="x")},
        duration_s=0.8,
        time_step_s=step,
        control_period_s=0.008,
        initial={"joints": {"ball/x": 0.25}, "rates": {"robot/x": speed}},
        contacts={"rules": [{"between": ["pad", "ball/ball"], "restitution": 0.0}]},
    )


@pytest.mark.parametrize("step", [1e-3, 2e-3, 4e-3])
def test_a_spring_presses_for_half_its_period_and_lets_go(tmp_path, step):
    """The release is at the root of the force inside a step, the same to nine digits for every step (torque reversal).

    Base, pad at 0.5 m/s, hit at 0.1 s, plastic: pad and ball go on together at 0.125 m/s, the spring is pressed at the rate
    0.375 m/s by 4 kg against 2 kg and has its rest length again after half a period, pi / sqrt(k (1/4 + 1/2)). There its
    force, and that of the contact, three quarters of it, goes through zero.
    """
    parts = prepare(sprung(tmp_path, step)).assemble()
    run = simulate(parts)
    assert run.outcome == "completed"
    assert not parts.data.qfrc_applied.any()  # nothing is left of the contact
    (begins,), (ends,) = run.records["contact_beginnings"], run.records["contact_endings"]
    omega = np.sqrt(50.0 * (1 / 4 + 1 / 2))
    assert begins.time_s == pytest.approx(0.1, abs=1e-12)
    # RK4 of an oscillation: phase error (omega h)^4 / 120 of the phase pi, 4e-9 of half a second at 4 ms and h^4 below.
    assert ends.time_s == pytest.approx(0.1 + np.pi / omega, abs=1e-9 + np.pi / omega * (omega * step) ** 4 / 60)
    force = run["contact.pad_ball_ball_force_N"]
    assert force.min() >= 0.0
    t, held = run.time, (run.time > 0.1 + step) & (run.time < ends.time_s - step)
    expected = 0.75 * 50.0 * 0.375 / omega * np.sin(omega * (t - 0.1))
    np.testing.assert_allclose(force[held], expected[held], atol=1e-8 + 10 * (omega * step) ** 4)
    # What leaves does not come back: nothing is hit within ten steps.
    assert len(run.impacts) == 1


def wedge(name, tilt):
    """MJCF of a slab whose top, turned about y, goes through the origin."""
    return f"""<mujoco>{HEAD}<worldbody><geom name="{name}" type="box" size="2 2 0.5" euler="0 {tilt} 0"
      pos="{-0.5 * np.sin(np.deg2rad(tilt))} 0 {-0.5 * np.cos(np.deg2rad(tilt))}"/></worldbody></mujoco>"""


def test_a_sphere_between_two_faces_at_60_degrees(tmp_path):
    """Pressed down by F into a V of 60 degrees: each face, 60 degrees from level, bears F / (2 cos 60)."""
    push = {"kind": "pd", "joints": ["robot/z"], "kp": 200.0, "kd": 4.0, "target": [-1.0]}
    run = ffsm_mj.run(
        scene(
            tmp_path,
            ball("ball", mass=2.0, joints="xz"),
            {"left": wedge("left", 60.0), "right": wedge("right", -60.0)},
            fixed={"left": {}, "right": {}},
            initial={"joints": {"robot/z": 0.25, "robot/x": 0.005}},
            contacts={"rules": [{"between": ["ball", f"{name}/{name}"], "restitution": 0.2} for name in ("left", "right")]},
            phases=[{"name": "press", "until": "end", "controller": push}],
            duration_s=0.6,
            time_step_s=2e-3,
            control_period_s=2e-3,
        )
    )
    proved(run)
    pushed = -run["actuators.robot_push_z_applied_N"]
    for side in ("left", "right"):
        # It rests: the force is that of the motor at this row.
        force = run[f"contact.ball_{side}_{side}_force_N"]
        assert force[-1] == pytest.approx(pushed[-1] / (2.0 * np.cos(np.deg2rad(60.0))), rel=1e-9)


def test_two_accelerated_masses_share_a_force(tmp_path):
    """Constant force on 0.5 kg before 1.5 kg on a base of 4 kg: the force on the ball is its mass times the common rate."""
    robot = f"""<mujoco>{HEAD}<worldbody><body name="base"><joint name="x" type="slide" axis="1 0 0"/>
      <inertial pos="0 0 0" mass="4" diaginertia="1 1 1"/>
      <body name="rod"><inertial pos="0 0 0" mass="0.5" diaginertia="1 1 1"/>
      <joint name="rod" type="slide" axis="1 0 0"/><geom name="pad" type="sphere" size="0.1" mass="0"/>
      </body></body></worldbody><actuator><motor name="push" joint="rod"/></actuator></mujoco>"""
    # kp 1e-6 at a target of 1e7 m: 10 N, but for 1e-7 of it.
    push = {"kind": "pd", "joints": ["rod"], "kp": 1e-6, "kd": 0.0, "target": [1e7]}
    run = proved(
        ffsm_mj.run(
            scene(
                tmp_path,
                robot,
                {"ball": ball("ball", mass=1.5, joints="x")},
                initial={"joints": {"ball/x": 0.2}},
                contacts={"rules": [{"between": ["pad", "ball/ball"], "restitution": 0.0}]},
                phases=[{"name": "push", "until": "end", "controller": push}],
                time_step_s=5e-3,
                control_period_s=5e-3,
            )
        )
    )
    pushed = run["actuators.robot_push_applied_N"]
    np.testing.assert_allclose(run["contact.pad_ball_ball_force_N"][1:], 1.5 / 2.0 * pushed[1:], rtol=1e-12)
    # 1 s at 10 N / 2 kg; the pushed force falls by 1e-6 of 2.5 m of 1e7: nothing.
    assert run["state.q_ball_x_m"][-1] == pytest.approx(0.2 + 0.5 * 5.0, rel=1e-6)
