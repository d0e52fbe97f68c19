"""The resolved scenario of a log and the system compiled from it; both are validated, as a log may be of unknown origin."""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any

from pydantic import ValidationError

from ffsm_mj.errors import THE_LOG, InputError, ScenarioFaults
from ffsm_mj.log.mcap.format import SCENARIO_ATTACHMENT
from ffsm_mj.model.composition import compile_system
from ffsm_mj.model.edits import STRIPPABLE, AddedSite, JointFlex, motors_of, to_strip
from ffsm_mj.model.files import ModelFiles, logged_model, logged_name
from ffsm_mj.model.grasp import Grasp
from ffsm_mj.model.properties import BodyProperties, Overrides, Pose
from ffsm_mj.model.sensors import ADDED_KINDS, AddedSensor
from ffsm_mj.model.system import System
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.yaml import YamlFault, plain_value


@dataclass(frozen=True)
class LoggedScenario:
    """The parts of a scenario from which the models are compiled.

    Attributes:
        robot: Name of the robot's model file in the log.
        objects: Name of the model file of each object, by object.
        strip: Elements that are removed from the models, by ``robot`` or object.
        sites: Sites that are added to the robot.
        flex: Flexible drives of the robot, by joint.
        sensors: Sensors that are added to the scene.
        overrides: Changed properties of bodies and geoms, by ``robot`` or object; only models with changes.
        poses: Poses of the fixed objects, by object.
        bodies: Body of its file that a model is, by ``robot`` or object; only models that are a part of a file.
        time_step_s: Integration step, s.
        conservative: Whether the models are required to be conservative.
        view_rate_hz: Frames per simulated second for viewers.
        kinds: Kind of each actuator with limits, by its name in the scenario.
    """

    robot: str
    objects: Mapping[str, str]
    strip: Mapping[str, tuple[str, ...]]
    sites: tuple[AddedSite, ...]
    flex: Mapping[str, JointFlex]
    sensors: tuple[AddedSensor, ...]
    overrides: Mapping[str, Overrides]
    poses: Mapping[str, Pose]
    bodies: Mapping[str, str]
    time_step_s: float
    conservative: bool
    view_rate_hz: float
    kinds: Mapping[str, str]


def scenario_data(log: RunLog, place: str = THE_LOG) -> dict[str, Any]:
    """The scenario as plain data; ``place`` is the name of the log in messages.

    Raises:
        InputError: The log contains no scenario.
    """
    try:
        scenario = log.header.scenario
        data = plain_value(scenario) if isinstance(scenario, str) else deepcopy(dict(scenario))
    except YamlFault as fault:
        where = f"{SCENARIO_ATTACHMENT}:{fault.place.line}:{fault.place.column}"
        raise InputError(f"{place}: {where}: {fault.problem}") from fault
    if not isinstance(data, dict) or not data:
        raise InputError(f"{place}: contains no scenario, so its models cannot be compiled")
    return data


def logged_scenario(log: RunLog, place: str = THE_LOG) -> LoggedScenario:
    """The parts of the scenario that the models need; ``place`` is the name of the log in messages.

    Raises:
        InputError: The log contains no scenario, or one of another version.
    """
    data = scenario_data(log, place)
    try:
        objects = data.get("objects") or {}
        parts = {"robot": data["robot"], **objects}
        model = data.get("model") or {}
        if not parts.keys() >= model.keys():
            raise ValueError(f"model: {', '.join(map(str, model))} are not all models")
        return LoggedScenario(
            robot=_text(data["robot"]["mjcf"]),
            objects={_text(name): _text(part["mjcf"]) for name, part in objects.items()},
            strip={
                _text(name): tuple(map(_strippable, to_strip(part.get("strip"), part.get("limits"))))
                for name, part in parts.items()
            },
            sites=tuple(_site(_text(name), site) for name, site in (data["robot"].get("sites") or {}).items()),
            flex={_text(name): _flex(part) for name, part in (data["robot"].get("joint_flex") or {}).items()},
            sensors=tuple(
                _sensor(_text(name), part)
                for name, part in (data.get("sensors") or {}).items()
                if part.get("kind") is not None
            ),
            overrides={_text(name): _overrides(found) for name, found in model.items()},
            poses={name: _pose(part.get("pose")) for name, part in objects.items() if part.get("fixed") is True},
            bodies={_text(name): _text(part["body"]) for name, part in parts.items() if part.get("body") is not None},
            time_step_s=_positive(data["time_step_s"]),
            conservative=data["conservative"] is not False,
            view_rate_hz=_positive(data["log"]["view_rate_hz"]),
            kinds={_text(name): _text(part["kind"]) for name, part in (data.get("actuators") or {}).items()},
        )
    except KeyError as error:
        raise InputError(f"{place}: {SCENARIO_ATTACHMENT}: not a scenario of this version, {error} is missing") from error
    except (TypeError, AttributeError, ValueError) as error:
        raise InputError(f"{place}: {SCENARIO_ATTACHMENT}: not a scenario of this version ({error})") from error


def _strippable(value: Any) -> str:
    if value not in STRIPPABLE:
        raise ValueError(f"strip: {value!r} is none of {', '.join(STRIPPABLE)}")
    return str(value)


def _site(name: str, data: Any) -> AddedSite:
    place = data.get("pos_m") or (0.0, 0.0, 0.0)
    if len(place) != 3 or not all(isinstance(x, int | float) and math.isfinite(x) for x in place):
        raise ValueError(f"sites: {place!r} is not a position")
    return AddedSite(name, _text(data["body"]), (float(place[0]), float(place[1]), float(place[2])))


def _flex(value: Any) -> JointFlex:
    try:
        return JointFlex.model_validate(value)
    except ValidationError as error:
        raise ValueError(f"joint_flex: {error.errors()[0]['msg']}") from error


def _sensor(name: str, data: Any) -> AddedSensor:
    if data["kind"] not in ADDED_KINDS:
        raise ValueError(f"sensors: {data['kind']!r} is none of {', '.join(ADDED_KINDS)}")
    return AddedSensor(name, data["kind"], _text(data["of"]), _text(data.get("relative_to") or ""))


def _overrides(bodies: Any) -> Overrides:
    try:
        return Overrides("model", {_text(body): BodyProperties.model_validate(given) for body, given in bodies.items()})
    except ValidationError as error:
        raise ValueError(f"model: {error.errors()[0]['msg']}") from error


def _pose(value: Any) -> Pose:
    try:
        return Pose.model_validate({} if value is None else value)
    except ValidationError as error:
        raise ValueError(f"pose: {error.errors()[0]['msg']}") from error


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{value!r} should be text")
    return value


def _positive(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < math.inf:
        raise TypeError(f"{value!r} should be a positive number")
    return float(value)


def compile_log(log: RunLog, place: str = THE_LOG, grasp: Grasp | None = None) -> System:
    """Compile the models in a log as a run does; control laws of plug-ins need not be installed.

    Only the log is read and nothing is written: a model in the log that refers to a file outside it is refused.

    Args:
        log: The log.
        place: Its name in messages.
        grasp: Grasp that is closed; None: none, as at the start of a run.

    Raises:
        InputError: The log contains no scenario, or a model that is incomplete or no longer compiles.
    """
    scenario = logged_scenario(log, place)

    def model_of(name: str, main: str) -> ModelFiles:
        # Models of one file are stored with the first of them.
        owners = ("robot", *scenario.objects) if name in scenario.bodies else (name,)
        prefix = next((each for owner in owners if main.startswith(each := logged_name(owner, ""))), "")
        if not prefix:
            raise InputError(f"{place}: the model of {name} is {main!r}, which is not below {logged_name(name, '')}")
        files = {key.removeprefix(prefix): content for key, content in log.header.files.items() if key.startswith(prefix)}
        model = logged_model(main.removeprefix(prefix), files, f"{place}: {prefix}")
        changed = (scenario.overrides[name],) if scenario.overrides.get(name) else ()
        body = scenario.bodies.get(name, "")
        return replace(
            model,
            strip=scenario.strip[name],
            motors=motors_of(name, scenario.kinds),
            overrides=changed,
            pose=scenario.poses.get(name),
            body=body,
        )

    try:
        return compile_system(
            replace(model_of("robot", scenario.robot), sites=scenario.sites, flex=scenario.flex),
            {name: model_of(name, main) for name, main in scenario.objects.items()},
            time_step_s=scenario.time_step_s,
            conservative=scenario.conservative,
            grasp=grasp,
            sensors=scenario.sensors,
        )
    except ScenarioFaults as error:
        raise InputError([f"{place}: {fault.message}" for fault in error.faults]) from error
