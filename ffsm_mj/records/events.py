"""Event records: impacts, phases, unhandled contacts, and the outcome of the run."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Any, ClassVar, Protocol

from ffsm_mj.records.record import ByName, Meaning, Values, logged, record

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

    event: int = logged(
        "Number of the impact, from 0.", column="number of the impact, from 0; contacts at one instant share it"
    )
    time_s: float = logged("Time of the impact.", column="simulation time")
    step: int = logged(IMPACT_STEP)
    pair: str = logged("Name of the pair of geoms.", column="name of the pair of geoms that touch")
    geoms: tuple[str, ...] = logged(
        "Geoms a and b.", column="geom of the pair; the normal points from a to b", components="ab"
    )
    robot_geom: str = logged(
        "Geom a if it is of the robot and b of an object, floating or fixed; else empty.",
        column="geom a if the robot touches an object, else empty",
    )
    object_geom: str = logged(
        "Geom b if it is of an object, floating or fixed, and a of the robot; else empty.",
        column="geom b if the robot touches an object, else empty",
    )
    point_m: Values = logged(
        "Contact point, the midpoint of the witness points, in world axes.",
        column="contact point, world frame",
        components="xyz",
        after="dropped_flights_s",
    )
    normal: Values = logged(
        "Unit normal in world axes, from a to b.",
        column="normal from a to b, world frame",
        components="xyz",
        after="point_m",
    )
    manifold: str = logged("``point``, ``edge`` or ``face``.")
    law: str = logged(
        "Impact law of the result; with friction ``stronge`` (one contact), ``coulomb`` or ``poisson`` (several).",
        column="impact law that gave the result",
    )
    status: str = logged(
        "``ok``; ``energy_guard``: restitution reduced by ``theta`` to prevent a gain of energy; ``jammed``: bodies "
        "squeezed without clearance, no elastic solution exists and energy was lost; ``wedged``: one self-locking contact.",
        column="status of the solution: ok, energy_guard, jammed or wedged",
    )
    restitution: float = logged("Coefficient of restitution of the pair.")
    restitution_used: float = logged(
        "Coefficient that was applied: 0 if the contact comes to rest and becomes persistent.",
        column="coefficient of restitution that was used: 0 if the contact comes to rest",
    )
    dropped_gap_m: float = logged(
        "If the contact comes to rest, the greatest gap of the bounces that were skipped; else 0.",
        column="if the contact comes to rest: highest gap of the omitted flights",
    )
    dropped_flights_s: float = logged(
        "Total duration of the skipped bounces, by which the contact rests too early; else 0.",
        column="total duration of the omitted flights",
    )
    approach_speed_m_s: float = logged(
        "Speed of approach along the normal before the impact.", column="approach speed along the normal before the impact"
    )
    separation_speed_m_s: float = logged(
        "Speed of separation along the normal after the impact.", column="separation speed along the normal after the impact"
    )
    impulse_N_s: float = logged("Normal impulse on b.", column="impulse on b along the normal")
    angular_impulse_N_m_s: Values = logged(
        "Its moment in world axes about the centre of mass of the robot or object that b belongs to, or about the"
        " origin of its model's frame if that is fixed.",
        column="angular impulse on b, with friction, about the centre of mass of its robot or object; if fixed, its "
        "model's origin",
        components="xyz",
    )
    mu: float = logged("Coefficient of friction of the pair.")
    normal_work_J: float = logged(
        "Work of the normal impulse; for one contact the integral of its speed over its impulse.",
        column="work of the normal impulse",
    )
    gap_m: float = logged(
        "Distance of the geoms at the event; zero within the tolerance of the root finder.",
        column="signed distance at the event",
    )
    qpos: Values = logged("Configuration, unchanged by the impact, in the order of the sample's ``q_`` fields.")
    qvel_before: ByName = logged(QVEL_BEFORE)
    qvel_after: ByName = logged(QVEL_AFTER)
    energy_before_J: ByName = logged(ENERGY_BEFORE)
    energy_after_J: ByName = logged(ENERGY_AFTER)
    momentum_before: ByName = logged(MOMENTUM_BEFORE)
    momentum_after: ByName = logged(MOMENTUM_AFTER)
    energy_change_J: float = logged(
        "Change of the total kinetic energy.", column="kinetic energy gained by the whole system"
    )
    linear_momentum_change_N_s: float = logged(
        "Norm of the change of the total linear momentum: rounding, or impulses of fixed bodies.",
        column="norm of the change of the whole system's linear momentum",
    )
    angular_momentum_change_N_m_s: float = logged(
        "Norm of the change of the total angular momentum about the world origin; likewise.",
        column="norm of the change of the whole system's angular momentum about the origin",
    )
    theta: float = logged(THETA, after="status", default=1.0)
    tangential_impulse_N_s: Values = logged(
        "Friction impulse on b in world axes, tangential. Without friction it is zero, as are all fields below "
        "except the normal work, which is then that of the impulse alone.",
        column="friction impulse on b, world frame",
        components="xyz",
        after="mu",
        default=(0.0, 0.0, 0.0),
    )
    slip_before_m_s: Values = logged(
        "Tangential velocity of b relative to a at the point before the impact, in world axes; not computed "
        "(zero) if no contact of the impact has friction.",
        column="tangential velocity of b relative to a before, world frame; zero without friction",
        components="xyz",
        after="tangential_impulse_N_s",
        default=(0.0, 0.0, 0.0),
    )
    slip_after_m_s: Values = logged(
        "Tangential velocity after the impact.",
        column="tangential velocity of b relative to a after, world frame; zero without friction",
        components="xyz",
        after="slip_before_m_s",
        default=(0.0, 0.0, 0.0),
    )
    path: str = logged(
        "Contact modes in order: ``slip``, ``stick``, ``reverse slip``; empty without friction.",
        column="sequence of slip, stick and reverse slip during the impact",
        after="slip_after_m_s",
        default="",
    )
    friction_work_J: float = logged(
        "Work of friction; <= 0 for one contact. For several, its split from normal work is a convention.",
        column="work of the friction impulse",
        after="normal_work_J",
        default=0.0,
    )
    compression_work_J: float = logged(
        "Work of the normal impulse until the end of compression, <= 0 for one contact with friction.",
        column="work of the normal impulse until the end of compression; contacts with friction only",
        after="friction_work_J",
        default=0.0,
    )
    rule: str = logged("Name of the contact rule of the pair.", column="name of its contact rule", after="pair", default="")
    efforts_after: ByName = logged(
        "Effort by actuator from the impact on, as the controller decided then; efforts are off during it.",
        default_factory=dict,
    )


@record
class PhaseRecord:
    """A phase begins."""

    index: int = logged("Position of the phase in the scenario, from 0.", column="position in the scenario, from 0")
    name: str = logged("Name of the phase.")
    controller: str = logged("Kind of its controller.")
    start_s: float = logged("Time at which it begins.", column="when it begins")
    reason: str = logged(
        "``start``, ``time``, ``settled``, ``finished``, or the record that ended the previous phase, e.g. ``impact``.",
        column="why it begins",
    )


@record
class UnhandledContactRecord:
    """Overlap of two geoms that are neither of a contact rule nor ignored; no contact force acted."""

    geoms: tuple[str, ...] = logged("The two geoms.", components="ab")
    start_s: float = logged("First step at which they overlapped.")
    end_s: float = logged("Last step at which they overlapped.")
    max_depth_m: float = logged("Greatest depth of the overlap.")


@record
class InternalErrorRecord:
    """An exception that ended the run: a bug of ffsm-mj or of a plug-in, not a property of the motion."""

    time_s: float = logged("Simulation time at the last event or step end before it.")
    step: int = logged("Integration step in which it was raised, from 0.", column="integration step, from 0")
    error: str = logged("Type and text of the exception, on one line.", column="type and text of the exception")
    where: str = logged("File, line and function that raised it.")
    traceback: str = logged(
        "Python's traceback, with paths relative to where packages are installed.", column="Python's traceback"
    )


@record
class OutcomeRecord:
    """Outcome of the run, and its computational cost."""

    outcome: str = logged("One of the outcomes, ``completed`` for a regular end.")
    message: str = logged("Details of the outcome.")
    end_s: float = logged("Simulation time at the end.")
    steps: int = logged("Integration steps of the grid, those of ``time_step_s``.")
    wall_s: float = logged("Wall time of the simulation; 0 if SOURCE_DATE_EPOCH is set.")
    controller_ticks: int = logged("Number of control ticks.")
    reports: Mapping[str, ControllerReport] = logged(
        "Reports of the control laws by phase, for all phases that began; JSON in the log.", default_factory=dict
    )
    versions: Mapping[str, str] = logged("Versions of the packages that affect results.", default_factory=dict)
    sub_steps: int = logged("Number of integration steps with ``accuracy``; 0 without.", default=0)
    smallest_step_s: float = logged("Shortest integration step with ``accuracy``; 0 without.", default=0.0)
    law_wall_s: float = logged(
        "Wall time of all calls of control laws and estimator; 0 if SOURCE_DATE_EPOCH is set.", default=0.0
    )


class Event(Protocol):
    """A record of a registered kind other than the outcome: a frozen dataclass; see :mod:`.kinds`."""

    __dataclass_fields__: ClassVar[dict[str, Any]]
