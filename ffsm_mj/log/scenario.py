"""The resolved scenario of a log and the system compiled from it; both are validated, as a log may be of unknown origin."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import replace
from typing import Any

from pydantic import PositiveFloat, ValidationError

from ffsm_mj.config import StrictModel
from ffsm_mj.errors import THE_LOG, InputError, ScenarioFaults, one_line
from ffsm_mj.log.mcap.format import SCENARIO_ATTACHMENT
from ffsm_mj.model.composition import compile_system
from ffsm_mj.model.cones import ConeConfig
from ffsm_mj.model.decompose import DecomposeList, with_logged_pieces
from ffsm_mj.model.edits import AddedSite, JointFlex, LimitsMode, Strippable, motors_of, to_strip
from ffsm_mj.model.files import ModelFiles, logged_model, logged_name
from ffsm_mj.model.grasp import Grasp
from ffsm_mj.model.magnetorquers import Axis, magnetorquers_of
from ffsm_mj.model.properties import BodyProperties, Overrides, Pose, UnitQuaternion
from ffsm_mj.model.sensors import AddedKind, AddedSensor
from ffsm_mj.model.system import System
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.yaml import YamlFault, plain_value


class _Part(StrictModel, extra="ignore"):
    """Part of a scenario, of which the keys are read that the models follow from."""


class _Site(_Part):
    body: str
    pos_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    quaternion: UnitQuaternion = (1.0, 0.0, 0.0, 0.0)


class _Model(_Part):
    """The robot or an object; ``mjcf`` is the name of its file in the log."""

    mjcf: str
    body: str | None = None
    strip: tuple[Strippable, ...] | None = None
    limits: LimitsMode | None = None
    fixed: bool | None = None
    pose: Pose | None = None
    sites: dict[str, _Site] | None = None
    joint_flex: dict[str, JointFlex] | None = None
    decompose: DecomposeList = ()
    cones: tuple[ConeConfig, ...] | None = None


class _Sensor(_Part):
    """A sensor; without ``kind`` it is one of a model file."""

    kind: AddedKind | None = None
    of: str | None = None
    relative_to: str | None = None


class _Actuator(_Part):
    """Limits of an actuator; the others are those of a magnetorquer."""

    kind: str
    site: str = ""
    axis: Axis = "z"
    max_dipole_A_m2: PositiveFloat = 1.0


class _Log(_Part):
    view_rate_hz: PositiveFloat


class LoggedScenario(_Part):
    """The parts of a scenario from which the models are compiled, and what viewers need."""

    robot: _Model
    objects: dict[str, _Model] | None = None
    sensors: dict[str, _Sensor] | None = None
    model: dict[str, dict[str, BodyProperties]] | None = None
    actuators: dict[str, _Actuator] | None = None
    time_step_s: PositiveFloat
    conservative: bool
    log: _Log
    view: tuple[float, float, float] | None = None

    @property
    def kinds(self) -> dict[str, str]:
        """Kind of each actuator with limits, by its name in the scenario."""
        return {name: actuator.kind for name, actuator in (self.actuators or {}).items()}


def laws_differ(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Whether two scenarios, as plain data, differ in what control laws follow: phases or task."""
    return any(one.get(key) != other.get(key) for key in ("phases", "task"))


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
    about = f"{place}: {SCENARIO_ATTACHMENT}: not a scenario of this version"
    try:
        validated = LoggedScenario.model_validate(scenario_data(log, place))
    except ValidationError as error:
        fault = error.errors()[0]
        key = one_line(".".join(map(str, fault["loc"])))
        what = f", {key!r} is missing" if fault["type"] == "missing" else f" ({key}: {fault['msg']})"
        raise InputError(about + what) from error
    if unknown := set(validated.model or ()) - {"robot", *(validated.objects or ())}:
        raise InputError(f"{about} (model: {one_line(', '.join(sorted(unknown)))} are no models)")
    if bad := [name for name, sensor in (validated.sensors or {}).items() if sensor.kind is not None and sensor.of is None]:
        raise InputError(f"{about}, {one_line(f'sensors.{bad[0]}.of')!r} is missing")
    return validated


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
    objects = scenario.objects or {}

    def model_of(name: str, part: _Model) -> ModelFiles:
        # Models of one file are stored with the first of them.
        owners = ("robot", *objects) if part.body is not None else (name,)
        prefix = next((added for owner in owners if part.mjcf.startswith(added := logged_name(owner, ""))), "")
        if not prefix:
            raise InputError(f"{place}: the model of {name} is {part.mjcf!r}, which is not below {logged_name(name, '')}")
        files = {key.removeprefix(prefix): content for key, content in log.header.files.items() if key.startswith(prefix)}
        bodies = (scenario.model or {}).get(name)
        changed = replace(
            logged_model(part.mjcf.removeprefix(prefix), files, f"{place}: {prefix}"),
            strip=to_strip(part.strip, part.limits),
            motors=motors_of(name, scenario.kinds),
            overrides=(Overrides("model", bodies),) if bodies is not None else (),
            pose=(part.pose or Pose()) if part.fixed and name != "robot" else None,
            body=part.body or "",
            sites=tuple(AddedSite(site, **dict(added)) for site, added in (part.sites or {}).items()),
            flex=part.joint_flex or {},
            cones=part.cones or (),
        )
        return with_logged_pieces(changed, part.decompose, files)

    sensors = tuple(
        AddedSensor(name, sensor.kind, sensor.of or "", sensor.relative_to or "")
        for name, sensor in (scenario.sensors or {}).items()
        if sensor.kind is not None
    )
    try:
        return compile_system(
            model_of("robot", scenario.robot),
            {name: model_of(name, part) for name, part in objects.items()},
            time_step_s=scenario.time_step_s,
            conservative=scenario.conservative,
            grasp=grasp,
            sensors=sensors,
            magnetorquers=magnetorquers_of(scenario.actuators or {}),
        )
    except ScenarioFaults as error:
        raise InputError([f"{place}: {fault.message}" for fault in error.faults]) from error
