"""Contacts of bodies that latches join: the latches leave their gap no motion, or the contact a single relative one."""

from __future__ import annotations

import pytest

import ffsm_mj
from tests import long_share
from tests.contact_models.impact.test_fixed import slab
from tests.replays import proved
from tests.scenes import scene

BOX = """<mujoco><option gravity="{gravity}"/><worldbody><body name="object"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="2" diaginertia="0.01 0.01 0.01"/><geom name="box" type="box" size="0.1 0.05 0.1" mass="0"/>
  <site name="handle" pos="0 -0.05 0"/><site name="aside" pos="0.03 -0.05 0"/><site name="end" pos="-0.1 0 0"/>
  </body></worldbody></mujoco>"""
FINGER = """<mujoco><option gravity="{gravity}"/><worldbody><body name="base"><freejoint name="base"/>
  <inertial pos="0 0 0" mass="20" diaginertia="1 1.2 2"/>
  <body name="finger" pos="0 0.3 0"><joint name="j" type="slide" axis="0 1 0" limited="{limited}" range="-1 0.05"/>
    <inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>
    <geom name="pad" type="box" size="0.06 0.02 0.06" mass="0"/>
    <site name="tip" pos="0 0.02 0"/><site name="aside" pos="0.03 0.02 0"/></body></body></worldbody>
  <actuator><motor name="m" joint="j"/></actuator></mujoco>"""
LINK = """<mujoco><option gravity="0 0 0"/><worldbody><body name="base"><freejoint name="base"/>
  <inertial pos="0 0 0" mass="20" diaginertia="1 1.2 2"/>
  <geom name="link" type="capsule" fromto="0.35 0 0 0.5 0 0" size="0.03" mass="0"/><site name="tip" pos="0.56 0 0"/>
  </body></worldbody></mujoco>"""
AXIS = {
    "rigid": {},
    "ball": {},
    "hinge": {"axis": [0, 1, 0]},
    "slide": {"axis": [1, 0, 0]},
    "cylindrical": {"axis": [1, 0, 0]},
}


def pressed(folder, kind, *, limited=False, mu=0.0, restitution=0.0, gravity="0 0 0", wall_mu=0.0, **scenario):
    """A finger holds a box, which its pad touches, by one or two latches, and presses it on a wall or meets its limit."""
    latch = {"robot_site": "tip", "object_site": "handle", "joint": kind, "when": {"within": {"position_m": 0.06}}}
    return scene(
        folder,
        FINGER.format(limited=str(limited).lower(), gravity=gravity),
        {"object": BOX.format(gravity=gravity), "wall": slab("wall", "2 0.5 2").replace("0 0 0", gravity)},
        fixed={"wall": {"position_m": [0, 0.92, 0]}},
        **{
            "time_step_s": 2e-3,
            "control_period_s": 4e-3,
            "duration_s": 0.1,
            "initial": {"joints": {"object/free": [0.01, 0.37, 0.005, 1, 0, 0, 0]}},
            "contacts": {
                "rules": [
                    {"between": ["pad", "object/box"], "restitution": restitution, "mu": mu},
                    {"between": ["object/box", "wall/wall"], "restitution": restitution, "mu": wall_mu},
                ]
            },
            "grasps": {"grasp": latch | AXIS[kind]},
            "phases": [
                {
                    "name": "hold",
                    "until": "end",
                    "arm": ["grasp"],
                    "controller": {"kind": "pd", "joints": ["j"], "kp": 50, "kd": 10, "target": [0.1]},
                }
            ],
        }
        | scenario,
    )


@pytest.mark.long
@pytest.mark.parametrize("mu", [0.0, 0.4])
@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_a_contact_that_latches_hold_takes_no_part_in_a_limit_impact(tmp_path, mu, restitution):
    """Pad and box are held by a hinge and a ball as the joint meets its limit: the limit alone has an impulse.

    Base and held bodies then move on together, at the common speed 3 kg * 0.2 m/s / 23 kg.
    """
    path = pressed(
        tmp_path,
        "hinge",
        limited=True,
        mu=mu,
        restitution=restitution,
        duration_s=0.3,
        initial={
            "joints": {"object/free": [0, 0.37, 0, 1, 0, 0, 0]},
            "rates": {"j": 0.2, "object/free": [0, 0.2, 0, 0, 0, 0]},
        },
        grasps={
            "one": {"robot_site": "tip", "object_site": "handle", "joint": "hinge", "axis": [0, 1, 0], "when": NEAR},
            "two": {"robot_site": "robot/aside", "object_site": "object/aside", "joint": "ball", "when": NEAR},
        },
        contacts={"rules": [{"between": ["pad", "object/box"], "restitution": restitution, "mu": mu}]},
        phases=[{"name": "hold", "until": "end", "arm": ["one", "two"], "controller": {"kind": "off"}}],
    )
    run = proved(ffsm_mj.run(path))
    assert run["state.v_robot_base_vy_m_s"][-1] == pytest.approx(0.6 / 23, abs=1e-12)
    assert run["state.v_robot_j_m_s"][-1] == pytest.approx(0.0, abs=1e-12)


NEAR = {"within": {"position_m": 0.01}}


@pytest.mark.long
@pytest.mark.parametrize("mu", [0.0, 0.4])
@pytest.mark.parametrize("kind", AXIS)
def test_a_latched_box_is_pressed_against_a_wall(tmp_path, kind, mu):
    """Latches of every kind fix the gap of pad and box along the normal: only the wall has a force, that of the motor."""
    run = proved(ffsm_mj.run(pressed(tmp_path, kind, mu=mu, wall_mu=mu)))
    assert run["contact.object_box_wall_wall_mode"].max() > 0.0


def test_a_ball_latch_bears_what_a_face_does_not(tmp_path):
    """Gravity presses a finger, its box on a ball latch and the wall together: all stick, from the start to the end.

    The latch takes any pressure of the pad, so the margin of the friction cones has no bound along internal forces.
    """
    run = proved(
        ffsm_mj.run(
            pressed(
                tmp_path,
                "ball",
                mu=0.4,
                wall_mu=0.4,
                gravity="0 1 0.025",
                conservative=False,
                duration_s=0.4 if long_share.every_case else 0.08,
                initial={"joints": {"object/free": [0.01, 0.37, 0.005, 1, 0, 0, 0]}},
            )
        )
    )
    assert run["contact.object_box_wall_wall_mode"][-1] == 3.0


@pytest.mark.long
@pytest.mark.parametrize(
    ("restitution", "mu", "path", "status"),
    [
        (0.0, 0.9, "slip", "ok"),
        (0.0, 60.0, "slip, stick", "wedged"),
        (0.24, 60.0, "slip, stick", "wedged"),
        (0.24, 0.3, "slip, reverse slip", "ok"),
        (1.0, 60.0, "slip, stick", "wedged"),
    ],
)
def test_a_hinge_leaves_a_contact_one_relative_motion(tmp_path, restitution, mu, path, status):
    """Slip and normal velocity vanish together: run, check and replay agree on path, work and use of friction."""
    latch = {"robot_site": "tip", "object_site": "end", "joint": "hinge", "axis": [0, 0, 1]}
    run = proved(
        ffsm_mj.run(
            scene(
                tmp_path,
                LINK,
                {"object": BOX.format(gravity="0 0 0")},
                duration_s=0.4,
                initial={
                    "joints": {"object/free": [0.66, 0, 0, 1, 0, 0, 0]},
                    "rates": {"object/free": [0, 0, 0, 0.9, 1.3, 7.0]},
                },
                contacts={"rules": [{"between": ["robot", "object"], "restitution": restitution, "mu": mu}]},
                grasps={"grasp": latch | {"when": {"within": {"position_m": 0.06}}}},
                phases=[{"name": "hold", "until": "end", "arm": ["grasp"], "controller": {"kind": "off"}}],
            )
        )
    )
    (hit, *_) = run.impacts
    assert (hit.path, hit.status) == (path, status)
    after = 0.0 if status == "wedged" else restitution
    # Exact but for the drift of the latch and the normal of the capsule, 1e-10.
    assert hit.normal_work_J == pytest.approx((1.0 - after**2) * hit.compression_work_J, rel=1e-9)
    assert hit.compression_work_J < 0.0
