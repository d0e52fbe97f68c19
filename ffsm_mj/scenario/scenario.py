"""The scenario: everything a run needs, typed, validated and frozen. Units are in the key names, frames in the comments."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, Union

from ffsm_controllers import kinds
from ffsm_controllers.settled import SettledConfig
from pydantic import (
    ConfigDict,
    Field,
    PositiveFloat,
    PositiveInt,
    SerializeAsAny,
    ValidationInfo,
    field_validator,
    model_validator,
)

from ffsm_mj.actuation.actuator_config import ActuatorConfig
from ffsm_mj.config import StrictModel
from ffsm_mj.contact_models.grasp.config import CaptureConfig
from ffsm_mj.errors import Fault, InputError, ScenarioFaults
from ffsm_mj.model.pose import Pose
from ffsm_mj.model.properties import Trees
from ffsm_mj.model.strip import Strippable
from ffsm_mj.scenario.contact_models import REGIME_SCHEMA, validated_contact_models
from ffsm_mj.scenario.element_names import element_name
from ffsm_mj.scenario.impact_law import LawName
from ffsm_mj.scenario.source import YamlSource

_KINDS = kinds()
if TYPE_CHECKING:
    ControllerConfig: TypeAlias = Any
else:
    ControllerConfig = Annotated[
        Union[tuple(cls.Config for cls in _KINDS.classes.values())],  # noqa: UP007 (a union of unknown length)
        Field(discriminator="kind"),
    ]

# A multiple is one to 1e-9 of the ratio: beyond this that is half a period, and every ratio would pass.
_MOST_PERIODS = 5e8

Name = Annotated[str, Field(min_length=1)]
Axis = Literal["x", "y", "z"]
JointValue = float | tuple[float, ...]


class SiteConfig(StrictModel):
    """A site that the robot's file does not have: a tip at the end of a vendor's arm."""

    body: Name
    """Body of the robot that it is fixed to, by its name in the file."""
    pos_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Its place in the body's frame, m."""


class RobotConfig(StrictModel):
    """The free-floating manipulator."""

    mjcf: Name
    """MJCF or URDF file, relative to the scenario file that names it; its root body is the base."""
    asset_folders: tuple[Name, ...] = ()
    """Folders, beside the model's own, that it may use files of (meshes, includes); relative to the scenario file."""
    package_paths: tuple[Name, ...] = ()
    """Folders of the packages that a URDF names (``package://NAME/...``), after those above it; relative to the scenario."""
    strip: tuple[Strippable, ...] = ()
    """What is taken out of the model before it is compiled, the file untouched: what free motion would not conserve."""
    sites: dict[Name, SiteConfig] = {}
    """Sites that are put into the model before it is compiled, the file untouched, by name."""


class ObjectConfig(StrictModel):
    """An object: floating, or fixed to the world."""

    mjcf: Name
    """MJCF or URDF file, relative to the scenario file that names it."""
    asset_folders: tuple[Name, ...] = ()
    """Folders, beside the model's own, that it may use files of (meshes, includes); relative to the scenario file."""
    package_paths: tuple[Name, ...] = ()
    """Folders of the packages that a URDF names (``package://NAME/...``), after those above it; relative to the scenario."""
    strip: tuple[Strippable, ...] = ()
    """What is taken out of the model before it is compiled, the file untouched: what free motion would not conserve."""
    fixed: bool = False
    """It never moves: a wall, a docking port, a test rig. Its model has no joint; what it takes comes from outside."""
    pose: Pose | None = None
    """Where it is fixed: the pose of the model's world frame; left out: that of the scene's. Only with ``fixed: true``."""

    @field_validator("pose")
    @classmethod
    def _only_where_fixed(cls, value: Pose | None, info: ValidationInfo) -> Pose | None:
        if value is not None and info.data.get("fixed") is False:
            raise ValueError("only with 'fixed: true'; a floating object starts where initial.joints says")
        return value

    @property
    def fixed_at(self) -> Pose | None:
        """Where it is fixed; None where it floats."""
        return (self.pose or Pose()) if self.fixed else None


class InitialConfig(StrictModel):
    """State at t = 0. Joints that are not named start at the model's zero, at rest."""

    joints: dict[Name, JointValue] = {}
    """Coordinates by joint: rad or m; a free joint takes x, y, z in m and a quaternion w, x, y, z."""
    rates: dict[Name, JointValue] = {}
    """Rates by joint: rad/s or m/s; a free joint takes velocity in world axes and angular velocity in body axes."""


class TaskConfig(StrictModel):
    """What the arm is to do: bring a site to a point."""

    tip: Name
    """Site of the robot that is regulated."""
    axes: Annotated[tuple[Axis, ...], Field(min_length=2, max_length=3)] = ("x", "y", "z")
    """World axes that count: two for a planar task, three in space."""
    target_m: tuple[float, ...]
    """Target of the tip along these axes in world coordinates, m."""

    @model_validator(mode="after")
    def _one_target_per_axis(self) -> TaskConfig:
        if len(set(self.axes)) != len(self.axes):
            raise ValueError("axes must be different")
        if len(self.target_m) != len(self.axes):
            raise ValueError(f"target_m has {len(self.target_m)} numbers for {len(self.axes)} axes")
        return self


class ImpactPairConfig(StrictModel):
    """Two geoms on bodies that move against each other, their contact resolved: ``geoms``, or robot_geom and object_geom."""

    model_config = ConfigDict(
        json_schema_extra={"oneOf": [{"required": ["geoms"]}, {"required": ["robot_geom", "object_geom"]}]}
    )

    geoms: Annotated[tuple[Name, ...], Field(min_length=2, max_length=2)] | None = None
    """Geoms a and b, of the robot, of objects or of one of them twice, one fixed at most; the normal points from a to b."""
    robot_geom: Name | None = None
    """Geom a where it is one of the robot and b one of an object; in place of ``geoms``."""
    object_geom: Name | None = None
    """Geom b, one of an object; with ``robot_geom``."""
    name: Name = Field(default_factory=lambda fields: element_name(fields) or "")
    """What records, columns and overrides call it, unique; left out: ``<a>-<b>``, the geoms as written here."""
    restitution: Annotated[float, Field(ge=0.0)] = 1.0
    """Coefficient of restitution e: 1 elastic, 0 plastic."""
    mu: Annotated[float, Field(ge=0.0)] = 0.0
    """Coefficient of Coulomb friction at impacts; that in the MJCF is of MuJoCo's own contacts, and is not taken."""
    super_elastic: bool = False
    """Allow e > 1, an impact that gains energy (the paper's case c)."""

    @property
    def sides(self) -> tuple[str, str]:
        """Geoms a and b as the scenario names them."""
        return (self.geoms[0], self.geoms[1]) if self.geoms else (self.robot_geom or "", self.object_geom or "")

    @model_validator(mode="after")
    def _one_way_to_name_two_geoms(self) -> ImpactPairConfig:
        given = [key for key in ("geoms", "robot_geom", "object_geom") if getattr(self, key) is not None]
        if given not in (["geoms"], ["robot_geom", "object_geom"]):
            raise ValueError("a pair needs 'geoms: [a, b]', or 'robot_geom' and 'object_geom'")
        if self.name.isdecimal():
            raise ValueError(f"a pair named {self.name!r} could not be told from a position in the list; add a letter")
        return self

    @model_validator(mode="after")
    def _super_elastic_by_name(self) -> ImpactPairConfig:
        if self.restitution > 1.0 and not self.super_elastic:
            raise ValueError("restitution must be in [0, 1]; above 1 only with 'super_elastic: true'")
        if self.restitution > 1.0 and self.mu > 0.0:
            raise ValueError("an impact that gains energy (restitution above 1) has no law with friction; let mu be 0")
        return self


class IgnoredPairConfig(StrictModel):
    """Contacts that are known and left alone."""

    pair: Annotated[tuple[Name, ...], Field(min_length=2, max_length=2)]
    """Two names, each a geom, a body (all its geoms), or a model: ``robot`` or the name of an object."""
    reason: Name
    """Why these contacts do not matter."""


class PhaseConfig(StrictModel):
    """A phase of the task: it ends at an event, once the tip has settled, after a time (what is first), or with the run."""

    name: Name
    until: Name | None = None
    """``impact``, ``contact_begins``, ``contact_ends``, ``capture``, ``release`` or a record of a contact model: the first
    one after its start;
    ``settled``: see there; ``end``: of the run."""
    settled: SettledConfig | None = None
    """With ``until: settled``: the phase ends once the tip has been near its target and slow for a time."""
    for_s: PositiveFloat | None = None
    """Duration in s; it ends at the first control tick at or after that, with ``until: impact`` at an impact before it."""
    arm: tuple[Name, ...] = ()
    """Captures that may close while it lasts; their bounds may hold already as it begins."""
    release: tuple[Name, ...] = ()
    """Captures that let go as it begins."""
    controller: SerializeAsAny[ControllerConfig]
    """Control law, chosen by ``kind``."""

    @model_validator(mode="after")
    def _has_an_end(self) -> PhaseConfig:
        if self.until is None and self.for_s is None:
            raise ValueError("a phase needs 'until' (impact, settled, end, ...) or 'for_s', or an event and 'for_s'")
        if self.until == "settled" and self.settled is None:
            raise ValueError("'until: settled' needs 'settled: {error_m: ..., speed_m_s: ..., for_s: ...}'")
        if self.until != "settled" and self.settled is not None:
            raise ValueError("'settled' has no effect without 'until: settled'; leave it out")
        if self.until == "end" and self.for_s is not None:
            raise ValueError("'for_s' has no effect with 'until: end'; leave one of them out")
        return self


class ImpactConfig(StrictModel):
    """Law and limits of impact resolution."""

    law: LawName = "blend"
    """An installed impact law; the built-in ones differ where several contacts meet at once. No ``newton`` with mu."""
    rest_interval_s: Annotated[float, Field(ge=0.0)] | None = None
    """A contact with e < 1 lasts once its next flight, as it is pressed, would be shorter, s; left out: time_step_s."""
    rest_speed_m_s: Annotated[float, Field(ge=0.0)] = 0.0
    """A pressed contact with e < 1 that would separate slower than this lasts too, m/s."""
    max_impacts: PositiveInt = 10_000
    """The run ends after this many impacts."""

    @model_validator(mode="before")
    @classmethod
    def _no_cap_per_second(cls, data: Any) -> Any:
        if isinstance(data, dict) and "max_impacts_per_second" in data:
            raise ValueError("max_impacts_per_second is gone: rest_interval_s says when a contact lasts; leave it out")
        return data


class LogConfig(StrictModel):
    """What is written."""

    rerun: bool = True
    """Write ``run.rrd`` for the Rerun viewer."""
    view_rate_hz: PositiveFloat = 50.0
    """Frames per simulated second in ``run.rrd`` and in the viewer topics of ``run.mcap``."""
    max_size_GB: PositiveFloat = 100.0
    """A run whose samples are more than this before compression is refused, GB; the log is a half to a fifth of it."""


class Scenario(StrictModel):
    """One run of one robot and its objects."""

    extends: Name | None = None
    """Scenario that this one changes: a YAML file relative to this one, or the name of a shipped scenario."""
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")]
    """Name of the run folder and of the log: letters, digits, '.', '_' and '-'."""
    description: str = ""
    """One line for ``ffsm run --list``."""
    duration_s: PositiveFloat
    """Simulated time, a multiple of the control period, s."""
    time_step_s: PositiveFloat = 0.001
    """Integration step of RK4, s."""
    accuracy: Annotated[float, Field(ge=1e-9, le=1e-3)] | None = None
    """Steps are cut into sub-steps so that energy and momenta err by less, over (1 + scale); left out: none is cut."""
    control_period_s: PositiveFloat = 0.001
    """Time between two decisions of the controller, a multiple of the time step, s."""
    conservative: bool = True
    """Refuse gravity, damping, friction, springs, fluids and other integrators in the models. Where it is false,
    gravity enters the balance; with anything else of these energy and momenta are not judged."""
    stop_on_impact: bool = False
    """End the run right after the first impact."""
    robot: RobotConfig
    objects: dict[Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")], ObjectConfig] = {}
    """Floating and fixed objects by name; the name is the prefix of everything in the object's model."""
    model: Trees = {}
    """Properties of bodies and their geoms, the files untouched: by ``robot`` or the object's name, then by body."""
    controller_model: Trees = {}
    """The same, on top of ``model``, in what the control laws take the models for; left out: they know the true ones."""
    initial: InitialConfig = InitialConfig()
    actuators: dict[Name, ActuatorConfig] = {}
    """Limits of the robot's actuators by name; an actuator that is not named is ideal."""
    task: TaskConfig | None = None
    impact_pairs: tuple[ImpactPairConfig, ...] = ()
    ignored_pairs: tuple[IgnoredPairConfig, ...] = ()
    captures: dict[Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$")], CaptureConfig] = {}
    """Grasps by name: a site of the robot takes hold of a site of a floating object while a phase arms it."""
    script_laws: tuple[Name, ...] | None = None
    """Kinds of control laws that a script handed to the run that wrote this scenario; they name no code."""
    phases: Annotated[tuple[PhaseConfig, ...], Field(min_length=1)]
    impact: ImpactConfig = ImpactConfig()
    contact_models: tuple[Annotated[Any, REGIME_SCHEMA], ...] = ()
    """What can happen at contacts beside the impact, each by its ``kind``; see docs/contact-models.md."""
    log: LogConfig = LogConfig()

    @property
    def steps_per_tick(self) -> int:
        """Integration steps in a control period."""
        return round(self.control_period_s / self.time_step_s)

    @property
    def ticks(self) -> int:
        """Control periods in the run."""
        return round(self.duration_s / self.control_period_s)


def timing_faults(scenario: Scenario) -> list[Fault]:
    """What is wrong with duration, control period and time step together."""
    faults = []
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
    """The scenario with its contact models checked.

    Raises:
        ScenarioFaults: One of them is none.
    """
    return (
        scenario.model_copy(update={"contact_models": validated_contact_models(scenario.contact_models)})
        if scenario.contact_models
        else scenario
    )


def located(error: ScenarioFaults, source: YamlSource) -> InputError:
    """The same faults with the places where they stand."""
    return InputError(source.lines(error.faults))
