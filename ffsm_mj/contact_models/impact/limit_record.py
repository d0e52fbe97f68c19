"""Event record of an impact at a joint limit, and how logs, tables, reports and viewers present it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ffsm_mj.contact_models.impact.record_kind import by_joint
from ffsm_mj.records.kinds import Mark, RecordKind


@dataclass(frozen=True)
class LimitImpactRecord:
    """A joint hits a limit; it shares ``event`` and the states with all contacts and limits of the same impact.

    Attributes:
        event: Number of the impact, from 0, counted with those of geoms.
        time_s: Time of the impact.
        step: Integration step of the impact, from 0.
        joint: Full name of the joint.
        side: ``lower`` or ``upper``.
        unit: Unit of the coordinate: ``rad`` (impulse in N m s, rates in rad/s) or ``m`` (impulse in N s, rates in m/s).
        value: Coordinate of the joint at the event.
        limit: Value of the limit.
        law: Impact law of the result.
        status: Status of the solution: ``ok``, ``energy_guard``, ``jammed`` or ``wedged``, as for contacts.
        theta: Factor on the restitution applied by the energy guard; 1 if it was not needed.
        restitution: Coefficient of restitution of the joint's limits.
        restitution_used: Coefficient that was applied: 0 if the joint comes to rest at the limit.
        dropped_gap: If the joint comes to rest, the greatest gap of the bounces that were skipped; else 0.
        dropped_flights_s: Total duration of the skipped bounces; else 0.
        approach_rate: Rate towards the limit before the impact.
        separation_rate: Rate away from the limit after the impact.
        impulse: Impulse on the joint, away from the limit, >= 0.
        work_J: Work of the impulse.
        gap: Distance from the limit at the event; zero within the tolerance of the root finder.
        point_m: Anchor of the joint in world axes.
        axis: Unit vector along the joint's axis in world axes, in the sense of the impulse.
        qpos: Configuration, unchanged by the impact.
        qvel_before: Generalised velocity before, by joint.
        qvel_after: Generalised velocity after, by joint.
        energy_before_J: Kinetic energy before, by subsystem: total, robot, objects.
        energy_after_J: Kinetic energy after, by subsystem.
        momentum_before: P and L about the world origin before, six numbers, in N s and N m s, of the total.
        momentum_after: P and L about the world origin after.
        energy_change_J: Change of the total kinetic energy in the impact.
        linear_momentum_change_N_s: Norm of the change of the total linear momentum.
        angular_momentum_change_N_m_s: Norm of the change of the total angular momentum about the world origin.
        efforts_after: Effort by actuator from the impact on.
    """

    event: int
    time_s: float
    step: int
    joint: str
    side: str
    unit: str
    value: float
    limit: float
    law: str
    status: str
    theta: float
    restitution: float
    restitution_used: float
    dropped_gap: float
    dropped_flights_s: float
    approach_rate: float
    separation_rate: float
    impulse: float
    work_J: float
    gap: float
    point_m: tuple[float, ...]
    axis: tuple[float, ...]
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
    efforts_after: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


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
        f"e = {record.restitution:g}, approach {max(record.approach_rate, 0.0):.4g} {record.unit}/s, {after}{status}"
    )


def _marks(record: LimitImpactRecord) -> list[Mark]:
    name = f"{record.joint} {record.side} limit"
    return [Mark(record.point_m, record.axis, record.impulse, _impulse(record), name)]


_LISTED = (
    *("event", "time_s", "joint", "side", "unit", "value", "limit", "law", "status", "theta", "restitution"),
    *("restitution_used", "dropped_gap", "dropped_flights_s", "approach_rate", "separation_rate", "impulse", "work_J"),
)


def _summary(record: LimitImpactRecord) -> dict[str, Any]:
    return {
        **{name: getattr(record, name) for name in _LISTED},
        "point_m": list(record.point_m),
        "axis": list(record.axis),
        "qvel_before": by_joint(record.qvel_before),
        "qvel_after": by_joint(record.qvel_after),
        "energy_change_J": record.energy_change_J,
        "linear_momentum_change_N_s": record.linear_momentum_change_N_s,
        "angular_momentum_change_N_m_s": record.angular_momentum_change_N_m_s,
    }


_COLUMNS = {
    "time_s": ("s", "simulation time"),
    "event": ("", "number of the impact, from 0; contacts and limits at one instant share it"),
    "joint": ("", "full name of the joint"),
    "side": ("", "lower or upper limit"),
    "unit": ("", "unit of the joint's coordinate, rad or m: rates are per second, the impulse is in N m s or N s"),
    "value": ("", "coordinate at the event, rad or m"),
    "limit": ("", "value of the limit, rad or m"),
    "law": ("", "impact law that gave the result"),
    "status": ("", "status of the solution: ok, energy_guard, jammed or wedged"),
    "theta": ("", "factor by which the energy guard reduced the restitution; 1 if it was not needed"),
    "restitution": ("", "coefficient of restitution of the joint's limits"),
    "restitution_used": ("", "coefficient of restitution that was used: 0 if the joint comes to rest"),
    "dropped_gap": ("", "if the joint comes to rest: highest gap of the omitted flights, rad or m"),
    "dropped_flights_s": ("s", "total duration of the omitted flights"),
    "approach_rate": ("", "rate towards the limit before the impact, rad/s or m/s"),
    "separation_rate": ("", "rate away from the limit after the impact, rad/s or m/s"),
    "impulse": ("", "impulse on the joint, away from the limit, N m s or N s"),
    "work_J": ("J", "work of the impulse"),
    "gap": ("", "distance from the limit at the event, rad or m"),
    "point_{xyz}_m": ("m", "anchor of the joint, world frame"),
    "axis_{xyz}": ("", "axis of the joint in the sense of the impulse, world frame"),
    "energy_change_J": ("J", "kinetic energy gained by the whole system in the impact"),
    "linear_momentum_change_N_s": ("N s", "norm of the change of the whole system's linear momentum"),
    "angular_momentum_change_N_m_s": ("N m s", "norm of the change of the whole system's angular momentum about the origin"),
}

LIMIT_IMPACT = RecordKind(
    record=LimitImpactRecord,
    name="limit_impact",
    plural="limit_impacts",
    when="when a joint hits a limit",
    time=lambda record: record.time_s,
    sentence=_sentence,
    summary=_summary,
    columns=_COLUMNS,
    lengths={
        "point_m": 3,
        "axis": 3,
        "energy_before_J.total": 1,
        "energy_after_J.total": 1,
        "momentum_before.total": 6,
        "momentum_after.total": 6,
    },
    marks=_marks,
    warning=lambda record: record.status in ("energy_guard", "jammed"),
    own_numbers=True,
    event_group="impact",
)
