"""Event records: impacts, phases, unhandled contacts, and the outcome of the run."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Any, ClassVar, Protocol

from ffsm_mj.records.record import ByName, Meaning, Values, declared, record

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
    SINGULAR_MECHANISM = "singular_mechanism"
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
    Outcome.SINGULAR_MECHANISM: "closed loops became singular",
    Outcome.CONTROLLER_FAILED: "the controller failed",
    Outcome.WRITE_FAILED: "the log could not be written",
    Outcome.INTERRUPTED: "the run was interrupted",
}


class RunEnded(Exception):
    """The run ends early; carries its outcome."""

    def __init__(self, outcome: Outcome, message: str = "") -> None:
        self.outcome, self.message = outcome, message or outcome.sentence
        super().__init__(self.message)


STEP = Meaning("Index of the integration step, from 0.", column=None)
QPOS = Meaning("Configuration, in the order of the sample's ``q_`` fields.")
QVEL = Meaning("Generalised velocity, by joint.")
QVEL_UNCHANGED = Meaning("Equal to ``qvel_before``.")
QVEL_BEFORE = Meaning("Generalised velocity before, by joint.")
QVEL_AFTER = Meaning("Generalised velocity after, by joint.")
ENERGY_BEFORE = Meaning("Kinetic energy before, by subsystem: total, robot, objects.", entries={"total": 1})
ENERGY_AFTER = Meaning("Kinetic energy after, by subsystem.", entries={"total": 1})

IMPACT_STEP = Meaning("Integration step of the impact, from 0.", column=None)
THETA = Meaning(
    "Factor on the restitution applied by the energy guard; 1 if it was not needed.",
    column="factor by which the energy guard reduced the restitution; 1 if it was not needed",
)
MOMENTUM_BEFORE = Meaning(
    "P and L about the world origin before, six numbers, in N s and N m s, of the total.", entries={"total": 6}
)
MOMENTUM_AFTER = Meaning("P and L about the world origin after.", entries={"total": 6})


@record
class ImpactRecord:
    """One contact of an impact; contacts at one instant share ``event`` and the states before and after."""

    event: int = declared(
        "Number of the impact, from 0.", column="number of the impact, from 0; contacts at one instant share it"
    )
    time_s: float = declared("Time of the impact.", column="simulation time")
    step: int = declared(IMPACT_STEP)
    pair: str = declared("Name of the pair of geoms.", column="name of the pair of geoms that touch")
    geoms: tuple[str, ...] = declared(
        "Geoms a and b.", column="geom of the pair; the normal points from a to b", components="ab"
    )
    robot_geom: str = declared(
        "Geom a if it is of the robot and b of an object, floating or fixed; else empty.",
        column="geom a if the robot touches an object, else empty",
    )
    object_geom: str = declared(
        "Geom b if it is of an object, floating or fixed, and a of the robot; else empty.",
        column="geom b if the robot touches an object, else empty",
    )
    point_m: Values = declared(
        "Contact point, the midpoint of the witness points, in world axes.",
        column="contact point, world frame",
        components="xyz",
        after="dropped_flights_s",
    )
    normal: Values = declared(
        "Unit normal in world axes, from a to b.",
        column="normal from a to b, world frame",
        components="xyz",
        after="point_m",
    )
    manifold: str = declared("``point``, ``edge`` or ``face``.")
    law: str = declared(
        "Impact law of the result; with friction ``stronge`` (one contact), ``coulomb`` or ``poisson`` (several).",
        column="impact law that gave the result",
    )
    status: str = declared(
        "``ok``; ``energy_guard``: restitution reduced by ``theta`` to prevent a gain of energy; ``jammed``: bodies "
        "squeezed without clearance, no elastic solution exists and energy was lost; ``wedged``: one self-locking contact.",
        column="status of the solution: ok, energy_guard, jammed or wedged",
    )
    restitution: float = declared("Coefficient of restitution of the pair.")
    restitution_used: float = declared(
        "Coefficient that was applied: 0 if the contact comes to rest and becomes persistent.",
        column="coefficient of restitution that was used: 0 if the contact comes to rest",
    )
    dropped_gap_m: float = declared(
        "If the contact comes to rest, the greatest gap of the bounces that were skipped; else 0.",
        column="if the contact comes to rest: highest gap of the omitted flights",
    )
    dropped_flights_s: float = declared(
        "Total duration of the skipped bounces, by which the contact rests too early; else 0.",
        column="total duration of the omitted flights",
    )
    approach_speed_m_s: float = declared(
        "Speed of approach along the normal before the impact.", column="approach speed along the normal before the impact"
    )
    separation_speed_m_s: float = declared(
        "Speed of separation along the normal after the impact.", column="separation speed along the normal after the impact"
    )
    impulse_N_s: float = declared("Normal impulse on b.", column="impulse on b along the normal")
    angular_impulse_N_m_s: Values = declared(
        "Moment of the impulse on b, friction included, in world axes, about the centre of mass of the robot or object that "
        "b belongs to, or about the origin of its model's frame if that is fixed.",
        column="angular impulse on b, with friction, about the centre of mass of its robot or object; if fixed, its "
        "model's origin",
        components="xyz",
    )
    mu: float = declared("Coefficient of friction of the pair.")
    normal_work_J: float = declared(
        "Work of the normal impulse; for one contact the integral of its speed over its impulse.",
        column="work of the normal impulse",
    )
    gap_m: float = declared(
        "Distance of the geoms at the event; zero within the tolerance of the root finder.",
        column="signed distance at the event",
    )
    qpos: Values = declared("Configuration, unchanged by the impact, in the order of the sample's ``q_`` fields.")
    qvel_before: ByName = declared(QVEL_BEFORE)
    qvel_after: ByName = declared(QVEL_AFTER)
    energy_before_J: ByName = declared(ENERGY_BEFORE)
    energy_after_J: ByName = declared(ENERGY_AFTER)
    momentum_before: ByName = declared(MOMENTUM_BEFORE)
    momentum_after: ByName = declared(MOMENTUM_AFTER)
    energy_change_J: float = declared(
        "Change of the total kinetic energy.", column="kinetic energy gained by the whole system"
    )
    linear_momentum_change_N_s: float = declared(
        "Norm of the change of the total linear momentum: rounding, or impulses of fixed bodies.",
        column="norm of the change of the whole system's linear momentum",
    )
    angular_momentum_change_N_m_s: float = declared(
        "Norm of the change of the total angular momentum about the world origin; likewise.",
        column="norm of the change of the whole system's angular momentum about the origin",
    )
    theta: float = declared(THETA, after="status", default=1.0)
    tangential_impulse_N_s: Values = declared(
        "Friction impulse on b in world axes, tangential. Without friction it is zero, as are ``slip_before_m_s``, "
        "``slip_after_m_s``, ``friction_work_J`` and ``compression_work_J``; ``path`` is empty.",
        column="friction impulse on b, world frame",
        components="xyz",
        after="mu",
        default=(0.0, 0.0, 0.0),
    )
    slip_before_m_s: Values = declared(
        "Tangential velocity of b relative to a at the point before the impact, in world axes; not computed "
        "(zero) if no contact of the impact has friction.",
        column="tangential velocity of b relative to a before, world frame; zero without friction",
        components="xyz",
        after="tangential_impulse_N_s",
        default=(0.0, 0.0, 0.0),
    )
    slip_after_m_s: Values = declared(
        "Tangential velocity after the impact.",
        column="tangential velocity of b relative to a after, world frame; zero without friction",
        components="xyz",
        after="slip_before_m_s",
        default=(0.0, 0.0, 0.0),
    )
    path: str = declared(
        "Contact modes in order: ``slip``, ``stick``, ``reverse slip``; empty without friction.",
        column="sequence of slip, stick and reverse slip during the impact",
        after="slip_after_m_s",
        default="",
    )
    friction_work_J: float = declared(
        "Work of friction; <= 0 for one contact. For several, its split from normal work is a convention.",
        column="work of the friction impulse",
        after="normal_work_J",
        default=0.0,
    )
    compression_work_J: float = declared(
        "Work of the normal impulse until the end of compression, <= 0 for one contact with friction.",
        column="work of the normal impulse until the end of compression; contacts with friction only",
        after="friction_work_J",
        default=0.0,
    )
    rule: str = declared(
        "Name of the contact rule of the pair.", column="name of its contact rule", after="pair", default=""
    )
    efforts_after: ByName = declared(
        "Effort by actuator from the impact on, as the controller decided then; efforts are off during it.",
        default_factory=dict,
    )


@record
class PhaseRecord:
    """A phase begins."""

    index: int = declared("Position of the phase in the scenario, from 0.", column="position in the scenario, from 0")
    name: str = declared("Name of the phase.")
    controller: str = declared("Kind of its controller.")
    start_s: float = declared("Time at which it begins.", column="when it begins")
    reason: str = declared(
        "``start``, ``time``, ``settled``, ``finished``, or the record that ended the previous phase, e.g. ``impact``.",
        column="why it begins",
    )


@record
class UnhandledContactRecord:
    """Overlap of two geoms that are neither of a contact rule nor ignored; no contact force acted."""

    geoms: tuple[str, ...] = declared("The two geoms.", components="ab")
    start_s: float = declared("First step at which they overlapped.")
    end_s: float = declared("Last step at which they overlapped.")
    max_depth_m: float = declared("Greatest depth of the overlap.")


@record
class InternalErrorRecord:
    """An exception that ended the run: a bug of ffsm-mj or of a plug-in, not a property of the motion."""

    time_s: float = declared("Simulation time at the last event or step end before it.")
    step: int = declared("Integration step in which it was raised, from 0.", column="integration step, from 0")
    error: str = declared("Type and text of the exception, on one line.", column="type and text of the exception")
    where: str = declared("File, line and function that raised it.")
    traceback: str = declared(
        "Python's traceback, with paths relative to where packages are installed.", column="Python's traceback"
    )


@record
class OutcomeRecord:
    """Outcome of the run, and its computational cost."""

    outcome: str = declared("One of the outcomes, ``completed`` for a regular end.")
    message: str = declared("Details of the outcome.")
    end_s: float = declared("Simulation time at the end.")
    steps: int = declared("Integration steps of the grid, those of ``time_step_s``.")
    wall_s: float = declared("Wall time of the simulation; 0 if SOURCE_DATE_EPOCH is set.")
    controller_ticks: int = declared("Number of control ticks.")
    reports: Mapping[str, ControllerReport] = declared(
        "Reports of the control laws by phase, for all phases that began; JSON in the log.", default_factory=dict
    )
    versions: Mapping[str, str] = declared("Versions of the packages that affect results.", default_factory=dict)
    sub_steps: int = declared("Number of integration steps with ``accuracy``; 0 without.", default=0)
    smallest_step_s: float = declared("Shortest integration step with ``accuracy``; 0 without.", default=0.0)
    law_wall_s: float = declared(
        "Wall time of all calls of control laws and estimator; 0 if SOURCE_DATE_EPOCH is set.", default=0.0
    )


class Event(Protocol):
    """A record of a registered kind other than the outcome: a frozen dataclass; see :mod:`.kinds`."""

    __dataclass_fields__: ClassVar[dict[str, Any]]
