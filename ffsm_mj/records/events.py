"""What happens once rather than every tick: impacts, phases, contacts nobody handles, and how the run ended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, ClassVar, Protocol

ControllerReport = Mapping[str, float | int | str]
"""What a control law says of its work in a phase: finite numbers and texts by name."""


class Outcome(StrEnum):
    """How a run ended; each member's ``sentence`` says it to a person."""

    COMPLETED = "completed"
    DIVERGED = "diverged"
    INTERNAL_ERROR = "internal_error"
    EVENT_LIMIT = "event_limit"
    STEP_LIMIT = "step_limit"
    UNSUPPORTED_CONTACT = "unsupported_contact"
    CONTROLLER_FAILED = "controller_failed"
    WRITE_FAILED = "write_failed"
    INTERRUPTED = "interrupted"

    @property
    def sentence(self) -> str:
        """One sentence for a person."""
        return _SENTENCES[self]


_SENTENCES = {
    Outcome.COMPLETED: "the run reached its end",
    Outcome.DIVERGED: "the motion diverged",
    Outcome.INTERNAL_ERROR: "ffsm-mj or a plug-in raised an exception",
    Outcome.EVENT_LIMIT: "the scenario's limit on the number of impacts was reached",
    Outcome.STEP_LIMIT: "the motion is too fast for the accuracy that the scenario asks for",
    Outcome.UNSUPPORTED_CONTACT: "a contact cannot be resolved exactly",
    Outcome.CONTROLLER_FAILED: "the controller failed",
    Outcome.WRITE_FAILED: "the log could not be written",
    Outcome.INTERRUPTED: "the run was interrupted",
}


class RunEnded(Exception):
    """The run is over before its time; carries how."""

    def __init__(self, outcome: Outcome, message: str = "") -> None:
        self.outcome, self.message = outcome, message or outcome.sentence
        super().__init__(self.message)


@dataclass(frozen=True)
class ImpactRecord:
    """One contact of an impact; contacts at one instant share ``event`` and the states before and after.

    Attributes:
        event: Number of the impact, from 0.
        time_s: Instant of the impact.
        step: Integration step in which it happened, from 0.
        pair: Name of the pair of geoms that touch.
        geoms: The two, a and b.
        robot_geom: Geom a, where the robot touches an object, floating or fixed; else empty.
        object_geom: Geom b, where the robot touches an object, floating or fixed; else empty.
        point_m: Contact point, the midpoint of the witness points, in world axes.
        normal: Unit normal in world axes, from a to b.
        manifold: ``point``, ``edge`` or ``face``.
        law: Impact law that made the result; with friction ``stronge`` (one contact), ``coulomb`` or ``poisson`` (several).
        status: ``ok``; ``energy_guard``: restitution was lowered by ``theta`` lest energy be gained; ``jammed``: bodies were
            squeezed without clearance, no elastic answer exists and energy was lost; ``wedged``: one contact locked itself.
        restitution: Coefficient of restitution of the pair.
        restitution_used: The one that made the result: 0 where the contact comes to rest and lasts.
        dropped_gap_m: Where it comes to rest, the highest gap of the flights that it would have made yet; else 0.
        dropped_flights_s: How long those would have lasted in all: so much too early it rests; else 0.
        approach_speed_m_s: Speed of approach along the normal before.
        separation_speed_m_s: Speed of separation along the normal after.
        impulse_N_s: Impulse on b, along the normal.
        angular_impulse_N_m_s: Its moment about the centre of mass of the robot or object that b is of, in world axes; where
            that is fixed about the origin of its model's frame.
        mu: Coefficient of friction of the pair.
        theta: Share of the restitution that the energy guard left; 1 where it was not needed.
        tangential_impulse_N_s: Impulse of friction on b, across the normal, in world axes; zero without friction, as is all
            that follows but the normal work, which is then that of the impulse alone.
        slip_before_m_s: Velocity of b relative to a at the point before, less its normal part, in world axes; not worked out
            (zero) where no contact of the impact has friction.
        slip_after_m_s: The same after.
        path: What the contact passed through: ``slip``, ``stick``, ``reverse slip``, in order; empty where nothing rubs.
        normal_work_J: Work of the normal impulse; of one contact the integral of its speed over its impulse.
        friction_work_J: Work of friction. Of one contact <= 0; of several the split between the two is a convention.
        compression_work_J: Work of the normal impulse up to the end of compression, <= 0 for one contact with friction.
        gap_m: Distance of the geoms at the event; zero but for the root's tolerance.
        qpos: Configuration, the same before and after, in the order of the sample's ``q_`` fields.
        qvel_before: Generalised velocity before, by joint.
        qvel_after: Generalised velocity after, by joint.
        energy_before_J: Kinetic energy before, by subsystem: total, robot, objects.
        energy_after_J: Kinetic energy after, by subsystem.
        momentum_before: P and L about the world origin before, six numbers, in N s and N m s, of the total.
        momentum_after: The same after.
        energy_change_J: Change of the total kinetic energy.
        linear_momentum_change_N_s: Norm of the change of the total linear momentum: rounding, or what fixed bodies gave.
        angular_momentum_change_N_m_s: Norm of the change of the total angular momentum about the world origin; likewise.
        efforts_after: Effort by actuator from here on, as the controller decided at the impact; it sees none itself.
    """

    event: int
    time_s: float
    step: int
    pair: str
    geoms: tuple[str, ...]
    robot_geom: str
    object_geom: str
    point_m: tuple[float, ...]
    normal: tuple[float, ...]
    manifold: str
    law: str
    status: str
    restitution: float
    restitution_used: float
    dropped_gap_m: float
    dropped_flights_s: float
    approach_speed_m_s: float
    separation_speed_m_s: float
    impulse_N_s: float
    angular_impulse_N_m_s: tuple[float, ...]
    mu: float
    normal_work_J: float
    gap_m: float
    qpos: tuple[float, ...]
    qvel_before: Mapping[str, tuple[float, ...]]
    qvel_after: Mapping[str, tuple[float, ...]]
    energy_before_J: Mapping[str, tuple[float, ...]]
    energy_after_J: Mapping[str, tuple[float, ...]]
    momentum_before: Mapping[str, tuple[float, ...]]
    momentum_after: Mapping[str, tuple[float, ...]]
    energy_change_J: float
    linear_momentum_change_N_s: float
    angular_momentum_change_N_m_s: float
    theta: float = 1.0
    tangential_impulse_N_s: tuple[float, ...] = (0.0, 0.0, 0.0)
    slip_before_m_s: tuple[float, ...] = (0.0, 0.0, 0.0)
    slip_after_m_s: tuple[float, ...] = (0.0, 0.0, 0.0)
    path: str = ""
    friction_work_J: float = 0.0
    compression_work_J: float = 0.0
    efforts_after: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class PhaseRecord:
    """A phase begins.

    Attributes:
        index: Position of the phase in the scenario, from 0.
        name: Name of the phase.
        controller: Kind of its controller.
        start_s: When it begins.
        reason: Why: ``start``, ``time``, ``settled``, or the name of the record that ended the one before, as ``impact``.
    """

    index: int
    name: str
    controller: str
    start_s: float
    reason: str


@dataclass(frozen=True)
class UnhandledContactRecord:
    """Two geoms overlapped that are neither an impact pair nor ignored; nothing pushed them apart.

    Attributes:
        geoms: The two geoms.
        start_s: First step at which they overlapped.
        end_s: Last step at which they overlapped.
        max_depth_m: Greatest depth of the overlap.
    """

    geoms: tuple[str, ...]
    start_s: float
    end_s: float
    max_depth_m: float


@dataclass(frozen=True)
class InternalErrorRecord:
    """An exception that ended the run: a fault of ffsm-mj or of a plug-in, not of the motion.

    Attributes:
        time_s: Simulation time at the last event or step end before it.
        step: Integration step in which it was raised, from 0.
        error: Type and text of the exception, on one line.
        where: File, line and function that raised it.
        traceback: Python's traceback, with paths relative to where packages are installed.
    """

    time_s: float
    step: int
    error: str
    where: str
    traceback: str


@dataclass(frozen=True)
class OutcomeRecord:
    """How the run ended, and what it cost.

    Attributes:
        outcome: One of the outcomes, ``completed`` where all went well.
        message: What there is to say of it.
        end_s: Simulation time at the end.
        steps: Integration steps of the grid, those of ``time_step_s``.
        wall_s: Wall time of the simulation; 0 where SOURCE_DATE_EPOCH is set.
        controller_ticks: Control ticks taken.
        reports: What the control laws of the phases begun say of their work, by phase; JSON in the log.
        versions: Versions of the packages that shape a result.
        sub_steps: Integration steps into which ``accuracy`` cut those of the grid; 0 without.
        smallest_step_s: The shortest that it chose; 0 without.
    """

    outcome: str
    message: str
    end_s: float
    steps: int
    wall_s: float
    controller_ticks: int
    reports: Mapping[str, ControllerReport] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    sub_steps: int = 0
    smallest_step_s: float = 0.0


class Event(Protocol):
    """A record of a registered kind, the outcome aside: a frozen dataclass; see :mod:`.kinds`."""

    __dataclass_fields__: ClassVar[dict[str, Any]]
