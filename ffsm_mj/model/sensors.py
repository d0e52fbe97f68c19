"""Sensors of a model file and timing of its actuators, read as numbers, and sensors that a scenario adds.

MuJoCo adds no noise, samples at the ends of steps only, and keeps delayed values in a buffer that is part of the state.
:mod:`ffsm_mj.sensing` does all of that from these numbers, so that the compiled model has neither delays nor cutoffs.
A model file cannot refer to another model, as a camera does that looks at an object: a scenario adds such sensors.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple, get_args

import mujoco

from ffsm_mj.errors import Fault, InputError, ScenarioFaults, full_name, names_like, unknown_name
from ffsm_mj.model.files import ModelFiles

Shape = Literal["vector", "direction", "rotation"]

_UNITS = {
    "accelerometer": "m/s^2",
    "velocimeter": "m/s",
    "gyro": "rad/s",
    "force": "N",
    "torque": "N m",
    "touch": "N",
    "magnetometer": "T",
    "rangefinder": "m",
    "jointpos": "",
    "jointvel": "",
    "actuatorpos": "",
    "actuatorvel": "",
    "actuatorfrc": "",
    "jointactuatorfrc": "",
    "tendonpos": "",
    "tendonvel": "",
    "tendonactuatorfrc": "",
    "ballquat": "",
    "ballangvel": "rad/s",
    "framepos": "m",
    "framequat": "",
    "framexaxis": "",
    "frameyaxis": "",
    "framezaxis": "",
    "framelinvel": "m/s",
    "frameangvel": "rad/s",
    "framelinacc": "m/s^2",
    "frameangacc": "rad/s^2",
    "subtreecom": "m",
    "subtreelinvel": "m/s",
    "subtreeangmom": "N m s",
    "e_kinetic": "J",
    "clock": "s",
    "startracker": "",
    "horizon": "",
}
"""Unit of each kind of sensor that can be measured, by its MJCF element; joints have that of their axis."""
_ELEMENTS = {
    "jointactfrc": "jointactuatorfrc",
    "tendonactfrc": "tendonactuatorfrc",
    "geomdist": "distance",
    "geomnormal": "normal",
    "geomfromto": "fromto",
}
"""Elements of MJCF whose names differ from those of MuJoCo's types."""
_HINGE = mujoco.mjtJoint.mjJNT_HINGE
_DISTANCE_ONLY = 1 << int(mujoco.mjtRayDataField.mjRAYDATA_DIST)
_DIRECTIONS = ("framexaxis", "frameyaxis", "framezaxis", "horizon")
_ROTATIONS = ("framequat", "ballquat", "startracker")
_TYPES = {"startracker": mujoco.mjtSensor.mjSENS_FRAMEQUAT, "horizon": mujoco.mjtSensor.mjSENS_FRAMEZAXIS}
"""MuJoCo's sensors of the size and stage of those that it lacks; :mod:`ffsm_mj.sensing.reader` makes their values."""


@dataclass(frozen=True)
class ModelSensor:
    """A sensor as its model file has it.

    Attributes:
        name: Full name.
        kind: Its element in MJCF, such as ``gyro``.
        unit: Unit of its values; empty for plain numbers.
        noise: Standard deviation of the noise of a sample, in this unit, rad for rotations.
        cutoff: Greatest absolute value; 0: none.
        interval_s: Time between samples; 0: the control period.
        first_s: Time of the first sample.
        delay_s: Time from a sample to its arrival.
    """

    name: str
    kind: str
    unit: str
    noise: float = 0.0
    cutoff: float = 0.0
    interval_s: float = 0.0
    first_s: float = 0.0
    delay_s: float = 0.0

    @property
    def shape(self) -> Shape:
        """What its value is: a vector (or number), a unit vector, or a unit quaternion."""
        if self.kind in _ROTATIONS:
            return "rotation"
        return "direction" if self.kind in _DIRECTIONS else "vector"


class Timing(NamedTuple):
    """Sensors of a model file, and timing that MuJoCo is not given.

    Attributes:
        sensors: Sensors by their names in the file; of a kind that cannot be measured without a unit.
        unbuffered: Those of which MuJoCo would keep no samples, and so not use interval and delay.
        actuator_delays_s: Delay of each actuator that has one, by its name in the file, s.
        interpolated: Actuators and sensors between whose delayed values MuJoCo would interpolate, as text.
    """

    sensors: dict[str, ModelSensor]
    unbuffered: set[str]
    actuator_delays_s: dict[str, float]
    interpolated: tuple[str, ...]


def take_timing(spec: Any) -> Timing:
    """Read sensors and timing in a specification, whose elements have names, and set the timing to zero there.

    MuJoCo would keep delayed values in its state, and refuses a delay without a buffer for it.
    """
    sensors, unbuffered, delays = dict[str, ModelSensor](), set[str](), dict[str, float]()
    interpolated = [
        f"{kind} {element.name!r}"
        for kind, listed in (("sensor", spec.sensors), ("actuator", spec.actuators))
        for element in listed
        if element.interp and element.nsample
    ]
    for sensor in spec.sensors:
        every, phase = map(float, sensor.interval)
        type_name = mujoco.mjtSensor(sensor.type).name.removeprefix("mjSENS_").lower()
        kind, first = _ELEMENTS.get(type_name, type_name), phase % every if every > 0.0 else 0.0
        unit = unit_of_sensor(spec, kind, sensor.objname) if kind in _UNITS else ""
        numbers = float(sensor.noise), float(sensor.cutoff), every, first, float(sensor.delay)
        sensors[sensor.name] = ModelSensor(sensor.name, kind, unit, *numbers)
        if (every or sensor.delay) and not sensor.nsample:
            unbuffered.add(sensor.name)
        sensor.interval, sensor.delay, sensor.nsample, sensor.cutoff = [0.0, 0.0], 0.0, 0, 0.0
    for actuator in spec.actuators:
        if actuator.delay > 0.0:
            delays[actuator.name] = float(actuator.delay)
        actuator.delay, actuator.nsample = 0.0, 0
    return Timing(sensors, unbuffered, delays, tuple(interpolated))


def sensors_of_model(spec: Any, model: str, files: ModelFiles, timing: Timing) -> tuple[dict[str, ModelSensor], list[str]]:
    """Sensors of a model by full name, and notes on what of its file is used otherwise than by MuJoCo.

    Args:
        spec: Specification of the model, which may lack some of the sensors of its file; all its elements have names.
        model: Its name in the scene.
        files: Its files.
        timing: Sensors and timing in the file.

    Raises:
        InputError: A sensor of a kind that cannot be measured.
    """
    by_name, notes, faults = dict[str, ModelSensor](), list[str](), list[str]()
    for sensor in spec.sensors:
        timed, name = timing.sensors[sensor.name], f"{model}/{sensor.name}"
        by_name[name] = replace(timed, name=name)
        if timed.kind not in _UNITS:
            faults.append(
                f"{_place(files, timed.kind, sensor)}: sensor {sensor.name!r} is a <{timed.kind}>, which cannot be "
                f"measured; remove it, or use 'strip: [sensors]'; known are {', '.join(_UNITS)}"
            )
        elif timed.kind == "rangefinder" and (what := _of_an_image(sensor)):
            faults.append(
                f"{_place(files, timed.kind, sensor)}: rangefinder {sensor.name!r} has {what}: only the distance from a "
                "site is measured; remove it, or use 'strip: [sensors]'"
            )
    if faults:
        raise InputError(faults)
    if without := [repr(f"{model}/{sensor.name}") for sensor in spec.sensors if sensor.name in timing.unbuffered]:
        notes.append(
            f"interval and delay of {'sensor' if len(without) == 1 else 'sensors'} {', '.join(without)} are used, although "
            "MuJoCo ignores or refuses them without nsample"
        )
    return by_name, notes


def _of_an_image(rangefinder: Any) -> str:
    """Attributes by which a rangefinder measures more than a distance: rays of a camera, and other ``data``."""
    if rangefinder.objtype == mujoco.mjtObj.mjOBJ_CAMERA:
        return "a camera"
    return "data" if rangefinder.intprm[0] != _DISTANCE_ONLY else ""


def _place(files: ModelFiles, kind: str, sensor: Any) -> str:
    """``file:line`` of a sensor, in an included file too; the main file if it is not found."""
    candidates = [element for element in files.elements() if element.tag == kind and "sensor" in element.parents]
    named = [element for element in candidates if element.attributes.get("name") == sensor.name]
    unnamed = [
        element
        for element in candidates
        if "name" not in element.attributes and sensor.objname in ("", *element.attributes.values())
    ]
    return (*(element.place for element in (*named, *unnamed)), files.place)[0]


def unit_of_sensor(spec: Any, kind: str, element: str) -> str:
    """Unit of a kind of sensor on an element of a specification."""
    kinds = {"pos": ("rad", "m"), "vel": ("rad/s", "m/s"), "actuatorfrc": ("N m", "N")}
    if kind.startswith("joint"):
        joint = spec.joint(element)
        return kinds[kind.removeprefix("joint")][joint is not None and joint.type == mujoco.mjtJoint.mjJNT_SLIDE]
    if kind.startswith("tendon"):
        # The length of a fixed tendon of hinges alone is an angle, every other one a length.
        tendon = spec.tendon(element)
        path = tendon.path if tendon is not None else ()
        hinges = all(wrap.type == mujoco.mjtWrap.mjWRAP_JOINT and wrap.target.type == _HINGE for wrap in path)
        return kinds[kind.removeprefix("tendon")][not hinges]
    return _UNITS[kind]


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
    "magnetometer",
    "startracker",
    "horizon",
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
    added, faults = {}, []
    for sensor in sensors:
        if any(existing.name == sensor.name for existing in scene.sensors):
            faults.append(
                Fault("is a sensor of a model already; choose another name, or leave out 'kind'", ("sensors", sensor.name))
            )
            continue
        try:
            measured = _element(scene, sensor, "of")
            kind = _TYPES.get(sensor.kind) or getattr(mujoco.mjtSensor, f"mjSENS_{sensor.kind.upper()}")
            mj_sensor = scene.add_sensor(name=sensor.name, type=kind)
            mj_sensor.objtype, mj_sensor.objname = measured
            if sensor.relative_to:
                mj_sensor.reftype, mj_sensor.refname = _element(scene, sensor, "relative_to")
            name = mj_sensor.objname
            added[sensor.name] = ModelSensor(sensor.name, sensor.kind, unit_of_sensor(scene, sensor.kind, name))
        except LookupError as error:
            if grasped and sensor.kind in _OF_JOINTS:
                continue
            faults.append(Fault(str(error.args[0]), ("sensors", sensor.name, error.args[1])))
    if faults:
        raise ScenarioFaults(faults)
    return added


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
        names = [element.name for element in {"joint": scene.joints, "site": scene.sites, "body": scene.bodies}[kind]]
        if names_like(name, names):
            try:
                return types[kind], full_name(kind, name, names)
            except LookupError as error:
                raise LookupError(*error.args, key) from None
        known += [full for full in names if full and full != "world"]
    raise LookupError(unknown_name(" or ".join(kinds), name, known), key)
