"""Seeded throws: an object of 40 kg that tumbles towards a published robot, whose joints are free, held, or moving."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.model.system import System
from tests.robots.geom_distance import Distances
from tests.robots.published import CONTACTS, ROBOTS
from tests.scenes import HEAD

Vector = NDArray[np.float64]

MASS_KG = 40.0
OBJECTS = ("box", "compound", "mesh")
ARMS = ("off", "hold", "joint_path")
_FAR_M = 5.0
_BANDWIDTH_HZ = 0.5
_MOTION_RAD = 0.6


@dataclass(frozen=True)
class Throw:
    """A scenario on disk, and what was drawn for it.

    Attributes:
        path: The scenario file.
        shape: Kind of the object, one of ``OBJECTS``.
        arm: What the joints of the robot do, one of ``ARMS``.
        speed_m_s: Speed of the object.
    """

    path: Path
    shape: str
    arm: str
    speed_m_s: float


def write_throw(robot: str, seed: int, folder: Path, duration_s: float = 20.0) -> Throw:
    """The throw of a seed at a robot: nine seeds in a row have all objects and all kinds of arms."""
    rng = np.random.default_rng([sorted(ROBOTS).index(robot), seed])
    shape, arm = OBJECTS[seed % 3], ARMS[seed // 3 % 3]
    (folder / "debris.xml").write_text(_debris(shape, rng))
    stated = ROBOTS[robot](folder)
    pose = {name: value for name, value in stated["initial"]["joints"].items() if name != "rock/rock"}
    scenario: dict[str, Any] = {
        "name": f"{robot}-{seed}",
        "duration_s": duration_s,
        "time_step_s": 0.002,
        "control_period_s": 0.01,
        "accuracy": 1e-9,
        "robot": stated["robot"],
        "objects": {"debris": {"mjcf": "debris.xml"}},
        "contacts": {**CONTACTS, "default": {"restitution": 0.3}},
        "initial": {"joints": pose},
        "phases": [{"name": "throw", "until": "end", "controller": {"kind": "off"}}],
    }
    path = folder / f"{robot}-{seed}.yaml"
    path.write_text(json.dumps(scenario))  # JSON is YAML
    system = prepare(path, {"initial.joints": {**pose, "debris/debris": [0, 0, 9, 1, 0, 0, 0]}}).system
    speed = float(np.exp(rng.uniform(np.log(0.05), np.log(1.0))))
    place, rate = _aim(system, pose, speed, rng)
    scenario["initial"] = {"joints": {**pose, "debris/debris": place}, "rates": {"debris/debris": rate}}
    scenario["phases"][0]["controller"] = _controller(arm, system, pose, rng)
    path.write_text(json.dumps(scenario))
    return Throw(path, shape, arm, speed)


def _aim(
    system: System, pose: Mapping[str, float], speed: float, rng: np.random.Generator
) -> tuple[list[float], list[float]]:
    """Pose and rates of the object on its way to a geom of the robot: without spin it would meet it within 1 s."""
    model, data = system.mj, mujoco.MjData(system.mj)
    for name, value in pose.items():
        data.qpos[system.joint(f"robot/{name}").qpos] = value
    debris = system.joint("debris/debris").qpos.start
    direction, turn = _unit(rng.normal(size=3)), _unit(rng.normal(size=4))
    data.qpos[debris + 3 : debris + 7] = turn
    mujoco.mj_kinematics(model, data)
    distances = Distances(model)
    target = data.geom_xpos[int(rng.choice(sorted({a for a, _ in distances.pairs})))].copy()
    # Marching by the distance of the whole object never jumps over a geom of the robot.
    away = _FAR_M
    while True:
        data.qpos[debris : debris + 3] = target + away * direction
        mujoco.mj_kinematics(model, data)
        gap = distances.smallest(data)
        if gap < 1e-3 or away < 0.0:
            break
        away -= gap
    spin = _unit(rng.normal(size=3)) * rng.uniform(0.05, 1.0)
    place = target + (away + speed * rng.uniform(0.1, 1.0)) * direction
    return [*place.tolist(), *turn.tolist()], [*(-speed * direction).tolist(), *spin.tolist()]


def _controller(arm: str, system: System, pose: Mapping[str, float], rng: np.random.Generator) -> dict[str, Any]:
    """Nothing, the pose held, or a path through three poses within the limits, of all driven joints."""
    if arm == "off":
        return {"kind": "off"}
    if arm == "hold":
        return {"kind": "hold", "bandwidth_Hz": _BANDWIDTH_HZ}
    model = system.mj
    joints = [int(joint) for joint in model.actuator_trnid[:, 0]]
    start = np.array([pose.get(model.joint(j).name.removeprefix("robot/"), 0.0) for j in joints])
    ends = [model.jnt_range[j] if model.jnt_limited[j] else (-np.inf, np.inf) for j in joints]
    # A path through waypoints overshoots them, by less than it moves.
    room = np.array([min(q - low, high - q) for q, (low, high) in zip(start, ends, strict=True)])
    travel = np.minimum(_MOTION_RAD, 0.5 * room)
    waypoints = [
        {"at_s": 3.0 * k, "positions": (start + travel * rng.uniform(-1.0, 1.0, len(joints))).tolist()} for k in range(1, 4)
    ]
    return {"kind": "joint_path", "bandwidth_Hz": _BANDWIDTH_HZ, "waypoints": waypoints}


def _debris(shape: str, rng: np.random.Generator) -> str:
    """MJCF of a free object of 40 kg: a box, some convex geoms of all kinds on one body, or the hull of random points."""
    asset = ""
    if shape == "box":
        geoms = f'<geom name="box" type="box" size="{_numbers(rng.uniform(0.08, 0.25, 3))}" mass="{MASS_KG}"/>'
    elif shape == "mesh":
        points = np.array([_unit(p) for p in rng.normal(size=(14, 3))]) * rng.uniform(0.12, 0.3, 3)
        asset = f'<asset><mesh name="hull" vertex="{_numbers(points.ravel())}"/></asset>'
        geoms = f'<geom name="hull" type="mesh" mesh="hull" mass="{MASS_KG}"/>'
    else:
        kinds = {"box": 3, "sphere": 1, "capsule": 2, "cylinder": 2}
        geoms = ""
        for kind, count in kinds.items():
            size, at, turn = rng.uniform(0.06, 0.15, count), rng.uniform(-0.2, 0.2, 3), _unit(rng.normal(size=4))
            place = f'pos="{_numbers(at)}" quat="{_numbers(turn)}" mass="{MASS_KG / len(kinds)}"'
            geoms += f'<geom name="{kind}" type="{kind}" size="{_numbers(size)}" {place}/>'
    return f"""<mujoco model="debris">{HEAD}{asset}<worldbody><body name="debris"><freejoint name="debris"/>{geoms}
      </body></worldbody></mujoco>"""


def _unit(vector: Vector) -> Vector:
    return np.asarray(vector / np.linalg.norm(vector))


def _numbers(values: Vector) -> str:
    return " ".join(repr(float(value)) for value in values)
