"""The resolved scenario of a log: what the models are built from, checked, since anybody may have written it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from pydantic import ValidationError

from ffsm_mj.errors import THE_LOG, InputError, ScenarioFaults
from ffsm_mj.log.mcap.format import SCENARIO_ATTACHMENT
from ffsm_mj.model.files import ModelFiles, logged_model, logged_name
from ffsm_mj.model.grasp import Grasp
from ffsm_mj.model.properties import BodyProperties, Overrides, Pose
from ffsm_mj.model.sites import AddedSite
from ffsm_mj.model.strip import STRIPPABLE
from ffsm_mj.model.system import System, compile_system
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.yaml.parser import YamlFault, plain_value


@dataclass(frozen=True)
class LoggedScenario:
    """Parts of a scenario.

    Attributes:
        robot: Name of the robot's model among the files of the log.
        objects: The same of each object by its name.
        strip: What is taken out of the models of robot and objects, by ``robot`` or the object's name.
        sites: What is put into the model of the robot.
        overrides: What of the bodies and geoms of a model is changed, of those of which something is.
        poses: Where objects are fixed, of those that are.
        time_step_s: Integration step, s.
        conservative: Whether the models had to be conservative.
        view_rate_hz: Frames per simulated second for viewers.
        kinds: Kind of each actuator that has limits, by the name that the scenario gives it.
    """

    robot: str
    objects: Mapping[str, str]
    strip: Mapping[str, tuple[str, ...]]
    sites: tuple[AddedSite, ...]
    overrides: Mapping[str, Overrides]
    poses: Mapping[str, Pose]
    time_step_s: float
    conservative: bool
    view_rate_hz: float
    kinds: Mapping[str, str]


def scenario_data(log: RunLog, place: str = THE_LOG) -> dict[str, Any]:
    """The scenario as plain data; ``place`` is the log's name for messages.

    Raises:
        InputError: The log carries none.
    """
    try:
        data = plain_value(log.header.scenario_yaml)
    except YamlFault as fault:
        where = f"{SCENARIO_ATTACHMENT}:{fault.place.line}:{fault.place.column}"
        raise InputError(f"{place}: {where}: {fault.problem}") from fault
    if not isinstance(data, dict):
        raise InputError(f"{place}: carries no scenario: its models cannot be built again")
    return data


def logged_scenario(log: RunLog, place: str = THE_LOG) -> LoggedScenario:
    """What of the scenario the models are built from; ``place`` is the log's name for messages.

    Raises:
        InputError: The log carries no scenario, or not one of this version.
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
            strip={_text(name): tuple(map(_strippable, part.get("strip") or ())) for name, part in parts.items()},
            sites=tuple(_site(_text(name), site) for name, site in (data["robot"].get("sites") or {}).items()),
            overrides={_text(name): _overrides(found) for name, found in model.items()},
            poses={name: _pose(part.get("pose")) for name, part in objects.items() if part.get("fixed") is True},
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
        raise ValueError(f"sites: {place!r} is no place")
    return AddedSite(name, _text(data["body"]), (float(place[0]), float(place[1]), float(place[2])))


def _overrides(bodies: Any) -> Overrides:
    try:
        return Overrides("model", {_text(body): BodyProperties.model_validate(said) for body, said in bodies.items()})
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
    """Compile what the log carries, by what a run compiles with; control laws of others need not be installed for that.

    Nothing is written, and nothing but the log is read: a model of the log that refers to another file is refused.

    Args:
        log: The log.
        place: Its name for messages.
        grasp: Let an object be held; None: the scene as it begins.

    Raises:
        InputError: The log carries no scenario, or a model that is not whole or does not compile any more.
    """
    scenario = logged_scenario(log, place)

    def carried(name: str, main: str) -> ModelFiles:
        prefix = logged_name(name, "")
        if not main.startswith(prefix):
            raise InputError(f"{place}: the model of {name} is {main!r}, not a file below {prefix}")
        files = {key.removeprefix(prefix): content for key, content in log.header.files.items() if key.startswith(prefix)}
        model = logged_model(main.removeprefix(prefix), files, f"{place}: {prefix}")
        changed = (scenario.overrides[name],) if scenario.overrides.get(name) else ()
        return replace(model, strip=scenario.strip[name], overrides=changed, pose=scenario.poses.get(name))

    try:
        return compile_system(
            replace(carried("robot", scenario.robot), sites=scenario.sites),
            {name: carried(name, main) for name, main in scenario.objects.items()},
            time_step_s=scenario.time_step_s,
            conservative=scenario.conservative,
            grasp=grasp,
        )
    except ScenarioFaults as unplaced:
        raise InputError([f"{place}: {fault.message}" for fault in unplaced.faults]) from unplaced
