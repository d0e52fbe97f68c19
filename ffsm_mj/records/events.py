"""Event records: impacts, phases, unhandled contacts, and the outcome of the run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, ClassVar, Protocol

ControllerReport = Mapping[str, float | int | str]
"""Report of a control law on a phase: finite numbers and texts by name."""


class Outcome(StrEnum):
    """How a run ended; ``sentence`` describes each outcome."""

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
        """Description of the outcome."""
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
    """The run ends early; carries its outcome."""

    def __init__(self, outcome: Outcome, message: str = "") -> None:
        self.outcome, self.message = outcome, message or outcome.sentence
        super().__init__(self.message)


@dataclass(frozen=True)
class ImpactRecord:
    """One contact of an impact; contacts at one instant share ``event`` and the states before and after.

    Attributes:
        event: Number of the impact, from 0.
        time_s: Time of the impact.
        step: Integration step of the impact, from 0.
        pair: Name of the pair of geoms.
        geoms: Geoms a and b.
        robot_geom: Geom a if it is of the robot and b of an object, floating or fixed; else empty.
        object_geom: Geom b if it is of an object, floating or fixed, and a of the robot; else empty.
        point_m: Contact point, the midpoint of the witness points, in world axes.
        normal: Unit normal in world axes, from a to b.
        manifold: ``point``, ``edge`` or ``face``.
        law: Impact law of the result; with friction ``stronge`` (one contact), ``coulomb`` or ``poisson`` (several).
        status: ``ok``; ``energy_guard``: restitution reduced by ``theta`` to prevent a gain of energy; ``jammed``: bodies
            squeezed without clearance, no elastic solution exists and energy was lost; ``wedged``: one self-locking contact.
        restitution: Coefficient of restitution of the pair.
        restitution_used: Coefficient that was applied: 0 if the contact comes to rest and becomes persistent.
        dropped_gap_m: If the contact comes to rest, the greatest gap of the bounces that were skipped; else 0.
        dropped_flights_s: Total duration of the skipped bounces, by which the contact rests too early; else 0.
        approach_speed_m_s: Speed of approach along the normal before the impact.
        separation_speed_m_s: Speed of separation along the normal after the impact.
        impulse_N_s: Normal impulse on b.
        angular_impulse_N_m_s: Its moment in world axes about the centre of mass of the robot or object that b belongs to, or
            about the origin of its model's frame if that is fixed.
        mu: Coefficient of friction of the pair.
        theta: Factor on the restitution applied by the energy guard; 1 if it was not needed.
        tangential_impulse_N_s: Friction impulse on b in world axes, tangential. Without friction it is zero, as are
            all fields below except the normal work, which is then that of the impulse alone.
        slip_before_m_s: Tangential velocity of b relative to a at the point before the impact, in world axes; not computed
            (zero) if no contact of the impact has friction.
        slip_after_m_s: Tangential velocity after the impact.
        path: Contact modes in order: ``slip``, ``stick``, ``reverse slip``; empty without friction.
        normal_work_J: Work of the normal impulse; for one contact the integral of its speed over its impulse.
        friction_work_J: Work of friction; <= 0 for one contact. For several, its split from normal work is a convention.
        compression_work_J: Work of the normal impulse until the end of compression, <= 0 for one contact with friction.
        rule: Name of the contact rule of the pair.
        gap_m: Distance of the geoms at the event; zero within the tolerance of the root finder.
        qpos: Configuration, unchanged by the impact, in the order of the sample's ``q_`` fields.
        qvel_before: Generalised velocity before, by joint.
        qvel_after: Generalised velocity after, by joint.
        energy_before_J: Kinetic energy before, by subsystem: total, robot, objects.
        energy_after_J: Kinetic energy after, by subsystem.
        momentum_before: P and L about the world origin before, six numbers, in N s and N m s, of the total.
        momentum_after: P and L about the world origin after.
        energy_change_J: Change of the total kinetic energy.
        linear_momentum_change_N_s: Norm of the change of the total linear momentum: rounding, or impulses of fixed bodies.
        angular_momentum_change_N_m_s: Norm of the change of the total angular momentum about the world origin; likewise.
        efforts_after: Effort by actuator from the impact on, as the controller decided then; efforts are off during it.
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
    rule: str = ""
    efforts_after: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class PhaseRecord:
    """A phase begins.

    Attributes:
        index: Position of the phase in the scenario, from 0.
        name: Name of the phase.
        controller: Kind of its controller.
        start_s: Time at which it begins.
        reason: ``start``, ``time``, ``settled``, ``finished``, or the record that ended the previous phase, e.g. ``impact``.
    """

    index: int
    name: str
    controller: str
    start_s: float
    reason: str


@dataclass(frozen=True)
class UnhandledContactRecord:
    """Overlap of two geoms that are neither of a contact rule nor ignored; no contact force acted.

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
    """An exception that ended the run: a bug of ffsm-mj or of a plug-in, not a property of the motion.

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
    """Outcome of the run, and its computational cost.

    Attributes:
        outcome: One of the outcomes, ``completed`` for a regular end.
        message: Details of the outcome.
        end_s: Simulation time at the end.
        steps: Integration steps of the grid, those of ``time_step_s``.
        wall_s: Wall time of the simulation; 0 if SOURCE_DATE_EPOCH is set.
        controller_ticks: Number of control ticks.
        reports: Reports of the control laws by phase, for all phases that began; JSON in the log.
        versions: Versions of the packages that affect results.
        sub_steps: Number of integration steps with ``accuracy``; 0 without.
        smallest_step_s: Shortest integration step with ``accuracy``; 0 without.
        law_wall_s: Wall time of all calls of control laws and estimator; 0 if SOURCE_DATE_EPOCH is set.
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
    law_wall_s: float = 0.0


class Event(Protocol):
    """A record of a registered kind other than the outcome: a frozen dataclass; see :mod:`.kinds`."""

    __dataclass_fields__: ClassVar[dict[str, Any]]
