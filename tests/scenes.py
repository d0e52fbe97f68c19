"""Small scenes for tests: bodies as MJCF text, scenarios as dictionaries, both written to a folder."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import mujoco

from ffsm_mj.dynamics.rigid_body import subtree_momenta
from ffsm_mj.model.composition import compile_system
from ffsm_mj.model.files import read_model
from ffsm_mj.model.system import System

HEAD = '<option gravity="0 0 0"/>'


def ball(name: str = "ball", *, mass: float = 1.0, radius: float = 0.1, joints: str = "free", extra: str = "") -> str:
    """MJCF of one sphere; ``joints`` is ``free`` or a string of axes to slide along."""
    dofs = (
        '<freejoint name="free"/>'
        if joints == "free"
        else "".join(f'<joint name="{a}" type="slide" axis="{_AXIS[a]}"/>' for a in joints)
    )
    inertia = 0.4 * mass * radius**2
    return f"""<mujoco>{HEAD}<worldbody><body name="{name}">
      <inertial pos="0 0 0" mass="{mass}" diaginertia="{inertia} {inertia} {inertia}"/>{dofs}
      <geom name="{name}" type="sphere" size="{radius}" mass="0"/>
      <site name="centre"/>{extra}</body></worldbody>
      <actuator>{_motors(joints)}</actuator></mujoco>"""


def box(name: str = "box", *, mass: float = 1.0, half: tuple[float, float, float] = (0.5, 0.5, 0.5)) -> str:
    """MJCF of one free box of uniform density."""
    a, b, c = (2 * h for h in half)
    inertia = [mass / 12 * (y * y + z * z) for y, z in ((b, c), (a, c), (a, b))]
    return f"""<mujoco>{HEAD}<worldbody><body name="{name}">
      <inertial pos="0 0 0" mass="{mass}" diaginertia="{inertia[0]} {inertia[1]} {inertia[2]}"/><freejoint name="free"/>
      <geom name="{name}" type="box" size="{half[0]} {half[1]} {half[2]}" mass="0"/></body></worldbody></mujoco>"""


def falling_box(folder, pose, rates):
    """A box of 1 m a side falls onto a fixed slab, e = 0.5, for 0.02 s; far from the robot."""
    slab = '<geom name="slab" type="box" size="2 2 0.5" pos="0 0 -0.5" mass="0"/>'
    return scene(
        folder,
        ball("ball"),
        {"box": box(), "slab": f"<mujoco>{HEAD}<worldbody>{slab}</worldbody></mujoco>"},
        fixed={"slab": {}},
        duration_s=0.02,
        initial={"joints": {"robot/free": [9, 0, 0, 1, 0, 0, 0], "box/free": pose}, "rates": {"box/free": rates}},
        contacts={"rules": [{"between": ["box/box", "slab/slab"], "restitution": 0.5}]},
    )


FLOATING_BASES = {
    "free": '<freejoint name="free"/>',
    "planar": """<joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
      <joint name="yaw" axis="0 0 1"/>""",
    "ball": '<joint name="ball" type="ball" pos="0.1 0.2 -0.1"/>',
}
"""Joints of a base, as MJCF."""

_AXIS = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}


def _motors(joints: str) -> str:
    return "" if joints == "free" else "".join(f'<motor name="push_{a}" joint="{a}"/>' for a in joints)


def compile_paths(robot: Path, objects: dict[str, Path] | None = None, **options: Any) -> System:
    """A system from model files on disk, with a step of 1 ms unless ``options`` say otherwise."""
    models = {name: read_model(path) for name, path in (objects or {}).items()}
    return compile_system(read_model(robot), models, **{"time_step_s": 1e-3, **options})


def of_subtree(model, data, root):
    """(P, L about the origin) of the subtree of a body, summed body by body."""
    mujoco.mj_subtreeVel(model, data)
    return subtree_momenta(
        model.body_subtreemass[root], data.subtree_linvel[root], data.subtree_com[root], data.subtree_angmom[root]
    )


def scene(
    folder: Path, robot: str, objects: dict[str, str], *, fixed: dict[str, dict[str, Any]] | None = None, **scenario: Any
) -> Path:
    """Write models and a scenario; returns the scenario's path. Defaults: 1 s, 1 ms, everything off, no contacts.

    ``fixed`` has the poses of objects that do not move, by name.
    """
    (folder / "robot.xml").write_text(robot)
    for name, mjcf in objects.items():
        (folder / f"{name}.xml").write_text(mjcf)
    data: dict[str, Any] = {
        "name": "scene",
        "duration_s": 1.0,
        "robot": {"mjcf": "robot.xml"},
        "objects": {
            name: {"mjcf": f"{name}.xml"} | ({"fixed": True, "pose": fixed[name]} if name in (fixed or {}) else {})
            for name in objects
        },
        "contacts": {"rules": []},
        "phases": [{"name": "coast", "until": "end", "controller": {"kind": "off"}}],
    }
    path = folder / "scene.yaml"
    path.write_text(json.dumps(data | scenario))  # JSON is YAML
    return path


def two_balls(folder: Path, *, speed: float = 1.0, gap: float = 0.3, restitution: float = 1.0, **scenario: Any) -> Path:
    """A sliding ball of 2 kg that hits one of 3 kg at rest, along x, at t = gap / speed."""
    return scene(
        folder,
        ball("ball", mass=2.0, joints="x"),
        {"target": ball("target", mass=3.0, joints="x")},
        **{
            "initial": {"joints": {"target/x": 0.2 + gap}, "rates": {"robot/x": speed}},
            "contacts": {"rules": [{"between": ["ball", "target/target"], "restitution": restitution}]},
            **scenario,
        },
    )


ARM = f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="5" diaginertia="0.3 0.3 0.3"/>
  <geom name="hull" type="box" size="0.2 0.2 0.2" mass="0"/>
  <body name="upper" pos="0.25 0 0"><joint name="shoulder" axis="0 0 1"/>
    <inertial pos="0.25 0 0" mass="1" diaginertia="0.01 0.02 0.02"/>
    <geom name="upper" type="capsule" fromto="0.03 0 0 0.47 0 0" size="0.02" mass="0"/>
    <geom name="round" size="0.04" mass="0"/>
    <body name="lower" pos="0.5 0 0"><joint name="elbow" axis="0 0 1"/>
      <inertial pos="0.25 0 0" mass="0.8" diaginertia="0.01 0.02 0.02"/>
      <geom name="tip" size="0.05" pos="0.5 0 0" mass="0"/>
      <body name="finger" pos="0.5 0 0"><inertial pos="0 0 0" mass="0.1" diaginertia="0.001 0.001 0.001"/>
        <geom name="finger" size="0.01" mass="0"/></body>
    </body></body></body></worldbody>
  <actuator><motor name="shoulder" joint="shoulder"/><motor name="elbow" joint="elbow"/></actuator></mujoco>"""
"""A base with an arm of two links; folded by 200 degrees or so, the tip meets the hull."""


def self_hit(folder, *, pair=("hull", "tip"), restitution=0.6, **scenario):
    """The arm folds at 1 rad/s in free flight, turning and tumbling, and its tip hits its own base."""
    return scene(
        folder,
        ARM,
        {"rock": ball("rock")},
        **{
            "duration_s": 0.7,
            "initial": {
                "joints": {"shoulder": math.pi / 3, "elbow": 2 * math.pi / 3, "rock/free": [9, 9, 9, 1, 0, 0, 0]},
                "rates": {"elbow": 1.0, "robot/free": [0.1, -0.2, 0.3, 0.05, 0.02, -0.1], "rock/free": [0.1, 0, 0, 0, 0, 0]},
            },
            "contacts": {"rules": [{"between": list(pair), "restitution": restitution}]},
            **scenario,
        },
    )


def three_balls(folder, pairs, **scenario):
    """The robot, 2 kg at 1 m/s, reaches the left ball, 3 kg at rest, after 0.1 s; the right one, 1 kg, lies 0.2 m behind."""
    return scene(
        folder,
        ball("ball", mass=2.0, joints="x"),
        {"left": ball("left", mass=3.0, joints="x"), "right": ball("right", mass=1.0, joints="x")},
        **{
            "duration_s": 0.6,
            "initial": {"joints": {"left/x": 0.3, "right/x": 0.7}, "rates": {"robot/x": 1.0}},
            "contacts": {"rules": pairs},
            **scenario,
        },
    )


CHAIN = [
    {"between": ["ball", "left/left"], "restitution": 0.8},
    {"between": ["left/left", "right/right"], "restitution": 0.5, "name": "behind"},
]
