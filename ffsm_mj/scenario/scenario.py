"""Data model of a scenario, validated and immutable. Units are in the key names, frames in the descriptions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, Union

from ffsm_controllers import kinds
from ffsm_controllers.estimators import estimators
from ffsm_controllers.settled import SettledConfig
from pydantic import (
    ConfigDict,
    Field,
    NonNegativeFloat,
    PositiveFloat,
    SerializeAsAny,
    ValidationInfo,
    field_validator,
    model_validator,
)

from ffsm_mj.actuation.actuator_config import ActuatorConfig
from ffsm_mj.config import Name, PartName, StrictModel
from ffsm_mj.contact_models.grasp.config import CaptureConfig
from ffsm_mj.errors import Fault, InputError, ScenarioFaults
from ffsm_mj.model.properties import Pose, Trees
from ffsm_mj.model.strip import LimitsMode, Strippable
from ffsm_mj.scenario.contact_models import REGIME_SCHEMA, validated_contact_models
from ffsm_mj.scenario.contacts import ContactsConfig
from ffsm_mj.scenario.impact_config import ImpactConfig
from ffsm_mj.scenario.joint_limits import JointLimitConfig
from ffsm_mj.scenario.source import YamlSource
from ffsm_mj.sensing.sensor_config import SensorConfig

_KINDS = kinds()
if TYPE_CHECKING:
    ControllerConfig: TypeAlias = Any
    OptionalController: TypeAlias = Any
else:
    ControllerConfig = Annotated[
        Union[tuple(cls.Config for cls in _KINDS.classes.values())],  # noqa: UP007 (a union of unknown length)
        Field(discriminator="kind"),
    ]
    OptionalController = ControllerConfig | None

# Ratios are compared with integers to a relative 1e-9; beyond this ratio that is half a period, and any would pass.
_MOST_PERIODS = 5e8

Axis = Literal["x", "y", "z"]
JointValue = float | tuple[float, ...]


class TruthConfig(StrictModel):
    """Control laws see the true state."""

    kind: Literal["truth"]


class ToldAboveConfig(StrictModel):
    """Impacts of which control laws are told."""

    above_N_s: Annotated[float, Field(ge=0.0)]
    """Least impulse, N s; of contacts that begin or end, stick or slip, nothing is told."""


if TYPE_CHECKING:
    EstimatorConfig: TypeAlias = Any
else:
    EstimatorConfig = Annotated[
        Union[TruthConfig, *(cls.Config for cls in estimators().classes.values())],
        Field(discriminator="kind"),
    ]


class SiteConfig(StrictModel):
    """A site added to the robot's model, e.g. a tip at the end of a vendor's arm."""

    body: Name
    """Body of the robot to which the site is fixed, by its name in the file."""
    pos_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Position in the body's frame, m."""


class RobotConfig(StrictModel):
    """The free-floating manipulator."""

    mjcf: Name
    """MJCF or URDF file, relative to the scenario file that names it; its root body is the base."""
    asset_folders: tuple[Name, ...] = ()
    """Further folders with files of the model (meshes, includes), relative to the scenario file."""
    package_paths: tuple[Name, ...] = ()
    """Folders to search for packages of a URDF (``package://NAME/...``), after its parents; relative to the scenario."""
    strip: tuple[Strippable, ...] = ()
    """Elements to remove from the model, which would break conservation; the file itself is not changed."""
    sites: dict[Name, SiteConfig] = {}
    """Sites to add to the model by name; the file itself is not changed."""
    limits: LimitsMode = "stop"
    """Joints with limits in the model stop there (``stop``, see joint_limits), or move on (``ignore``)."""


class ObjectConfig(StrictModel):
    """An object: floating, or fixed to the world."""

    mjcf: Name
    """MJCF or URDF file, relative to the scenario file that names it."""
    asset_folders: tuple[Name, ...] = ()
    """Further folders with files of the model (meshes, includes), relative to the scenario file."""
    package_paths: tuple[Name, ...] = ()
    """Folders to search for packages of a URDF (``package://NAME/...``), after its parents; relative to the scenario."""
    strip: tuple[Strippable, ...] = ()
    """Elements to remove from the model, which would break conservation; the file itself is not changed."""
    limits: LimitsMode = "stop"
    """Joints with limits in the model stop there (``stop``, see joint_limits), or move on (``ignore``)."""
    fixed: bool = False
    """Fixed to the world: a wall, a docking port, a test rig. Its model has no joint; its impulses are external."""
    pose: Pose | None = None
    """Pose of the model's world frame in the scene; default: identity. Only with ``fixed: true``."""

    @field_validator("pose")
    @classmethod
    def _only_where_fixed(cls, value: Pose | None, info: ValidationInfo) -> Pose | None:
        if value is not None and info.data.get("fixed") is False:
            raise ValueError("only with 'fixed: true'; a floating object starts where initial.joints says")
        return value

    @property
    def fixed_at(self) -> Pose | None:
        """Pose of a fixed object; None if it floats."""
        return (self.pose or Pose()) if self.fixed else None


class InitialConfig(StrictModel):
    """State at t = 0. Joints that are not listed start at the model's zero position, at rest."""

    joints: dict[Name, JointValue] = {}
    """Coordinates by joint, rad or m; for a free joint x, y, z in m and a quaternion w, x, y, z."""
    rates: dict[Name, JointValue] = {}
    """Rates by joint, rad/s or m/s; for a free joint velocity in world axes and angular velocity in body axes."""


class TaskConfig(StrictModel):
    """Task of the arm: bring a site of the robot to a point."""

    tip: Name
    """Site of the robot to regulate."""
    axes: Annotated[tuple[Axis, ...], Field(min_length=2, max_length=3)] = ("x", "y", "z")
    """Regulated world axes: two for a planar task, three in space."""
    target_m: tuple[float, ...]
    """Target of the tip along these axes in world coordinates, m."""

    @model_validator(mode="after")
    def _one_target_per_axis(self) -> TaskConfig:
        if len(set(self.axes)) != len(self.axes):
            raise ValueError("axes must be different")
        if len(self.target_m) != len(self.axes):
            raise ValueError(f"target_m has {len(self.target_m)} numbers for {len(self.axes)} axes")
        return self


class SensorEndConfig(StrictModel):
    """A phase ends at a control tick at which a valid measurement is beyond a bound."""

    sensor: Name
    """A sensor; of a vector its norm counts."""
    above: float | None = None
    """The phase ends above this value, in the unit of the sensor."""
    below: float | None = None
    """The phase ends below this value."""

    @model_validator(mode="after")
    def _has_one_bound(self) -> SensorEndConfig:
        if (self.above is None) == (self.below is None):
            raise ValueError("needs 'above' or 'below', one of the two")
        return self


class PhaseConfig(StrictModel):
    """A phase of the task; it ends at an event, when the tip has settled, after a time, or with the run."""

    model_config = ConfigDict(json_schema_extra={"oneOf": [{"required": ["controller"]}, {"required": ["controllers"]}]})

    name: Name
    until: Name | SensorEndConfig | None = None
    """``impact``, ``contact_begins``, ``contact_ends``, ``contact_slips``, ``contact_sticks`` (of a contact with friction),
    ``limit_impact``, ``limit_begins``, ``limit_ends`` (of a joint at a limit), ``capture``, ``release`` or a record of a
    contact model: the first such event after the start of the phase; ``settled``: see that key; ``end``: the end of the
    run; ``{sensor: NAME, above: VALUE}`` (or ``below``): a measurement."""
    settled: SettledConfig | None = None
    """With ``until: settled``: the phase ends when the tip has been near its target and slow for a time."""
    for_s: PositiveFloat | None = None
    """Duration in s; the phase ends at the first control tick at or after it, or before at the event of ``until``."""
    arm: tuple[Name, ...] = ()
    """Grasps that are armed during the phase; their bounds may already be met at its start."""
    release: tuple[Name, ...] = ()
    """Grasps that are released at the start of the phase."""
    controller: SerializeAsAny[OptionalController] = None
    """Control law, chosen by ``kind``."""
    controllers: Annotated[dict[PartName, SerializeAsAny[ControllerConfig]], Field(min_length=1)] | None = None
    """In place of ``controller``: several control laws at once by part of the robot, each with actuators of its own."""

    @model_validator(mode="after")
    def _is_consistent(self) -> PhaseConfig:
        if self.controller is None and self.controllers is None:
            raise ValueError("a phase needs 'controller: {kind: ...}', or 'controllers: {PART: {kind: ...}, ...}'")
        if self.controller is not None and self.controllers is not None:
            raise ValueError("has both 'controller' and 'controllers'; leave one of them out")
        if self.until is None and self.for_s is None:
            raise ValueError("a phase needs 'until' (impact, settled, end, ...) or 'for_s', or an event and 'for_s'")
        if self.until == "settled" and self.settled is None:
            raise ValueError("'until: settled' needs 'settled: {error_m: ..., speed_m_s: ..., for_s: ...}'")
        if self.until != "settled" and self.settled is not None:
            raise ValueError("'settled' has no effect without 'until: settled'; leave it out")
        if self.until == "end" and self.for_s is not None:
            raise ValueError("'for_s' has no effect with 'until: end'; leave one of them out")
        return self

    @property
    def laws(self) -> dict[tuple[str, ...], Any]:
        """Configurations of the control laws by their keys in the phase: ``controller``, or ``controllers`` and a part."""
        if self.controllers is None:
            return {("controller",): self.controller}
        return {("controllers", part): law for part, law in self.controllers.items()}

    @property
    def kind(self) -> str:
        """Kind of the control law; with several parts ``name: kind`` of each."""
        if self.controllers is None:
            return str(self.controller.kind)
        return ", ".join(f"{part}: {law.kind}" for part, law in self.controllers.items())


class ActuationConfig(StrictModel):
    """Timing of control."""

    delay_s: NonNegativeFloat = 0.0
    """Time from a command to its effect, s, of actuators without a delay of their own."""
    control_jitter_s: NonNegativeFloat = 0.0
    """Each control tick is late by a time that is uniform from 0 to this, s; less than the control period."""


class LogConfig(StrictModel):
    """Output files."""

    rerun: bool = True
    """Write ``run.rrd`` for the Rerun viewer."""
    view_rate_hz: PositiveFloat = 50.0
    """Frames per simulated second in ``run.rrd`` and in the viewer topics of ``run.mcap``."""
    max_size_GB: PositiveFloat = 100.0
    """A run with more uncompressed samples than this is refused, GB; the log is a half to a fifth of their size."""


class Scenario(StrictModel):
    """A run of one robot and its objects."""

    extends: Name | None = None
    """Scenario to extend: a YAML file relative to this one, or the name of a shipped scenario."""
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")]
    """Name of the run folder and of the log: letters, digits, '.', '_' and '-'."""
    description: str = ""
    """One-line description for ``ffsm run --list``."""
    duration_s: PositiveFloat
    """Simulated time, a multiple of the control period, s."""
    time_step_s: PositiveFloat = 0.001
    """Integration step of RK4, s."""
    accuracy: Annotated[float, Field(ge=1e-9, le=1e-3)] | None = None
    """Divide steps into sub-steps so that errors of energy and momenta over (1 + scale) stay below this; default: off."""
    control_period_s: PositiveFloat = 0.001
    """Control period, a multiple of the time step, s."""
    conservative: bool = True
    """Refuse gravity, damping, friction, springs, fluids and other integrators in the models. If false,
    gravity enters the balance; with any of the others energy and momenta are not checked."""
    stop_on_impact: bool = False
    """End the run right after the first impact."""
    robot: RobotConfig
    objects: dict[Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")], ObjectConfig] = {}
    """Floating and fixed objects by name; the name is the prefix of all elements of the object's model."""
    model: Trees = {}
    """Properties of bodies and their geoms, by ``robot`` or the object's name, then by body; files are not changed."""
    controller_model: Trees = {}
    """Further changes, on top of ``model``, in the models that the control laws use; default: the true models."""
    initial: InitialConfig = InitialConfig()
    actuation: ActuationConfig = ActuationConfig()
    """Delays of commands and of control ticks."""
    actuators: dict[Name, ActuatorConfig] = {}
    """Limits of the robot's actuators by name; an actuator that is not named is ideal."""
    sensors: dict[Name, SensorConfig] = {}
    """Errors and timing of the sensors of the models by name; every ``<sensor>`` of a model is measured."""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """Seed of all random numbers of the run."""
    estimator: SerializeAsAny[EstimatorConfig] = TruthConfig(kind="truth")
    """Where control laws take the state from, chosen by ``kind``; ``truth``: the true state."""
    told_of_impacts: bool | ToldAboveConfig = True
    """Whether control laws are called at impacts and other contact events, and told of them; or of impacts above a bound."""
    task: TaskConfig | None = None
    joint_limits: dict[Name, JointLimitConfig] = {}
    """Restitution of joints that stop at limits, by joint; default: 0."""
    contacts: ContactsConfig = ContactsConfig()
    captures: dict[Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$")], CaptureConfig] = {}
    """Grasps by name: when armed, a site of the robot can latch a site of a floating object."""
    script_laws: tuple[Name, ...] | None = None
    """Kinds of control laws and estimators that a script passed to the run that wrote this scenario; they name no code."""
    phases: Annotated[tuple[PhaseConfig, ...], Field(min_length=1)]
    impact: ImpactConfig = ImpactConfig()
    contact_models: tuple[Annotated[Any, REGIME_SCHEMA], ...] = ()
    """Contact models in addition to impacts, each with its ``kind``; see docs/contact-models.md."""
    log: LogConfig = LogConfig()

    @property
    def has_controller_model(self) -> bool:
        """Whether control laws compute with models of their own: other ones, or with an estimated state."""
        return any(self.controller_model.values()) or self.estimator.kind != "truth"

    @property
    def steps_per_tick(self) -> int:
        """Number of integration steps in a control period."""
        return round(self.control_period_s / self.time_step_s)

    @property
    def ticks(self) -> int:
        """Number of control periods in the run."""
        return round(self.duration_s / self.control_period_s)


def timing_faults(scenario: Scenario) -> list[Fault]:
    """Faults of the combination of duration, control period and time step."""
    faults = []
    if scenario.actuation.control_jitter_s >= scenario.control_period_s:
        fault = f"must be less than control_period_s ({scenario.control_period_s:g} s): the next tick would be earlier"
        faults.append(Fault(fault, ("actuation", "control_jitter_s")))
    for key, whole, unit, unit_key in (
        ("control_period_s", scenario.control_period_s, scenario.time_step_s, "time_step_s"),
        ("duration_s", scenario.duration_s, scenario.control_period_s, "control_period_s"),
    ):
        ratio = whole / unit
        if ratio > _MOST_PERIODS:
            faults.append(Fault(f"is {ratio:.3g} times {unit_key} ({unit:g} s); at most {_MOST_PERIODS:g} times", (key,)))
        elif round(ratio) < 1 or abs(ratio - round(ratio)) > 1e-9 * ratio:
            nearest = max(1, round(ratio)) * unit
            faults.append(Fault(f"must be a multiple of {unit_key} ({unit:g} s); the nearest is {nearest:g}", (key,)))
    return faults


def with_contact_models(scenario: Scenario) -> Scenario:
    """The scenario with validated contact models.

    Raises:
        ScenarioFaults: One of them is invalid.
    """
    return (
        scenario.model_copy(update={"contact_models": validated_contact_models(scenario.contact_models)})
        if scenario.contact_models
        else scenario
    )


def located(error: ScenarioFaults, source: YamlSource) -> InputError:
    """The faults as an error with their locations in the file."""
    return InputError(source.lines(error.faults))
