"""Sensors that a scenario adds: a model file cannot refer to another model, as a camera does that looks at an object."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal, get_args

import mujoco

from ffsm_mj.errors import Fault, ScenarioFaults, unknown_name
from ffsm_mj.model.sensors import ModelSensor, unit_of_sensor

AddedKind = Literal[
    "framepos",
    "framequat",
    "framelinvel",
    "frameangvel",
    "gyro",
    "accelerometer",
    "velocimeter",
    "force",
    "torque",
    "touch",
    "jointpos",
    "jointvel",
]
ADDED_KINDS: tuple[str, ...] = get_args(AddedKind)
_FRAMES = ("framepos", "framequat", "framelinvel", "frameangvel")
_OF_JOINTS = ("jointpos", "jointvel")


@dataclass(frozen=True)
class AddedSensor:
    """A sensor to add to the scene.

    Attributes:
        name: Its name.
        kind: Its element in MJCF.
        of: Name of the site, body or joint that it is on or measures.
        relative_to: Name of the site or body in whose frame it measures; empty: the world.
    """

    name: str
    kind: str
    of: str
    relative_to: str = ""


def add_sensors(scene: Any, sensors: Iterable[AddedSensor], *, grasped: bool = False) -> dict[str, ModelSensor]:
    """Add sensors to the specification of a scene; returns them by name.

    Args:
        scene: The scene, with all models attached.
        sensors: The sensors.
        grasped: A grasp is closed in this scene: sensors of joints that it removes, which the scene without it has, are not
            added, like those of a file.

    Raises:
        ScenarioFaults: There is no such site, body or joint.
    """
    found, faults = {}, []
    for sensor in sensors:
        if any(each.name == sensor.name for each in scene.sensors):
            faults.append(
                Fault("is a sensor of a model already; choose another name, or leave out 'kind'", ("sensors", sensor.name))
            )
            continue
        try:
            measured = _element(scene, sensor, "of")
            made = scene.add_sensor(name=sensor.name, type=getattr(mujoco.mjtSensor, f"mjSENS_{sensor.kind.upper()}"))
            made.objtype, made.objname = measured
            if sensor.relative_to:
                made.reftype, made.refname = _element(scene, sensor, "relative_to")
            name = made.objname
            found[sensor.name] = ModelSensor(sensor.name, sensor.kind, unit_of_sensor(scene, sensor.kind, name))
        except LookupError as error:
            if grasped and sensor.kind in _OF_JOINTS:
                continue
            faults.append(Fault(str(error.args[0]), ("sensors", sensor.name, error.args[1])))
    if faults:
        raise ScenarioFaults(faults)
    return found


def _element(scene: Any, sensor: AddedSensor, key: str) -> tuple[Any, str]:
    """Type and full name of the element that a key names.

    Raises:
        LookupError: There is none; the second argument is the key.
    """
    name = getattr(sensor, key)
    kinds = ["joint"] if sensor.kind in _OF_JOINTS else ["site", "body"] if sensor.kind in _FRAMES else ["site"]
    types = {"joint": mujoco.mjtObj.mjOBJ_JOINT, "site": mujoco.mjtObj.mjOBJ_SITE, "body": mujoco.mjtObj.mjOBJ_XBODY}
    known: list[str] = []
    for kind in kinds:
        names = [each.name for each in {"joint": scene.joints, "site": scene.sites, "body": scene.bodies}[kind]]
        matches = [full for full in names if name in (full, full.partition("/")[2])]
        if name in matches or len(matches) == 1:
            return types[kind], name if name in matches else matches[0]
        if matches:
            raise LookupError(f"{kind} {name!r} is ambiguous; write one of {', '.join(matches)}", key)
        known += [full for full in names if full and full != "world"]
    raise LookupError(unknown_name(" or ".join(kinds), name, known), key)
