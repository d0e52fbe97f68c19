"""Four published robots on free bases, a rock on its way to each; an MJCF of a few lines where it takes one."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.robots.vendors import vendor_path
from tests.scenes import HEAD

ROCK = f"""<mujoco model="rock">{HEAD}<worldbody><body name="rock"><freejoint name="rock"/>
  <geom name="rock" type="box" size="0.06 0.05 0.03" mass="2"/></body></worldbody></mujoco>"""
OFF = {"kind": "off"}
CONTACTS = {
    "default": {"restitution": 0.8},
    "ignored": [{"between": ["robot", "self"], "reason": "links of one arm overlap at their joints by design"}],
}
"""Every geom of a robot may touch the rock; vendors' geoms of neighbouring links overlap."""


def write_scenario(name: str, folder: Path) -> Path:
    """The scenario of a robot by its name, with the models that it needs beside it."""
    scenario = {
        "name": name,
        "duration_s": 1.0,
        "time_step_s": 0.002,
        "control_period_s": 0.01,
        "objects": {"rock": {"mjcf": "rock.xml"}},
        "contacts": CONTACTS,
        **ROBOTS[name](folder),
    }
    (folder / "rock.xml").write_text(ROCK)
    path = folder / f"{name}.yaml"
    path.write_text(json.dumps(scenario))  # JSON is YAML
    return path


def _phases(first: dict[str, Any], then: dict[str, Any]) -> list[dict[str, Any]]:
    return [
        {"name": "before", "until": "impact", "controller": first},
        {"name": "pause", "for_s": 0.1, "controller": OFF},
        {"name": "after", "until": "end", "controller": then},
    ]


def _pd(kp: float, kd: float) -> dict[str, Any]:
    return {"kind": "pd", "kp": kp, "kd": kd}


def _reach(joints: int) -> dict[str, Any]:
    return {"kind": "osdre", "Q": [5.0] * 3 + [8.0] * 3, "R": [1.0] * joints}


def _bus(model: str, file: Path, root: str, folder: Path, joints: tuple[str, ...] = ()) -> str:
    """A satellite of 200 kg on which a vendor's file is mounted; its joints get motors where it gives them none."""
    motors = "".join(f'<motor name="{joint}" joint="arm_{joint}"/>' for joint in joints)
    return f"""<mujoco model="bus">{HEAD}
      <asset><model name="{model}" file="{os.path.relpath(file, folder)}"/></asset>
      <worldbody><body name="bus"><freejoint name="float"/><geom name="bus" type="box" size="0.4 0.4 0.3" mass="200"/>
        <frame pos="0 0 0.3"><attach model="{model}" body="{root}" prefix="arm_"/></frame></body></worldbody>
      <actuator>{motors}</actuator></mujoco>"""


def _iiwa(folder: Path) -> dict[str, Any]:
    """KUKA iiwa: MJCF with meshes and motors, reaching for the rock with a tip that the scenario gives it."""
    file = vendor_path("robosuite", "robosuite/models/assets/robots/iiwa/robot.xml")
    (folder / "bus.xml").write_text(_bus("iiwa", file, "base", folder))
    return {
        "robot": {
            "mjcf": "bus.xml",
            "asset_folders": [os.path.relpath(file.parent, folder)],
            "strip": ["damping"],
            "sites": {"tip": {"body": "arm_right_hand"}},
        },
        "initial": {
            "joints": {"rock/rock": [0.75, 0.02, 1.34, 1, 0, 0, 0], "arm_joint_2": 0.3, "arm_joint_4": -0.6},
            "rates": {"rock/rock": [-0.4, 0, 0, 0.1, 0.2, 0.3]},
        },
        "task": {"tip": "tip", "axes": ["x", "y", "z"], "target_m": [0.7, 0.0, 1.3]},
        "phases": _phases(_reach(7), OFF),
    }


def _panda(folder: Path) -> dict[str, Any]:
    """Franka Panda: the MJCF attaches a URDF, whose <mimic> is taken out; its packages are found above it."""
    share = vendor_path("example-robot-data", "cmeel.prefix/share/example-robot-data")
    file = share / "robots/panda_description/urdf/panda.urdf"
    arm = tuple(f"panda_joint{i}" for i in range(1, 8))
    fingers = ("panda_finger_joint1", "panda_finger_joint2")
    (folder / "bus.xml").write_text(_bus("panda", file, "panda_link0", folder, (*arm, *fingers)))
    return {
        "robot": {
            "mjcf": "bus.xml",
            "asset_folders": [os.path.relpath(share, folder)],
            "strip": ["damping", "equalities"],
        },
        "initial": {
            "joints": {
                "rock/rock": [0.66, 0.11, 0.91, 1, 0, 0, 0],
                **{f"arm_{joint}": 0.02 for joint in fingers},
                "arm_panda_joint4": -1.5,
                "arm_panda_joint6": 1.5,
            },
            "rates": {"rock/rock": [-0.3, -0.3, 0, 0.1, 0.2, 0.3]},
        },
        "phases": _phases(_pd(4.0, 0.4), _pd(4.0, 0.4)),
    }


def _ur5(folder: Path) -> dict[str, Any]:
    """Universal Robots UR5: a URDF by itself, away from its package, its own root floating; the tool frame is the tip."""
    share = vendor_path("example-robot-data", "cmeel.prefix/share/example-robot-data")
    shutil.copy(share / "robots/ur_description/urdf/ur5_robot.urdf", folder)
    return {
        "robot": {
            "mjcf": "ur5_robot.urdf",
            "package_paths": [os.path.relpath(share.parent, folder)],
        },
        "initial": {
            "joints": {"rock/rock": [0.53, 0.38, 0.32, 1, 0, 0, 0], "shoulder_lift_joint": -1.2, "elbow_joint": 1.4},
            "rates": {"rock/rock": [0, -0.4, 0, 0.1, 0.2, 0.3]},
        },
        "task": {"tip": "tool0", "axes": ["x", "y", "z"], "target_m": [0.52, 0.25, 0.32]},
        "phases": _phases(_reach(6), _pd(2.0, 0.2)),
    }


def _quadruped(folder: Path) -> dict[str, Any]:
    """The quadruped of dm_control: of its scene, which has tendons and servos, the body floats alone, with motors."""
    file = vendor_path("dm_control", "dm_control/suite/quadruped.xml")
    corners = ("front_left", "front_right", "back_left", "back_right")
    joints = [f"{joint}_{corner}" for corner in corners for joint in ("yaw", "pitch", "knee", "ankle")]
    motors = "".join(f'<motor name="{joint}" joint="q_{joint}"/>' for joint in joints)
    (folder / "walker.xml").write_text(f"""<mujoco model="walker">{HEAD}
      <asset><model name="quadruped" file="{os.path.relpath(file, folder)}"/></asset>
      <worldbody><attach model="quadruped" body="torso" prefix="q_"/></worldbody>
      <actuator>{motors}</actuator></mujoco>""")
    return {
        "robot": {
            "mjcf": "walker.xml",
            "asset_folders": [os.path.relpath(file.parent, folder)],
            "strip": ["damping", "equalities", "tendons", "servos"],
        },
        "initial": {
            "joints": {"rock/rock": [0.8, 0.8, 0.13, 1, 0, 0, 0], "q_root": [0, 0, 0.57, 1, 0, 0, 0]},
            "rates": {"rock/rock": [-0.4, -0.4, 0, 0.1, 0.2, 0.3]},
        },
        "phases": _phases(_pd(4.0, 0.4), _pd(4.0, 0.4)),
    }


ROBOTS: dict[str, Callable[[Path], dict[str, Any]]] = {
    "iiwa": _iiwa,
    "panda": _panda,
    "ur5": _ur5,
    "quadruped": _quadruped,
}
"""By name, what stands in a robot's scenario alone; what else it needs is written into the folder that is given."""
