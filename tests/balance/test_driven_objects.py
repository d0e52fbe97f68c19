"""Objects with actuators: a second spacecraft with thrusters, wheels and a panel, driven by laws, in its own balance."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import InputError
from ffsm_mj.records.signals import COMPONENTS
from tests.contact_models.grasp.scenes import ARM, OFF
from tests.replays import proved
from tests.scenes import HEAD, ball, scene
from tests.simulation.restored import goes_on, is_rest_of


def _wheel(axis, x, y, z):
    return f"""<body name="rotor_{axis}" pos="{x} {y} {z}"><joint name="rotor_{axis}" axis="{x * 10} {y * 10} {z * 10}"/>
      <inertial pos="0 0 0" mass="0.2" diaginertia="0.001 0.001 0.001"/></body>"""


CLIENT = f"""<mujoco>{HEAD}<worldbody><body name="client"><freejoint name="free"/>
  <inertial pos="0.03 -0.02 0.01" mass="3" diaginertia="0.04 0.05 0.06"/>
  <geom name="target" type="sphere" size="0.1" mass="0"/><site name="handle" pos="-0.1 0.01 0.02"/>
  <site name="plus" pos="0.1 0.05 0" euler="0 90 10"/><site name="minus" pos="-0.05 0.05 0.1" euler="0 -90 0"/>
  {_wheel("x", 0.1, 0, 0)}{_wheel("y", 0, 0.1, 0)}{_wheel("z", 0, 0, 0.1)}
  <body name="panel" pos="0.1 0.1 0"><joint name="hinge" axis="0 0 1" stiffness="0.5" damping="0.02"/>
    <inertial pos="0.2 0 0" mass="0.4" diaginertia="0.002 0.005 0.006"/>
    <site name="tip" pos="0.4 0 0" euler="0 80 0"/></body>
  </body></worldbody><actuator>
  <motor name="plus" site="plus" gear="0 0 1 0 0 0" ctrlrange="0 5"/>
  <motor name="minus" site="minus" gear="0 0 1 0 0 0" ctrlrange="0 5"/>
  <motor name="tip" site="tip" gear="0 0 1 0.1 0 0"/>
  <motor name="wheel_x" joint="rotor_x"/><motor name="wheel_y" joint="rotor_y"/><motor name="wheel_z" joint="rotor_z"/>
  <motor name="hinge" joint="hinge" gear="2"/></actuator></mujoco>"""
"""A spacecraft with two thrusters on its bus, one at the tip of a flexible panel, three wheels, and a motor of the panel."""

WHEELS = ["wheel_x", "wheel_y", "wheel_z"]
STEADY = {"kind": "base_pd", "wheels": WHEELS, "rotation": {"kp": 0.4, "kd": 0.3}}
PANEL = {"kind": "hold", "joints": ["hinge"], "bandwidth_rad_s": 3.0}
POSE, RATES = [2.0, 0.3, -0.2, 0.8, 0.4, -0.4, 0.2], [0.05, -0.02, 0.01, 0.1, -0.2, 0.3]


def jets(folder):
    """A record of the efforts of the thrusters."""
    (folder / "jets.csv").write_text("time_s,plus_N,minus_N,tip_N\n0,0.5,0,0.3\n0.6,0,0.4,-0.2\n1.1,0,0,0.1\n")
    return {"kind": "playback", "file": "jets.csv"}


def alone(folder, as_robot, **changes):
    """The spacecraft drives itself, far from a ball: as the robot of the scene, or as its object."""
    folder.mkdir()
    parts = {"attitude": STEADY, "panel": PANEL, "jets": jets(folder)}
    phase = {"name": "steady", "until": "end", "controllers": parts}
    client, other = ("robot", "rock") if as_robot else ("rock", "robot")
    models = (CLIENT, ball("rock")) if as_robot else (ball("rock"), CLIENT)
    return scene(
        folder,
        models[0],
        {"rock": models[1]},
        **{
            "duration_s": 1.5,
            "control_period_s": 0.01,
            "initial": {
                "joints": {f"{client}/free": POSE, "hinge": 0.2, f"{other}/free": [9, 0, 0, 1, 0, 0, 0]},
                "rates": {f"{client}/free": RATES, "rotor_x": 3.0},
            },
            "phases": [phase if as_robot else phase | {"drives": dict.fromkeys(("attitude", "panel"), "rock")}],
        }
        | changes,
    )


def impulse(run, name):
    """Columns of an impulse in the balance, (n, 6)."""
    return np.column_stack([run[f"balance.{name}_{component}"] for component in COMPONENTS])


def test_an_object_is_driven_as_a_robot_is(tmp_path):
    """The same laws drive the same spacecraft: the same motion, work and impulse, entered for the objects."""
    robot, driven = (ffsm_mj.run(alone(tmp_path / name, name == "robot")) for name in ("robot", "object"))
    for run in (robot, driven):
        proved(run)
    same = {"rtol": 0, "atol": 1e-11}  # sums over the bodies of both models are in another order
    for key in ("q_{}_free_x_m", "v_{}_free_wx_rad_s", "q_{}_hinge_rad", "v_{}_rotor_z_rad_s"):
        np.testing.assert_allclose(driven[f"state.{key.format('rock')}"], robot[f"state.{key.format('robot')}"], **same)
    np.testing.assert_allclose(driven["balance.objects_work_J"], robot["balance.work_J"], **same)
    np.testing.assert_allclose(impulse(driven, "external_on_objects"), impulse(robot, "external"), **same)
    assert abs(robot["balance.work_J"]).max() > 0.01
    assert abs(impulse(robot, "external")).max() > 0.1
    assert not driven["balance.work_J"].any()
    assert not impulse(driven, "external").any()


HAND = {"robot_site": "grip", "object_site": "client/handle", "when": {"within": {"position_m": 0.5}}}
KINDS = {"rigid": {}, "ball": {"joint": "ball"}, "slide": {"joint": "slide", "axis": [2.0, -3.0, 6.0]}}


def berthing(folder, latch, **changes):
    """An arm grasps the spacecraft at once, which goes on to drive itself, and lets it go after 0.6 s."""
    folder.mkdir(exist_ok=True)
    arm = {"kind": "pd", "joints": ["shoulder", "elbow"], "kp": 2.0, "kd": 1.0, "target": [0.5, -0.4]}
    client = {"attitude": STEADY, "panel": PANEL}
    parts = {"controllers": {"arm": arm, **client, "jets": jets(folder)}, "drives": dict.fromkeys(client, "client")}
    return scene(
        folder,
        ARM,
        {"client": CLIENT},
        **{
            "duration_s": 0.8,
            "control_period_s": 0.01,
            "initial": {
                "joints": {"client/free": [1.06, 0.03, 0.02, 1, 0, 0, 0], "hinge": 0.2},
                "rates": {
                    "robot/free": [0, 0, 0, 0.02, -0.03, 0.05],
                    "client/free": [-0.3, 0, 0, 0.4, -0.2, 0.3],
                    "rotor_x": 3.0,
                },
            },
            "grasps": {"grasp": {**HAND, **KINDS[latch]}},
            "phases": [
                {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": OFF},
                {"name": "hold", "for_s": 0.6, **parts},
                {"name": "leave", "until": "end", "release": ["grasp"], **parts},
            ],
        }
        | changes,
    )


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize("latch", KINDS)
def test_a_grasped_object_drives_itself(tmp_path, latch):
    """What its wheels and thrusters do is its own, and what the latch passes on is the robot's: all checks hold."""
    run = ffsm_mj.run(berthing(tmp_path, latch))
    proved(run)
    assert len(run.grasps) == 1
    assert abs(run["balance.objects_work_J"]).max() > 0.01
    assert abs(impulse(run, "external_on_objects")).max() > 0.1
    assert not impulse(run, "external").any()


def test_order_four_through_a_grasp(tmp_path):
    """Errors of rates at 5 and 2.5 ms against 1.25 ms are as 255 to 15; checks pass at five times the usual step too."""
    runs = {h: ffsm_mj.run(berthing(tmp_path / str(h), "ball", time_step_s=h)) for h in (5e-3, 2.5e-3, 1.25e-3)}
    keys = [key for key in runs[5e-3].log.header.layout.keys if key.startswith("state.v_")]
    ends = {h: np.array([run[key][-1] for key in keys]) for h, run in runs.items()}
    coarse, fine = (abs(ends[h] - ends[1.25e-3]).max() for h in (5e-3, 2.5e-3))
    assert coarse / fine > 2**3.5
    assert fine < 1e-8
    assert [check for check in all_checks(runs[5e-3]) if not check.passes] == []


def test_it_goes_on_from_any_decision(tmp_path):
    """Out through bytes while it is grasped, and to the end, bit for bit."""
    path = berthing(tmp_path, "ball")
    assert is_rest_of(*goes_on(path, 0.3))


def test_commands_of_a_program_drive_an_object(tmp_path):
    """The balance of the objects holds under efforts from outside, and a thruster of a body at rest gives F t."""
    path = alone(tmp_path / "given", False, initial={"joints": {"rock/free": POSE, "robot/free": [9, 0, 0, 1, 0, 0, 0]}})
    simulator = ffsm_mj.Simulator(path, {"phases": [{"name": "wait", "until": "end", "controller": OFF}]})
    simulator.reset()
    while not simulator.ended:
        simulator.step({"rock/plus": 0.5})
    run = simulator.close()
    assert [check for check in all_checks(run) if not check.passes] == []
    given = impulse(run, "external_on_objects")[-1, :3]
    assert 0.5 * np.linalg.norm(given) < 0.5 * 1.5 * 0.5 * 2.0  # it turns: less than F t along a line
    assert np.linalg.norm(given) > 0.1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"drives": {"attitude": "rack"}}, r"drives\.attitude: unknown object that moves 'rack' .did you mean 'rock'"),
        ({"drives": {"arm": "rock"}}, "'drives' names 'arm', which is no part of 'controllers'"),
        ({"drives": {"panel": "rock"}}, r"controllers\.attitude\.wheels.*: rock/wheel_x is no actuator of 'robot'"),
        ({"drives": {"attitude": "rock"}}, r"controllers\.panel\.joints.*: unknown motor-driven joint 'hinge'"),
        ({"controllers": None, "controller": STEADY, "drives": {}}, "rock/wheel_x is no actuator of 'robot'"),
    ],
)
def test_what_cannot_be_driven_is_refused(tmp_path, changes, message):
    """By file, line and key: an unknown object or part, and actuators of an object without its name."""
    parts = {"attitude": STEADY, "panel": PANEL}
    phase = {"name": "p", "until": "end", "controllers": parts} | changes
    phase = {key: value for key, value in phase.items() if value is not None}
    with pytest.raises(InputError, match=message):
        prepare(alone(tmp_path / "scene", False, phases=[phase]))
