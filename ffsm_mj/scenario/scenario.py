"""Data model of a scenario, validated and immutable. Units are in the key names, frames in the descriptions."""

from __future__ import annotations

import math
from collections import ChainMap
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeAlias

from pydantic import (
    AfterValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    NonNegativeFloat,
    PositiveFloat,
    PositiveInt,
    SerializeAsAny,
    model_validator,
)
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from ffsm_controllers.estimators import estimators
from ffsm_mj.actuation.config import ActuatorConfig
from ffsm_mj.config import FileName, Name, StrictModel, chosen_by_kind
from ffsm_mj.contact_models.grasp.config import GraspConfig
from ffsm_mj.contact_models.impact.law import impact_laws, plugin_fault
from ffsm_mj.errors import Fault
from ffsm_mj.model.properties import Trees
from ffsm_mj.scenario.contacts import ContactsConfig
from ffsm_mj.scenario.env_config import EnvConfig
from ffsm_mj.scenario.environment import OF_PLUGIN, EnvironmentConfig
from ffsm_mj.scenario.models import REQUIRED, Model, Robot, SceneConfig
from ffsm_mj.scenario.phases import PhaseConfig
from ffsm_mj.sensing.config import SensorConfig

Axis = Literal["x", "y", "z"]


class TargetWaypoint(StrictModel):
    """Where the target is at a time."""

    at_s: PositiveFloat
    """Simulation time, s."""
    position_m: tuple[float, ...]
    """Position along the axes of the task in world coordinates, m."""


class TrajectoryConfig(StrictModel):
    """Motion of the target: through waypoints, through those of a file, or with a site of an object."""

    start_s: NonNegativeFloat = 0.0
    """Simulation time at which the target leaves ``target_m``, s; with ``waypoints`` or ``file``."""
    waypoints: Annotated[tuple[TargetWaypoint, ...], Field(min_length=1)] | None = None
    """Waypoints in the order of their times; between them the target is on the path of least jerk, from rest at ``target_m``
    to rest at the last one."""
    file: FileName | None = None
    """Table with the waypoints, at most 2000 rows: columns ``time_s`` and ``x_m``, ``y_m``, ``z_m`` by axis of the task."""
    site: Name | None = None
    """Site of an object: the target is fixed to it."""
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """With ``site``: position of the target in the frame of the site, m."""

    @model_validator(mode="after")
    def _is_one_motion(self) -> TrajectoryConfig:
        if sum(choice is not None for choice in (self.waypoints, self.file, self.site)) != 1:
            raise ValueError("needs 'waypoints', 'file' or 'site', one of the three")
        if self.site is None and self.offset_m != (0.0, 0.0, 0.0):
            raise ValueError("'offset_m' has no effect without 'site'; leave it out")
        if self.site is not None and self.start_s > 0.0:
            raise ValueError("'start_s' has no effect with 'site'; leave it out")
        times = [self.start_s, *(waypoint.at_s for waypoint in self.waypoints or ())]
        for one, other in pairwise(times):
            if other <= one:
                raise ValueError(f"the times of waypoints must ascend from start_s; {other:g} s follows {one:g} s")
        return self


class TaskConfig(StrictModel):
    """Task of the arm: bring a site of the robot to a point, which may move."""

    tip: Name
    """Site of the robot to regulate."""
    axes: Annotated[tuple[Axis, ...], Field(min_length=2, max_length=3)] = ("x", "y", "z")
    """Regulated world axes: two for a planar task, three in space."""
    target_m: tuple[float, ...]
    """Target of the tip along these axes in world coordinates, m; with a trajectory through waypoints where it begins."""
    trajectory: TrajectoryConfig | None = None
    """Motion of the target; left out: it is at rest."""

    @model_validator(mode="after")
    def _one_number_per_axis(self) -> TaskConfig:
        if len(set(self.axes)) != len(self.axes):
            raise ValueError("axes must be different")
        if len(self.target_m) != len(self.axes):
            raise ValueError(f"target_m has {len(self.target_m)} numbers for {len(self.axes)} axes")
        for i, waypoint in enumerate((self.trajectory and self.trajectory.waypoints) or ()):
            if len(waypoint.position_m) != len(self.axes):
                raise ValueError(f"waypoint {i} has {len(waypoint.position_m)} numbers for {len(self.axes)} axes")
        return self


class TruthConfig(StrictModel):
    """Control laws see the true state."""

    kind: Literal["truth"]


class ImpactFeedbackConfig(StrictModel):
    """Which impacts call the control laws and are reported to them."""

    refused_keys: ClassVar = {"above": "the bound is min_impulse_N_s"}

    min_impulse_N_s: Annotated[float, Field(ge=0.0)]
    """Least impulse, N s; contacts that begin or end, stick or slip are not reported."""


if TYPE_CHECKING:
    EstimatorConfig: TypeAlias = Any
else:
    EstimatorConfig = chosen_by_kind(ChainMap(estimators().configs, {"truth": TruthConfig}))


class JointLimitConfig(StrictModel):
    """Limits of one joint; their values are those of the model."""

    restitution: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    """Coefficient of restitution e at both ends of the range: 0 the joint stays at the limit while pressed, 1 elastic."""


UNUSABLE_LAW = "impact_law"
"""Type of the pydantic error of a name that no usable law has."""


class _Known:
    """Asks for the laws at every validation and every JSON schema: one may be registered after this module is imported."""

    @classmethod
    def __get_pydantic_core_schema__(cls, _: Any, __: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(_known_law)

    @classmethod
    def __get_pydantic_json_schema__(cls, _: CoreSchema, __: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"enum": list(impact_laws()), "type": "string"}


LawName = Annotated[str, _Known]


def _known_law(name: Any) -> str:
    laws = impact_laws()
    if isinstance(name, str) and name in laws:
        return name
    if isinstance(name, str) and (fault := plugin_fault(name)):
        raise PydanticCustomError(UNUSABLE_LAW, "{fault}", {"fault": fault})
    *first, last = map(repr, laws)
    raise PydanticCustomError(UNUSABLE_LAW, "Input should be {allowed}", {"allowed": f"{', '.join(first)} or {last}"})


class ImpactConfig(StrictModel):
    """Impact law, and limits of impact resolution."""

    law: LawName = "blend"
    """An installed impact law; ``blend``, ``poisson`` and ``newton`` differ where several contacts meet at once. No
    ``newton`` with mu. ``compliant`` is of one contact, with the elastic constants of its rule."""
    rest_interval_s: Annotated[float, Field(ge=0.0)] | None = None
    """A contact with e < 1 becomes persistent when its next bounce would be shorter, s; default: time_step_s."""
    rest_speed_m_s: Annotated[float, Field(ge=0.0)] = 0.0
    """A pressed contact with e < 1 becomes persistent if it would separate more slowly than this, m/s."""
    max_impacts: PositiveInt = 10_000
    """The run ends after this many impacts, those at joint limits included."""


# Ratios are compared with integers to a relative 1e-9; beyond this ratio that is half a period, and any would pass.
_MOST_PERIODS = 5e8

JointValue = float | tuple[float, ...]


class InitialConfig(StrictModel):
    """State at t = 0. Joints that are not listed start at the model's zero position, at rest.

    With ``from``, the run begins at an instant of another run, whose state at t = 0 this is then; it may be left out.
    """

    joints: dict[Name, JointValue] = {}
    """Coordinates by joint, rad or m; for a free joint x, y, z in m and a quaternion w, x, y, z."""
    rates: dict[Name, JointValue] = {}
    """Rates by joint, rad/s or m/s; for a free joint velocity in world axes and angular velocity in body axes."""
    activations: dict[Name, JointValue] = {}
    """Activation of servos that have one, by actuator; left out: that at which the servo exerts no force."""
    frame: Literal["world", "lvlh"] = "world"
    """Axes of free joints: ``world``, with rates as an inertial observer sees them, or with an orbit ``lvlh`` at t = 0 (x
    along V-bar, y along -H-bar, z along R-bar), with rates relative to these rotating axes: at rest is station-keeping."""
    from_: Annotated[Name | None, Field(alias="from")] = None
    """Folder of a run from which this one goes on, relative to this file; see docs/stepping.md."""
    at_s: PositiveFloat | None = None
    """Instant of that run, s: this one begins at the first control tick or event at or after it, and time goes on."""

    @model_validator(mode="after")
    def _both_or_none(self) -> InitialConfig:
        if (self.from_ is None) != (self.at_s is None):
            raise ValueError("'from' and 'at_s' belong together: a run, and an instant of it in s")
        return self


class ActuationConfig(StrictModel):
    """Timing of control."""

    delay_s: NonNegativeFloat = 0.0
    """Time from a command to its effect, s, of actuators without a delay of their own."""
    control_jitter_s: NonNegativeFloat = 0.0
    """Each control tick is late by a time that is uniform from 0 to this, s; less than the control period."""


class TerminalConfig(StrictModel):
    """What must hold at the end of the run: further checks, which pass or fail with the others."""

    stack_momentum_N_m_s: PositiveFloat | None = 1e-6
    """Greatest angular momentum of robot and grasped object about their centre of mass, except that of the wheels, N m s;
    null: not checked."""
    base_rate_rad_s: PositiveFloat | None = None
    """Greatest angular speed of the robot's base, rad/s."""
    base_speed_m_s: PositiveFloat | None = None
    """Greatest speed of the robot's base, m/s."""
    relative_rate_rad_s: PositiveFloat | None = None
    """Greatest angular speed of a grasped object relative to the base, rad/s; of any object if none is grasped."""


class LogConfig(StrictModel):
    """Output files."""

    rerun: bool = True
    """Write ``run.rrd`` for the Rerun viewer."""
    view_rate_hz: PositiveFloat = 50.0
    """Frames per simulated second in ``run.rrd`` and in the viewer topics of ``run.mcap``."""
    max_size_GB: PositiveFloat = 100.0
    """A run with more uncompressed samples than this is refused, GB; the log is a half to a fifth of their size."""
    states: Literal["off", "events"] = "off"
    """Write the whole state of the simulation into the log at events of contacts, grasps and limits (``events``), so that a
    run that goes on from an instant (``--from``) need not be made again from its beginning; some 10 to 100 kB each."""


class RealTimeConfig(StrictModel):
    """A run that waits for a clock."""

    factor: PositiveFloat = 1.0
    """Simulated seconds per second."""
    max_late_s: PositiveFloat | None = None
    """A run of which a control tick begins later than this, s, ends with the outcome ``overrun``; default: it goes on."""


def _direction(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    """A vector that is not zero."""
    if not any(vector):
        raise ValueError("a direction is needed, from the scene to the camera, such as [0, -1, 1]; [0, 0, 0] is none")
    return vector


class ScenarioConfig(StrictModel):
    """Keys of a scenario file: a run of one robot and its objects."""

    model_config = ConfigDict(title="Scenario")
    refused_keys: ClassVar = {
        "captures": "grasps are declared under 'grasps'",
        "told_of_impacts": "which impacts are reported to control laws is set by 'impact_feedback'",
    }

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
    """A vacuum without gravity, whatever the models say of them; what breaks the balances, as dampers that drive, is
    refused. If false, gravity enters the balance; with fluids or any of the others energy and momenta are not checked.
    Springs, dampers and dry friction of joints and tendons always enter the balance."""
    stop_on_impact: bool = False
    """End the run right after the first impact."""
    scene: SceneConfig | None = None
    """Robot, objects and surroundings in one MJCF file; written out as ``robot`` and ``objects`` in the log."""
    robot: Robot = REQUIRED
    objects: dict[Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")], Model] = {}
    """Floating and fixed objects by name; the name is the prefix of all elements of the object's model."""
    model: Trees = {}
    """Properties of bodies, their geoms and joints: by ``robot`` or an object, then by body; files are not changed."""
    controller_model: Trees = {}
    """Further changes, on top of ``model``, in the models that the control laws use; default: the true models."""
    controller_joints: Literal["rigid", "flexible"] = "rigid"
    """Joints of the models of control laws where ``robot.joint_flex`` makes some flexible: ``rigid`` as in the file, at the
    coordinates of the motors, or ``flexible`` as in the plant."""
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
    impact_feedback: bool | ImpactFeedbackConfig = True
    """Whether impacts and other contact events call the control laws and are reported to them, or only hard impacts."""
    task: TaskConfig | None = None
    joint_limits: dict[Name, JointLimitConfig] = {}
    """Restitution of joints that stop at limits, by joint; default: 0."""
    contacts: ContactsConfig = ContactsConfig()
    grasps: dict[Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$")], GraspConfig] = {}
    """Grasps by name: when armed, a site of the robot can latch a site of a floating object."""
    script_laws: tuple[Name, ...] | None = None
    """Kinds of control laws and estimators that a script passed to the run that wrote this scenario; they name no code."""
    phases: Annotated[tuple[PhaseConfig, ...], Field(min_length=1)]
    impact: ImpactConfig = ImpactConfig()
    terminal: TerminalConfig | None = None
    """Checks of the state at the end of the run; left out: none."""
    contact_models: tuple[Annotated[Any, OF_PLUGIN], ...] = ()
    """Contact models in addition to impacts, each with its ``kind``; see docs/contact-models.md."""
    environment: EnvironmentConfig | None = None
    """An orbit, and other external fields; left out: none."""
    realtime: RealTimeConfig | None = None
    """Control ticks wait for the clock of the machine; default: a run is as fast as it can be. See ``--realtime``."""
    log: LogConfig = LogConfig()
    view: Annotated[tuple[float, float, float], AfterValidator(_direction)] | None = None
    """Direction from which recordings and pages look at the scene: from it to the camera, in world axes; default: the one
    from which the first contact, the tip and the base are least hidden."""
    uncertainties: dict[Name, PositiveFloat] = {}
    """Standard deviations of numbers of the scenario by dotted key, in their units: a run is repeated at plus and minus each
    of them, and its report says what they change (docs/sensitivity.md)."""
    env: EnvConfig | None = None
    """The scenario as a Gymnasium environment (docs/gymnasium.md); a run ignores it."""

    @property
    def has_controller_model(self) -> bool:
        """Whether control laws compute with models of their own: other ones, or with an estimated state."""
        return any(self.controller_model.values()) or self.estimator.kind != "truth" or self.has_rigid_laws

    @property
    def has_rigid_laws(self) -> bool:
        """Whether control laws assume rigid joints where those of the plant are flexible."""
        return bool(self.robot.joint_flex) and self.controller_joints == "rigid"

    @property
    def feedback_impulse_N_s(self) -> float | None:
        """Least impulse of the impacts that are reported, N s; -inf: all contact events are; None: none."""
        feedback = self.impact_feedback
        return (-math.inf if feedback else None) if isinstance(feedback, bool) else feedback.min_impulse_N_s

    @property
    def steps_per_tick(self) -> int:
        """Number of integration steps in a control period."""
        return round(self.control_period_s / self.time_step_s)

    @property
    def ticks(self) -> int:
        """Number of control periods in the run."""
        return round(self.duration_s / self.control_period_s)


def timing_faults(scenario: ScenarioConfig) -> list[Fault]:
    """Faults of the combination of duration, control period and time step."""
    faults = []
    if scenario.actuation.control_jitter_s >= scenario.control_period_s:
        fault = f"must be less than control_period_s ({scenario.control_period_s:g} s): the next tick would be earlier"
        faults.append(Fault(fault, ("actuation", "control_jitter_s")))
    delays: dict[tuple[str, ...], float] = {("actuation", "delay_s"): scenario.actuation.delay_s}
    delays |= {("actuators", name, "delay_s"): config.delay_s or 0.0 for name, config in scenario.actuators.items()}
    for path, delay_s in delays.items():
        if delay_s >= scenario.duration_s:
            text = f"{delay_s:g} s is not shorter than the run ({scenario.duration_s:g} s): no command would have an effect"
            faults.append(Fault(text, path))
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
