"""A grasp of a link that moves relative to the base of its object: the same as if that link were the base."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from tests.contact_models.grasp.scenes import ARM, OFF
from tests.replays import proved
from tests.scenes import HEAD, ball, scene

BUS = '<inertial pos="0.03 -0.02 0.01" mass="3" diaginertia="0.04 0.05 0.06"/><geom name="bus" size="0.1" mass="0"/>'
PANEL = """<inertial pos="-0.2 0.02 0" mass="0.8" diaginertia="0.01 0.02 0.025"/><site name="handle" pos="-0.35 0.02 0.01"/>
  <geom name="panel" type="capsule" fromto="-0.05 0 0 -0.3 0 0" size="0.02" mass="0"/>"""
SPRING, MOTOR = 'stiffness="2" damping="0.05"', '<actuator><motor name="hinge" joint="hinge"/></actuator>'
HALF = np.sqrt(0.5)
TURN = f"{np.cos(np.pi / 8)} 0 0 {np.sin(np.pi / 8)}"
BACK = f"{np.cos(np.pi / 8)} 0 0 {-np.sin(np.pi / 8)}"

FROM_BUS = f"""<mujoco>{HEAD}<worldbody><body name="bus"><freejoint name="free"/>{BUS}
  <body name="panel" pos="-0.1 0.05 0" quat="{TURN}"><joint name="hinge" axis="0 1 0" {SPRING}/>{PANEL}</body>
  </body></worldbody>{MOTOR}</mujoco>"""
_AT = -np.array(((HALF, HALF, 0), (-HALF, HALF, 0), (0, 0, 1))) @ (-0.1, 0.05, 0)
FROM_PANEL = f"""<mujoco>{HEAD}<worldbody><body name="panel"><freejoint name="free"/>{PANEL}
  <body name="bus" pos="{_AT[0]} {_AT[1]} 0" quat="{BACK}">
  <joint name="hinge" pos="-0.1 0.05 0" axis="{-HALF} {HALF} 0" {SPRING}/>{BUS}</body></body></worldbody>{MOTOR}</mujoco>"""
"""The same object from its bus to its panel, and the other way round: the angle of the hinge has the other sign."""

POSE, RATES = [1.5, 0.06, 0.02, 0.8, 0.4, -0.4, 0.2], [-0.1, 0.05, 0.02, 0.3, -0.2, 0.4]
ANGLE, RATE = 0.3, -0.5


def start(from_bus):
    """Pose and rates of the root of the object, for the same motion in both models."""
    if from_bus:
        return POSE, RATES
    model = mujoco.MjModel.from_xml_string(FROM_BUS)
    data, twist = mujoco.MjData(model), np.empty(6)
    data.qpos[:], data.qvel[:] = [*POSE, ANGLE], [*RATES, RATE]
    mujoco.mj_forward(model, data)
    panel = model.body("panel").id
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, panel, twist, 0)
    spin = data.xmat[panel].reshape(3, 3).T @ twist[:3]
    return [*data.xpos[panel].tolist(), *data.xquat[panel].tolist()], [*twist[3:].tolist(), *spin.tolist()]


ANY = {"within": {"position_m": 5.0}}


def catching(folder, *, from_bus=True, latch="rigid", others=None, **changes):
    """An arm grasps the panel of a tumbling object at once, moves, and lets it go after 0.4 s."""
    folder.mkdir(exist_ok=True)
    pose, rates = start(from_bus)
    sign = 1.0 if from_bus else -1.0
    grasp = {"robot_site": "grip", "object_site": "client/handle", "when": ANY}
    kinds = {"rigid": {}, "ball": {"joint": "ball"}, "slide": {"joint": "slide", "axis": [2.0, -3.0, 6.0]}}
    arm = {"kind": "pd", "joints": ["shoulder", "elbow"], "kp": 2.0, "kd": 1.0, "target": [0.5, -0.4]}
    return scene(
        folder,
        ARM,
        {"client": FROM_BUS if from_bus else FROM_PANEL, **(others or {})},
        **{
            "duration_s": 0.5,
            "initial": {
                "joints": {"client/free": pose, "hinge": sign * ANGLE},
                "rates": {"robot/free": [0, 0, 0, 0.02, -0.03, 0.05], "client/free": rates, "hinge": sign * RATE},
            },
            "grasps": {"grasp": grasp | kinds[latch]},
            "phases": [
                {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": OFF},
                {"name": "hold", "for_s": 0.4, "controller": arm},
                {"name": "leave", "until": "end", "release": ["grasp"], "controller": OFF},
            ],
        }
        | changes,
    )


COMMON = [
    f"state.{c}_robot_{name}"
    for c, names in (
        ("q", ("free_x_m", "free_qy", "shoulder_rad", "elbow_rad")),
        ("v", ("free_vx_m_s", "shoulder_rad_s", "elbow_rad_s")),
    )
    for name in names
]


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize("latch", ["rigid", "ball", "slide"])
def test_it_is_a_grasp_of_a_base(tmp_path, latch):
    """Rows hold the panel where it is a link, a joint where it is the root: the same impulse, motion and load."""
    link, base = (ffsm_mj.run(catching(tmp_path / str(b), from_bus=b, latch=latch)) for b in (True, False))
    for run in (link, base):
        proved(run)
    one, other = link.records["grasp_impulses"][0], base.records["grasp_impulses"][0]
    np.testing.assert_allclose(one.impulse_N_s, other.impulse_N_s, atol=1e-13)
    np.testing.assert_allclose(one.angular_impulse_N_m_s, other.angular_impulse_N_m_s, atol=1e-13)
    assert one.loss_J == pytest.approx(other.loss_J, rel=1e-11)
    # Both are of order four: they differ by the truncation of their steps.
    keys = [key for key in COMMON if key in link.keys] + [f"contact.grasp_force_{x}_N" for x in "xyz"]
    assert len(keys) >= 8
    for key in keys:
        np.testing.assert_allclose(link[key], base[key], atol=2e-9, err_msg=key)
    np.testing.assert_allclose(link["state.q_client_hinge_rad"], -base["state.q_client_hinge_rad"], atol=2e-9)


def test_the_two_converge_with_order_four(tmp_path):
    """What they differ by falls by 16 as the step is halved."""
    apart = []
    for step in (4e-3, 2e-3):
        runs = [
            ffsm_mj.run(catching(tmp_path / f"{b}{step}", from_bus=b, time_step_s=step, control_period_s=4e-3))
            for b in (True, False)
        ]
        apart.append(max(abs(runs[0][key][-1] - runs[1][key][-1]) for key in COMMON if key in runs[0].keys))
    assert apart[0] / apart[1] > 2**3.5


def test_a_base_and_a_link_at_once(tmp_path):
    """The base becomes a child, the panel is a further grasp; the base lets go first, and rows hold the panel alone."""
    bus = FROM_BUS.replace('<geom name="bus"', '<site name="lug" pos="-0.1 0 0"/><geom name="bus"')
    arm = ARM.replace('<body name="upper"', '<site name="clamp" pos="0.4 0 0"/><body name="upper"')
    grasps = {
        "panel": {"robot_site": "grip", "object_site": "handle", "when": ANY},
        "bus": {"robot_site": "clamp", "object_site": "lug", "when": ANY},
    }
    phases = [
        {"name": "one", "for_s": 0.1, "arm": ["panel"], "controller": OFF},
        {"name": "two", "for_s": 0.1, "arm": ["bus"], "controller": OFF},
        {"name": "three", "for_s": 0.1, "release": ["bus"], "controller": OFF},
        {"name": "four", "until": "end", "release": ["panel"], "controller": OFF},
    ]
    path = catching(tmp_path / "scene", grasps=grasps, phases=phases)
    for name, text in (("robot", arm), ("client", bus)):
        (path.parent / f"{name}.xml").write_text(text)
    run = ffsm_mj.run(path)
    proved(run)
    # Robot and object have 15 coordinates; 9 are left of the first grasp, and 6 of the loop through base, arm and hinge.
    impulses = [(each.grasp, each.rank, each.mobility) for each in run.records["grasp_impulses"]]
    assert impulses == [("panel", 6, 9), ("bus", 3, 6)]
    assert [each.release_s for each in run.grasps] == [pytest.approx(0.3, abs=2e-3), pytest.approx(0.2, abs=2e-3)]


def test_it_is_hit_while_it_is_held(tmp_path):
    """A ball hits the bus of the object that is held at its panel: momenta and energy are kept through the impact."""
    run = ffsm_mj.run(
        catching(
            tmp_path / "scene",
            others={"stone": ball("stone", mass=0.5)},
            contacts={"rules": [{"between": ["bus", "stone/stone"], "restitution": 1.0}]},
            initial={
                "joints": {"client/free": POSE, "hinge": ANGLE, "stone/free": [1.5, 0.06, 0.35, 1, 0, 0, 0]},
                "rates": {"client/free": RATES, "hinge": RATE, "stone/free": [0, 0, -1.5, 0, 0, 0]},
            },
        )
    )
    proved(run)
    assert run.impacts
    assert run.impacts[0].time_s < 0.4


def test_its_motor_works_while_the_panel_is_held(tmp_path):
    """The hinge between bus and panel is driven by a part of the phase; its work is the object's."""
    hold = {"kind": "hold", "joints": ["hinge"], "bandwidth_rad_s": 5.0}
    arm = {"kind": "pd", "joints": ["shoulder", "elbow"], "kp": 2.0, "kd": 1.0, "target": [0.5, -0.4]}
    phases = [
        {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": OFF},
        {"name": "hold", "until": "end", "controllers": {"arm": arm, "panel": hold}, "drives": {"panel": "client"}},
    ]
    run = ffsm_mj.run(catching(tmp_path / "scene", phases=phases))
    proved(run)
    assert [check for check in all_checks(run) if not check.passes] == []
    assert abs(run["balance.objects_work_J"]).max() > 1e-4
