"""Event record of an impact at a joint limit, and how logs, tables, reports and viewers present it."""

from __future__ import annotations

from ffsm_mj.contact_models.impact.record_kind import summary_of
from ffsm_mj.records.events import (
    ENERGY_AFTER,
    ENERGY_BEFORE,
    IMPACT_STEP,
    MOMENTUM_AFTER,
    MOMENTUM_BEFORE,
    QVEL_AFTER,
    QVEL_BEFORE,
    THETA,
)
from ffsm_mj.records.kinds import Mark, RecordKind
from ffsm_mj.records.record import ByName, Values, declared, record


@record
class LimitImpactRecord:
    """A joint hits a limit; it shares ``event`` and the states with all contacts and limits of the same impact."""

    event: int = declared(
        "Number of the impact, from 0, counted with those of geoms.",
        column="number of the impact, from 0; contacts and limits at one instant share it",
    )
    time_s: float = declared("Time of the impact.", column="simulation time")
    step: int = declared(IMPACT_STEP)
    joint: str = declared("Full name of the joint.")
    side: str = declared("``lower`` or ``upper``.", column="lower or upper limit")
    unit: str = declared(
        "Unit of the coordinate: ``rad`` (impulse in N m s, rates in rad/s) or ``m`` (impulse in N s, rates in m/s).",
        column="unit of the joint's coordinate, rad or m: rates are per second, the impulse is in N m s or N s",
    )
    value: float = declared("Coordinate of the joint at the event.", column="coordinate at the event, rad or m")
    limit: float = declared("Value of the limit.", column="value of the limit, rad or m")
    law: str = declared("Impact law of the result.", column="impact law that gave the result")
    status: str = declared(
        "Status of the solution: ``ok``, ``energy_guard``, ``jammed`` or ``wedged``, as for contacts.",
        column="status of the solution: ok, energy_guard, jammed or wedged",
    )
    theta: float = declared(THETA)
    restitution: float = declared("Coefficient of restitution of the joint's limits.")
    restitution_used: float = declared(
        "Coefficient that was applied: 0 if the joint comes to rest at the limit.",
        column="coefficient of restitution that was used: 0 if the joint comes to rest",
    )
    dropped_gap: float = declared(
        "If the joint comes to rest, the greatest gap of the bounces that were skipped; else 0.",
        column="if the joint comes to rest: highest gap of the omitted flights, rad or m",
    )
    dropped_flights_s: float = declared(
        "Total duration of the skipped bounces; else 0.", column="total duration of the omitted flights"
    )
    approach_rate: float = declared(
        "Rate towards the limit before the impact.", column="rate towards the limit before the impact, rad/s or m/s"
    )
    separation_rate: float = declared(
        "Rate away from the limit after the impact.", column="rate away from the limit after the impact, rad/s or m/s"
    )
    impulse: float = declared(
        "Impulse on the joint, away from the limit, >= 0.", column="impulse on the joint, away from the limit, N m s or N s"
    )
    work_J: float = declared("Work of the impulse.")
    gap: float = declared(
        "Distance from the limit at the event; zero within the tolerance of the root finder.",
        column="distance from the limit at the event, rad or m",
    )
    point_m: Values = declared(
        "Anchor of the joint in world axes.", column="anchor of the joint, world frame", components="xyz"
    )
    axis: Values = declared(
        "Unit vector along the joint's axis in world axes, in the sense of the impulse.",
        column="axis of the joint in the sense of the impulse, world frame",
        components="xyz",
    )
    qpos: Values = declared("Configuration, unchanged by the impact.")
    qvel_before: ByName = declared(QVEL_BEFORE)
    qvel_after: ByName = declared(QVEL_AFTER)
    energy_before_J: ByName = declared(ENERGY_BEFORE)
    energy_after_J: ByName = declared(ENERGY_AFTER)
    momentum_before: ByName = declared(MOMENTUM_BEFORE)
    momentum_after: ByName = declared(MOMENTUM_AFTER)
    energy_change_J: float = declared(
        "Change of the total kinetic energy in the impact.", column="kinetic energy gained by the whole system in the impact"
    )
    linear_momentum_change_N_s: float = declared(
        "Norm of the change of the total linear momentum.", column="norm of the change of the whole system's linear momentum"
    )
    angular_momentum_change_N_m_s: float = declared(
        "Norm of the change of the total angular momentum about the world origin.",
        column="norm of the change of the whole system's angular momentum about the origin",
    )
    efforts_after: ByName = declared("Effort by actuator from the impact on.", default_factory=dict)


def force_unit(unit: str) -> str:
    """Unit of the generalised force of a joint with coordinates in ``rad`` or ``m``."""
    return "N m" if unit == "rad" else "N"


def _impulse(record: LimitImpactRecord) -> str:
    return f"{record.impulse:.5g} {force_unit(record.unit)} s"


def _sentence(record: LimitImpactRecord) -> str:
    rests = record.restitution_used == 0.0
    after = "comes to rest" if rests else f"separation {record.separation_rate:.4g} {record.unit}/s"
    status = "" if record.status == "ok" else f", {record.status.replace('_', ' ')}"
    return (
        f"joint {record.joint} hits its {record.side} limit of {record.limit:g} {record.unit}: impulse {_impulse(record)}, "
        f"e = {record.restitution:g}, approach {max(0.0, record.approach_rate):.4g} {record.unit}/s, {after}{status}"
    )


def _marks(record: LimitImpactRecord) -> list[Mark]:
    name = f"{record.joint} {record.side} limit"
    return [Mark(record.point_m, record.axis, record.impulse, _impulse(record), name)]


LIMIT_IMPACT = RecordKind(
    record=LimitImpactRecord,
    name="limit_impact",
    plural="limit_impacts",
    when="when a joint hits a limit",
    sentence=_sentence,
    summary=summary_of,
    marks=_marks,
    warning=lambda record: record.status in ("energy_guard", "jammed"),
    own_numbers=True,
    event_group="impact",
)
