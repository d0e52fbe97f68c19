"""Generated scenes: a free base with an arm of any number of joints, any number of objects, all in motion and far apart."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.assembly.prepare import PreparedRun, prepare
from ffsm_mj.assembly.run import simulate

LINK_M, AWAY_M = 0.3, 20.0
MOST_KNOBS = 223
BENT_RAD, RATE_RAD_S = 0.3, 0.005
OFFSET_M = (-0.3, 0.3, 0.2)
HEAD = '<compiler angle="radian"/><option gravity="0 0 0" integrator="RK4"/>'
BOX = f"""<mujoco>{HEAD}<worldbody><body name="box"><inertial pos="0 0 0" mass="20" diaginertia="3 4 5"/>
<freejoint name="free"/><geom name="box" type="box" size="0.3 0.4 0.5" mass="0"/></body></worldbody></mujoco>"""


def robot(joints: int) -> str:
    """MJCF of a base of 200 kg on a free joint with an arm of links of 1 kg, turning about z and y in turn."""
    names = joint_names(joints)
    links = "".join(
        f"""<body name="{name}" pos="{LINK_M if i else 0.5} 0 0"><inertial pos="{LINK_M / 2} 0 0" mass="1"
        diaginertia="0.001 0.008 0.008"/><joint name="{name}" axis="{"0 1 0" if i % 2 else "0 0 1"}" armature="0.3"/>
        <geom name="{name}" type="capsule" fromto="0.05 0 0 {LINK_M - 0.05} 0 0" size="0.02" mass="0"/>"""
        for i, name in enumerate(names)
    )
    tip = f"""<site name="tip" pos="{LINK_M} 0 0"/>
    <geom name="gripper" type="sphere" pos="{LINK_M} 0 0" size="0.03" mass="0"/>"""
    motors = "".join(f'<motor name="{name}" joint="{name}"/>' for name in names)
    return f"""<mujoco>{HEAD}<worldbody><body name="bus"><freejoint name="base"/>
    <inertial pos="0 0 0" mass="200" diaginertia="30 35 40"/><geom name="bus" type="box" size="0.4 0.4 0.4" mass="0"/>
    {links}{tip}{"</body>" * joints}</body></worldbody><actuator>{motors}</actuator></mujoco>"""


def joint_names(joints: int) -> list[str]:
    """From the base outwards."""
    return [f"joint_{i}" for i in range(joints)]


def coasting(
    joints: int, *, objects: int = 1, duration_s: float = 10.0, changes: dict[str, Any] | None = None
) -> PreparedRun:
    """No control; the arm and the objects move, each object has an impact pair with the gripper.

    Args:
        joints: Number of joints of the arm.
        objects: Number of objects.
        duration_s: Duration of the run.
        changes: Further keys of the scenario.
    """
    return _prepared(joints, objects, duration_s, changes or {})


def beset(pairs: int, *, joints: int = 7, duration_s: float = 3.0) -> PreparedRun:
    """As :func:`coasting`, with so many pairs in one contact rule: every geom of the robot with knobs on the object.

    The object has the same geoms for every number of pairs; those of no pair collide with nothing.
    """
    colliding = 0 if pairs == 1 else -(-pairs // (joints + 2))
    knobs = "".join(
        f'<geom name="knob_{i}" size="0.02" pos="{0.3 * math.cos(i)} {0.3 * math.sin(i)} {0.01 * (i % 60 - 30)}" mass="0"'
        f' contype="{int(i < colliding)}" conaffinity="{int(i < colliding)}"/>'
        for i in range(MOST_KNOBS)
    )
    between = ["gripper", "box_0/box"] if pairs == 1 else ["robot", "box_0"]
    rules = [{"between": between, "restitution": 0.8}]
    box = BOX.replace('mass="0"/>', f'mass="0"/>{knobs}')
    return _prepared(joints, 1, duration_s, {"contacts": {"rules": rules}}, box)


def regulated(joints: int, *, duration_s: float = 3.0, changes: dict[str, Any] | None = None) -> PreparedRun:
    """OSDRE of three outputs at 1 kHz, towards half a metre from where the tip is; an object with a pair far away."""
    osdre = {
        "kind": "osdre",
        "parameterization": "velocity",
        "Q": [20.0] * 3 + [60.0] * 3,
        "R": [1.0] * joints,
    }
    changes = (changes or {}) | {
        "task": {"tip": "tip", "target_m": (_tip(joints) + OFFSET_M).tolist()},
        "phases": [{"name": "reach", "until": "end", "controller": osdre}],
    }
    return _prepared(joints, 1, duration_s, changes)


def _bent(joints: int) -> dict[str, float]:
    """The arm in a zigzag, so that it is never stretched out."""
    return {name: BENT_RAD * (-1) ** (i // 2) for i, name in enumerate(joint_names(joints))}


def _tip(joints: int) -> np.ndarray:
    model = mujoco.MjModel.from_xml_string(robot(joints))
    data = mujoco.MjData(model)
    data.qpos[7:] = list(_bent(joints).values())
    mujoco.mj_kinematics(model, data)
    return data.site("tip").xpos.copy()


def _prepared(joints: int, objects: int, duration_s: float, changes: dict[str, Any], box: str = BOX) -> PreparedRun:
    names = [f"box_{i}" for i in range(objects)]
    angles = {name: 2.0 * math.pi * i / objects for i, name in enumerate(names)}
    poses = {
        f"{name}/free": [AWAY_M * math.cos(angle), AWAY_M * math.sin(angle), 0.0, 1.0, 0.0, 0.0, 0.0]
        for name, angle in angles.items()
    }
    turning = {name: math.copysign(RATE_RAD_S, angle) for name, angle in _bent(joints).items()}
    scenario = {
        "name": f"joints_{joints}",
        "duration_s": duration_s,
        "time_step_s": 0.001,
        "control_period_s": 0.001,
        "robot": {"mjcf": "robot.xml"},
        "objects": {name: {"mjcf": "box.xml"} for name in names},
        "initial": {
            "joints": _bent(joints) | poses,
            "rates": turning
            | {"base": [0.01, 0.0, 0.0, 0.0, 0.02, 0.01]}
            | {pose: [0.01, 0.02, 0.0, 0.1, 0.0, 0.2] for pose in poses},
        },
        "contacts": {"rules": [{"between": ["gripper", f"{name}/box"], "restitution": 0.8} for name in names]},
        "phases": [{"name": "coast", "until": "end", "controller": {"kind": "off"}}],
    }
    with TemporaryDirectory() as folder:
        for name, text in (("robot.xml", robot(joints)), ("box.xml", box)):
            (Path(folder) / name).write_text(text)
        path = Path(folder) / "scene.yaml"
        path.write_text(json.dumps(scenario | changes))  # JSON is YAML
        return prepare(path)


def run_s(run: PreparedRun) -> float:
    """Process time of a run in memory, without its set-up, s."""
    assembly = run.assemble()
    began = time.process_time()
    done = simulate(assembly)
    spent = time.process_time() - began
    assert done.outcome == "completed", done.message
    return spent
