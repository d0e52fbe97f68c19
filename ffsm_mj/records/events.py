"""Event records: impacts, unhandled contacts, changes of efforts, phases, internal errors, and the outcome of the run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import Any, ClassVar, Protocol

from ffsm_mj.records.kinds import RecordKind
from ffsm_mj.records.record import ByName, ControllerReport, Meaning, Values, declared, record


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
    OVERRUN = "overrun"
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
    Outcome.OVERRUN: "the run fell behind real time",
    Outcome.INTERRUPTED: "the run was interrupted",
}


class RunEnded(Exception):
    """The run ends early; carries its outcome."""

    def __init__(self, outcome: Outcome, message: str = "") -> None:
        self.outcome, self.message = outcome, message or outcome.sentence
        super().__init__(self.message)


EVENT = Meaning("Event number, counted from 0 over all contact models but impacts; what changes together shares it.")
STEP = Meaning("Index of the integration step, from 0.", column=False)
QPOS = Meaning("Configuration, in the order of the sample's ``q_`` fields.")
QVEL = Meaning("Generalised velocity, by joint.")
QVEL_UNCHANGED = Meaning("Equal to ``qvel_before``.")
QVEL_KEPT = Meaning("Generalised velocity after, by joint; equal to ``qvel_before`` up to rounding.")
EFFORTS_KEPT = Meaning("Effort by actuator at the event; the controller is not evaluated.")
QVEL_BEFORE = Meaning("Generalised velocity before, by joint.")
QVEL_AFTER = Meaning("Generalised velocity after, by joint.")
ENERGY_BEFORE = Meaning("Kinetic energy before, by subsystem: total, robot, objects.", entries={"total": 1})
ENERGY_AFTER = Meaning("Kinetic energy after, by subsystem.", entries={"total": 1})

IMPACT_EVENT = Meaning("Number of the impact, from 0; contacts of geoms and joint limits at one instant share it.")
ANCHOR = Meaning("Anchor of the joint in world axes.", components="xyz")
AXIS = Meaning("Unit vector along the joint's axis in world axes, in the sense of the force or impulse.", components="xyz")
SIDE = Meaning("``lower`` or ``upper`` limit.")
LIMIT = Meaning("Value of the limit, rad or m.")
GEOMS = Meaning("Geoms a and b of the pair; the normal points from a to b.", components="ab")
THETA = Meaning("Factor by which the energy guard reduced the restitution; 1 if it was not needed.")
MOMENTUM_BEFORE = Meaning(
    "P and L about the world origin before, six numbers, in N s and N m s, of the total.", entries={"total": 6}
)
MOMENTUM_AFTER = Meaning("P and L about the world origin after.", entries={"total": 6})
ENERGY_CHANGE = Meaning("Change of the total kinetic energy.")
LINEAR_CHANGE = Meaning("Norm of the change of the total linear momentum: rounding, or impulses of fixed bodies.")
ANGULAR_CHANGE = Meaning("Norm of the change of the total angular momentum about the world origin; likewise.")


@record
class ImpactRecord:
    """One contact of an impact; contacts at one instant share ``event`` and the states before and after."""

    event: int = declared(IMPACT_EVENT)
    time_s: float = declared("Time of the impact.")
    step: int = declared(STEP)
    pair: str = declared("Name of the pair of geoms.")
    geoms: tuple[str, ...] = declared(GEOMS)
    robot_geom: str = declared("Geom a if it is of the robot and b of an object, floating or fixed; else empty.")
    object_geom: str = declared("Geom b if it is of an object, floating or fixed, and a of the robot; else empty.")
    point_m: Values = declared(
        "Contact point, the midpoint of the witness points, in world axes.",
        components="xyz",
        column_after="dropped_flights_s",
    )
    normal: Values = declared("Unit normal in world axes, from a to b.", components="xyz", column_after="point_m")
    manifold: str = declared("``point``, ``edge`` or ``face``.")
    law: str = declared(
        "Impact law of the result; with friction ``stronge`` or ``compliant`` (one contact), ``coulomb`` or ``poisson`` "
        "(several)."
    )
    status: str = declared(
        "``ok``; ``energy_guard``: restitution reduced by ``theta`` to prevent a gain of energy; ``jammed``: bodies "
        "squeezed without clearance, no elastic solution exists and energy was lost; ``wedged``: one self-locking contact."
    )
    restitution: float = declared("Coefficient of restitution of the pair.")
    restitution_used: float = declared(
        "Coefficient of restitution that was applied: 0 if the contact comes to rest and becomes persistent."
    )
    dropped_gap_m: float = declared(
        "If the contact comes to rest, the greatest gap of the bounces that were skipped; else 0."
    )
    dropped_flights_s: float = declared(
        "Total duration of the skipped bounces, by which the contact rests too early; else 0."
    )
    approach_speed_m_s: float = declared("Speed of approach along the normal before the impact.")
    separation_speed_m_s: float = declared("Speed of separation along the normal after the impact.")
    impulse_N_s: float = declared("Normal impulse on b.")
    angular_impulse_N_m_s: Values = declared(
        "Moment of the impulse on b, friction included, in world axes, about the centre of mass of the robot or object that "
        "b belongs to, or about the origin of its model's frame if that is fixed.",
        components="xyz",
    )
    mu: float = declared("Coefficient of friction of the pair.")
    normal_work_J: float = declared(
        "Work of the normal impulse; for one contact the integral of its speed over its impulse."
    )
    gap_m: float = declared("Signed distance of the geoms at the event; zero within the tolerance of the root finder.")
    qpos: Values = declared("Configuration, unchanged by the impact, in the order of the sample's ``q_`` fields.")
    qvel_before: ByName = declared(QVEL_BEFORE)
    qvel_after: ByName = declared(QVEL_AFTER)
    energy_before_J: ByName = declared(ENERGY_BEFORE)
    energy_after_J: ByName = declared(ENERGY_AFTER)
    momentum_before: ByName = declared(MOMENTUM_BEFORE)
    momentum_after: ByName = declared(MOMENTUM_AFTER)
    energy_change_J: float = declared(ENERGY_CHANGE)
    linear_momentum_change_N_s: float = declared(LINEAR_CHANGE)
    angular_momentum_change_N_m_s: float = declared(ANGULAR_CHANGE)
    theta: float = declared(THETA, column_after="status", default=1.0)
    tangential_impulse_N_s: Values = declared(
        "Friction impulse on b in world axes, tangential. Without friction it is zero, as are ``slip_before_m_s``, "
        "``slip_after_m_s``, ``friction_work_J`` and ``compression_work_J``; ``path`` is empty.",
        components="xyz",
        column_after="mu",
        default=(0.0, 0.0, 0.0),
    )
    slip_before_m_s: Values = declared(
        "Tangential velocity of b relative to a at the point before the impact, in world axes; not computed "
        "(zero) if no contact of the impact has friction.",
        components="xyz",
        column_after="tangential_impulse_N_s",
        default=(0.0, 0.0, 0.0),
    )
    slip_after_m_s: Values = declared(
        "Tangential velocity after the impact, likewise.",
        components="xyz",
        column_after="slip_before_m_s",
        default=(0.0, 0.0, 0.0),
    )
    path: str = declared(
        "Contact modes in order: ``slip``, ``stick``, ``reverse slip``; empty without friction.",
        column_after="slip_after_m_s",
        default="",
    )
    friction_work_J: float = declared(
        "Work of friction; <= 0 for one contact. For several, its split from normal work is a convention.",
        column_after="normal_work_J",
        default=0.0,
    )
    compression_work_J: float = declared(
        "Work of the normal impulse until the end of compression, <= 0 for one contact with friction.",
        column_after="friction_work_J",
        default=0.0,
    )
    compliance_ratio: float = declared(
        "Tangential over normal compliance of the pair, k_n / k_t, for laws that use it; 0: rigid across the normal.",
        column_after="compression_work_J",
        default=0.0,
    )
    rule: str = declared("Name of the contact rule of the pair.", column_after="pair", default="")
    efforts_after: ByName = declared(
        "Effort by actuator from the impact on, as the controller decided then; efforts are off during it.",
        default_factory=dict,
    )


def impact_count(impacts: Sequence[ImpactRecord]) -> int:
    """Number of impacts: contacts at one instant are one impact."""
    return len({record.event for record in impacts})


@record
class PhaseRecord:
    """A phase begins."""

    index: int = declared("Position of the phase in the scenario, from 0.")
    name: str = declared("Name of the phase.")
    controller: str = declared("Kind of its controller.")
    start_s: float = declared("Time at which it begins.")
    reason: str = declared(
        "Why it begins: ``start``, ``time``, ``settled``, ``finished``, or the kind of record that ended the previous phase."
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
    step: int = declared("Integration step in which it was raised, from 0.")
    error: str = declared("Type and text of the exception, on one line.")
    where: str = declared("File, line and function that raised it.")
    traceback: str = declared("Python's traceback, with paths relative to where packages are installed.")


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


def _phase(record: PhaseRecord) -> dict[str, Any]:
    return {"name": record.name, "start_s": record.start_s, "controller": record.controller}


PHASE = RecordKind(
    record=PhaseRecord,
    name="phase",
    plural="phases",
    when="when a phase begins",
    time=lambda record: record.start_s,
    sentence=lambda record: f"phase {record.name} ({record.controller}) begins: {record.reason}",
    summary=_phase,
    state=lambda record: record.name,
    in_every_run=True,
)

INTERNAL_ERROR = RecordKind(
    record=InternalErrorRecord,
    name="internal_error",
    plural="internal_errors",
    when="when an exception in ffsm-mj or a plug-in ends the run",
    sentence=lambda record: f"internal error: {record.error} ({record.where})",
    summarised=False,  # outcome and message of the summary say the same
    warning=lambda _: True,
    in_every_run=True,
)

OUTCOME = RecordKind(
    record=OutcomeRecord,
    name="outcome",
    plural="",
    when="once, at the end; a log without it is incomplete",
    time=lambda record: record.end_s,
    sentence=lambda record: f"{record.outcome}: {record.message}" if record.message else record.outcome,
    warning=lambda record: record.outcome != Outcome.COMPLETED,
    in_every_run=True,
)


@record
class EffortChange:
    """Efforts change between control ticks; velocities do not."""

    time_s: float = declared("Simulation time.")
    step: int = declared("Index of the integration step, from 0.")
    cause: str = declared(
        "``command arrives`` after its delay, or ``late tick``: the control law was called late.",
    )
    qpos: Values = declared(QPOS)
    qvel_before: ByName = declared(QVEL)
    qvel_after: ByName = declared(QVEL_UNCHANGED)
    efforts_after: ByName = declared("Effort by actuator from now on.", default_factory=dict)


EFFORT_CHANGE = RecordKind(
    record=EffortChange,
    name="effort_change",
    plural="effort_changes",
    when="when efforts change between control ticks",
    sentence=lambda record: record.cause,
    summarised=False,
    series="effort_change",
)
