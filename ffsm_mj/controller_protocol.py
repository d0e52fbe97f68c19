"""What a controller sees and what it returns, and all else that a control law needs to import.

A controller is called once per control period and at once at an impact. It sees the true state through MuJoCo's data and
writes efforts for the actuators it drives; all others stay off. Limits are the plant's business, not the controller's.
Model and data are the plant's own, or of what a scenario's ``controller_model`` lets it take the plant for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol, runtime_checkable

from ffsm_mj._core.fields import FieldForces
from ffsm_mj._core.orbit import KeplerOrbit
from ffsm_mj._core.osdre import CommandingLaw, OutputLaw
from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.config import FileName, StrictModel
from ffsm_mj.dynamics.loops.equalities import ConstrainedModel
from ffsm_mj.dynamics.motion import predict
from ffsm_mj.dynamics.reach import reach_of
from ffsm_mj.dynamics.rigid_body import (
    ReducedModel,
    base_jacobian,
    base_wrench,
    cross,
    external_actuators,
    free_components,
    kinetic_energy,
    mass_matrix,
    momentum_matrix,
    reduced_model,
    site_actuators,
    site_wrench,
    skew,
    subtree_momenta,
)
from ffsm_mj.dynamics.site_motion import MovingFrame, SiteMotion
from ffsm_mj.dynamics.stack_momentum import StackMomentum
from ffsm_mj.dynamics.trajectories import MinimumJerk, TargetMotion
from ffsm_mj.errors import ControllerError, Fault, Faults, ScenarioFaults, faults_below, unknown_name
from ffsm_mj.fields.orbit import LvlhAxes, Orbit
from ffsm_mj.model.actuators import is_servo
from ffsm_mj.model.driven_joints import (
    DrivenJoints,
    control_unit,
    driven_joints,
    drives_rotation,
    needs_motors,
    servo_joints,
)
from ffsm_mj.model.grasp import Grasp
from ffsm_mj.model.inputs import SetpointLaw, setpoint_law
from ffsm_mj.model.system import Joint, SharedJoints, System, Tree, driven_bodies, rotor_fault, shared_joints
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.command import Command, ExternalCommand
from ffsm_mj.records.contact_forces import ActiveContact
from ffsm_mj.records.events import ImpactRecord, PhaseRecord
from ffsm_mj.records.kinds import kind_named
from ffsm_mj.records.record import ControllerReport
from ffsm_mj.records.recorded_table import RecordedTable, TableError
from ffsm_mj.records.signals import Signal, identifier
from ffsm_mj.sensing.measured import Estimator, Measurement
from ffsm_mj.sensing.sensor import Sensor
from ffsm_mj.state import HasState, StateError, Stateful, entries
from ffsm_mj.unchanging import with_state

__all__ = [
    "ActiveContact",
    "ChecksStart",
    "Columns",
    "Command",
    "ConstrainedModel",
    "Controller",
    "ControllerContext",
    "ControllerError",
    "ControllerReport",
    "Damping",
    "Damps",
    "DrivenJoints",
    "Drives",
    "EffortLimits",
    "Estimator",
    "ExternalCommand",
    "Fault",
    "Faults",
    "FieldForces",
    "FileName",
    "Finishes",
    "FloatArray",
    "Grasp",
    "HasState",
    "ImpactRecord",
    "IntArray",
    "Joint",
    "KeplerOrbit",
    "LawInCore",
    "LvlhAxes",
    "Measurement",
    "MinimumJerk",
    "MovingFrame",
    "Observation",
    "OfCore",
    "Orbit",
    "PhaseRecord",
    "RecordedTable",
    "ReducedModel",
    "ScenarioFaults",
    "Sensor",
    "SetpointLaw",
    "SharedJoints",
    "Signal",
    "SiteMotion",
    "StackMomentum",
    "StateError",
    "Stateful",
    "StrictModel",
    "Summarises",
    "System",
    "TableError",
    "TargetMotion",
    "Task",
    "Tree",
    "base_jacobian",
    "base_wrench",
    "control_unit",
    "cross",
    "driven_bodies",
    "driven_joints",
    "drives_rotation",
    "entries",
    "external_actuators",
    "faults_below",
    "free_components",
    "identifier",
    "is_servo",
    "kind_named",
    "kinetic_energy",
    "mass_matrix",
    "momentum_matrix",
    "needs_motors",
    "predict",
    "reach_of",
    "reduced_model",
    "rotor_fault",
    "servo_joints",
    "setpoint_law",
    "shared_joints",
    "site_actuators",
    "site_wrench",
    "skew",
    "subtree_momenta",
    "unknown_name",
    "with_state",
]


@dataclass(frozen=True)
class Task:
    """What the tip is to do.

    Attributes:
        tip_site: Id of the site.
        axes: World axes that count as output, p = len(axes).
        target_m: The target along them, m; where it begins if it moves.
        motion: How the target moves; None: it is at rest.
    """

    tip_site: int
    axes: tuple[int, ...]
    target_m: FloatArray
    motion: TargetMotion | None = None

    def target_at(self, time_s: float, data: Any) -> tuple[FloatArray, FloatArray | float]:
        """Position of the target in m and its velocity in m/s (0.0 for one at rest) along the axes at a time and a state."""
        if self.motion is None:
            return self.target_m, 0.0
        self.motion.update(time_s, data)
        return self.motion.position_m, self.motion.rates_m_s


class EffortLimits(Protocol):
    """Limits of the actuators, as the plant applies them to powered ones."""

    @property
    def saturation(self) -> FloatArray:
        """Joint speed of each actuator beyond which efforts cannot accelerate it further; infinite without one, (nu,)."""

    def bounds(self, velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Least and greatest effort of each actuator, N or N m, (nu,) each, at actuator velocities (nu,)."""


@dataclass(frozen=True)
class ControllerContext:
    """What a controller is built for.

    Attributes:
        system: The composed model with its index maps; what it is taken for where the scenario has a ``controller_model``.
            ``system.grasp`` says which object is held in it, if one is. For a law that drives an object, ``system.robot`` is
            that object.
        task: The tip's task, or None where the scenario has none.
        control_period_s: Time between two regular calls in s.
        reserved: Ids of the actuators that other parts of the phase drive; a law whose ``joints`` are left out leaves their
            joints alone.
        limits: Limits of the actuators; None: all are ideal.
        sensors: Sensors of the robot and its objects by full name, with their timing and errors.
        recorded: Tables of the files that the configuration of the law names, by their keys in it (``FileName``).
        grasped: Of an estimator: the systems with a grasped object by the name of the grasp, as control laws know them.
        external_field: External fields in that model: ``add_to(data, force)`` adds their generalised forces at the state
            in ``data``, (nv,), and ``predict`` takes them; None: there are none.
        grasped_fields: Of an estimator: the same with a grasped object, by the name of the grasp; empty: there are none.
        orbit: Orbit of the origin of the world axes; None: there is none.
    """

    system: System
    task: Task | None
    control_period_s: float
    reserved: frozenset[int] = frozenset()
    limits: EffortLimits | None = None
    sensors: Mapping[str, Sensor] = field(default_factory=dict)
    recorded: Mapping[str, RecordedTable] = field(default_factory=dict)
    grasped: Mapping[str, System] = field(default_factory=dict)
    external_field: FieldForces | None = None
    grasped_fields: Mapping[str, FieldForces] = field(default_factory=dict)
    orbit: Orbit | None = None

    def lvlh_axes(self, frame: str) -> LvlhAxes | None:
        """Axes of the set points of a law with the key ``frame``: LVLH axes, or None for those of the world.

        Raises:
            ScenarioFaults: LVLH axes without an orbit.
        """
        if frame != "lvlh":
            return None
        if self.orbit is None:
            raise ScenarioFaults([Fault("'lvlh' needs 'environment.orbit'", ("frame",))])
        return LvlhAxes(self.orbit)


class Observation(NamedTuple):
    """State at one instant.

    Attributes:
        time_s: Simulation time in s.
        data: MuJoCo data of the system that the law was made for, with all derived quantities current; read only.
        events: Records of what has happened at contacts since it was asked last: an impact just now, contacts that began or
            ended since.
        at_tick: This is a regular control tick, not an impact between two.
        contacts: Closed pairs with their forces, under the efforts held until now; empty where nothing is closed. They are
            computed when they are first read: a law that needs them later keeps ``tuple(observation.contacts)``.
        free: MuJoCo data of the scene as it began, in which every object keeps its own joints; while nothing is held the
            same as ``data``.
        grasps: Names of the closed grasps. The first one of the robot comes first: in ``data`` its object is a child of
            its link. What further ones hold is not in this model.
        measured: Newest sample of each sensor that has arrived, by the full name of the sensor.
        phase_start_s: Time at which the phase began, s: for ``start``, which is called again where a grasp closes or opens.
    """

    time_s: float
    data: Any
    events: tuple[Any, ...] = ()
    at_tick: bool = True
    contacts: Sequence[ActiveContact] = ()
    free: Any = None
    grasps: tuple[str, ...] = ()
    measured: Mapping[str, Measurement] = MappingProxyType({})
    phase_start_s: float = 0.0

    @property
    def attached(self) -> str:
        """Name of the grasp whose object is a child of a link in ``data``; empty where ``data`` is ``free``."""
        return self.grasps[0] if self.grasps and self.data is not self.free else ""


class Controller(Protocol):
    """A control law. The class, or each instance, declares what it reports; the instance carries its state.

    A law that remembers something from one call to the next has the pair ``get_state()`` and ``set_state(state)`` (the
    protocol :class:`HasState`), most simply as a :class:`Stateful`. Its state is what ``start`` takes from its observation
    and what ``control`` adds, with what ``telemetry`` and ``summary`` report. Where a law that had been started is restored,
    maybe in another process, ``start`` is called with the observation of that time, so that objects bound to its data exist,
    and then ``set_state``, which must replace all that ``start`` took from it. ``start`` therefore raises nothing where a
    phase could not begin: ``control`` does. A law that has not been started has a state too.
    """

    @property
    def telemetry_signals(self) -> tuple[Signal, ...]:
        """What it reports of every tick; a plain attribute of the class will do."""

    def start(self, observation: Observation) -> None:
        """Take over at this state, at the beginning of a phase."""

    def control(self, observation: Observation, command: Command) -> None:
        """Write the efforts for the coming control period into a command that is all off."""

    def telemetry(self) -> Sequence[float]:
        """Values of ``telemetry_signals`` after the last call."""


@runtime_checkable
class Summarises(Protocol):
    """A control law that sums its work up; one that has nothing to say leaves this method out."""

    def summary(self) -> ControllerReport:
        """What it came to since it was made, finite numbers and texts by name; asked once, at the end of the run."""


@runtime_checkable
class Drives(Protocol):
    """A control law that states its actuators, so that a second part that drives one of them is refused at load.

    May be left out: the run then ends where two parts drive one actuator.
    """

    @property
    def driven_actuators(self) -> Sequence[int] | IntArray:
        """Ids of all actuators that it may power."""


@runtime_checkable
class OfCore(Drives, Protocol):
    """A control law that is one of the core, and drives its actuators by the efforts of that alone."""

    def law_of_core(self) -> OutputLaw[Any] | None:
        """The law since ``start``: what it does at a tick is all that ``control`` does; None if that does more."""


class LawInCore(NamedTuple):
    """The law in charge, to be evaluated by the core at control ticks without events.

    Attributes:
        law: The law, which writes command and telemetry.
        actuators: Ids of the actuators that it drives, (n,).
        until_s: Time from which another law may be in charge, s.
    """

    law: CommandingLaw
    actuators: IntArray
    until_s: float


@runtime_checkable
class Finishes(Protocol):
    """A control law that comes to an end, at which a phase with ``until: finished`` ends; others leave this method out."""

    def is_finished(self, time_s: float) -> bool:
        """Whether it has nothing more to do from a time on, s; asked at control ticks, after ``start``."""


@runtime_checkable
class ChecksStart(Protocol):
    """A control law that cannot begin at every state: in the first phase it is refused at load where it cannot."""

    def start_faults(self, data: Any) -> Sequence[Fault]:
        """Why it cannot begin at a state, all derived quantities current; paths in its section of the scenario."""


class Damping(NamedTuple):
    """The damping of a control law at one state: the generalised force -matrix qdot[dofs] on these dofs.

    Attributes:
        key: What the gains are called in the controller's section of a scenario, as ``arm.kd``.
        dofs: Dofs of the model, (n,).
        gains: Gain of each as the scenario has it, (n,), N m s/rad or N s/m; the matrix is proportional to them.
        matrix: The damping, (n, n).
    """

    key: str
    dofs: IntArray
    gains: FloatArray
    matrix: FloatArray


@runtime_checkable
class Damps(Protocol):
    """A control law that tells its damping, so that ``ffsm check`` can hold it against the period; may be left out."""

    def damping_at(self, data: Any) -> Damping | None:
        """Its damping at a state, all derived quantities current, or None; asked before ``start``."""
