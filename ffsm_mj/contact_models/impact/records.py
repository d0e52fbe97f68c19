"""Records of impacts, of contacts and at joint limits: how logs, tables, reports and viewers present them."""

from __future__ import annotations

import math
from typing import Any

from ffsm_mj.records.events import (
    ANCHOR,
    ANGULAR_CHANGE,
    AXIS,
    ENERGY_AFTER,
    ENERGY_BEFORE,
    ENERGY_CHANGE,
    IMPACT_EVENT,
    LIMIT,
    LINEAR_CHANGE,
    MOMENTUM_AFTER,
    MOMENTUM_BEFORE,
    QVEL_AFTER,
    QVEL_BEFORE,
    SIDE,
    STEP,
    THETA,
    ImpactRecord,
)
from ffsm_mj.records.kinds import Mark, RecordKind, all_fields, field_of
from ffsm_mj.records.record import ByName, Values, columns_of, declared, in_table_order, record


def _sentence(record: ImpactRecord) -> str:
    # With a stated e = 0 every contact ends plastically: only a rule that set e to zero is worth a word.
    rests = record.restitution_used == 0.0 < record.restitution
    after = "comes to rest" if rests else f"separation {record.separation_speed_m_s:.4g} m/s"
    speeds = f"e = {record.restitution:g}, approach {record.approach_speed_m_s:.4g} m/s, {after}"
    return f"impact {record.pair}: impulse {record.impulse_N_s:.5g} N s, {speeds}{_friction(record)}{_status(record)}"


def _friction(record: ImpactRecord) -> str:
    """Impulse and slip of a contact with friction; empty without friction."""
    if not record.mu:
        return ""
    size, before, after = map(_size, (record.tangential_impulse_N_s, record.slip_before_m_s, record.slip_after_m_s))
    path = f" ({record.path})" if record.path else ""
    return f", mu = {record.mu:g}, friction impulse {size:.4g} N s, slip {before:.4g} to {after:.4g} m/s{path}"


def _status(record: ImpactRecord) -> str:
    """Status of the solution; empty if it is ``ok``."""
    if record.status == "ok":
        return ""
    theta = f", restitution times theta = {record.theta:.6g}" if record.theta < 1.0 else ""
    return f", {record.status.replace('_', ' ')}{theta}"


def _warns(record: ImpactRecord) -> bool:
    return record.status in ("energy_guard", "jammed")


def _size(vector: tuple[float, ...]) -> float:
    return math.hypot(*vector)


def _marks(record: ImpactRecord) -> list[Mark]:
    normal = Mark(record.point_m, record.normal, record.impulse_N_s, f"{record.impulse_N_s:.4g} N s", record.pair)
    size = _size(record.tangential_impulse_N_s)
    # A contact without tangential impulse has no direction of one, and an arrow of no length cannot be drawn.
    if size == 0.0:
        return [normal]
    along = tuple(x / size for x in record.tangential_impulse_N_s)
    return [normal, Mark(record.point_m, along, size, f"{size:.4g} N s friction", record.pair)]


def summary_of(record: Any) -> dict[str, Any]:
    """Entry of an impact in a summary: the columns of its table but the gap, and the velocities by joint."""
    rates = {name: _by_joint(getattr(record, name)) for name in ("qvel_before", "qvel_after")}
    cls: type = type(record)
    values, shown = all_fields(record) | rates, {field_of(column)[0] for column in columns_of(cls)} - {"gap", "gap_m"}
    return {name: values[name] for name in in_table_order(cls) if name in rates or name in shown}


def _by_joint(qvel: ByName) -> dict[str, float | list[float]]:
    """Generalised velocities by joint: a number for a joint with one degree of freedom."""
    return {joint: v[0] if len(v) == 1 else list(v) for joint, v in qvel.items()}


def _summary(record: ImpactRecord) -> dict[str, Any]:
    """The place of the contact comes before the solution, the geoms of robot and object if there are such."""
    summary = summary_of(record)
    first = ("event", "time_s", "pair", "rule", "geoms", "robot_geom", "object_geom", "point_m", "normal")
    without = () if record.robot_geom else ("robot_geom", "object_geom")
    return {name: summary[name] for name in (*first, *summary) if name not in without}


IMPACT = RecordKind(
    record=ImpactRecord,
    name="impact",
    plural="impacts",
    when="at every impact, one per contact point",
    sentence=_sentence,
    summary=_summary,
    marks=_marks,
    warning=_warns,
    in_every_run=True,
    series="impact",
)


@record
class LimitImpactRecord:
    """A joint hits a limit; it shares ``event`` and the states with all contacts and limits of the same impact."""

    event: int = declared(IMPACT_EVENT)
    time_s: float = declared("Time of the impact.")
    step: int = declared(STEP)
    joint: str = declared("Full name of the joint.")
    side: str = declared(SIDE)
    unit: str = declared(
        "Unit of the coordinate: ``rad`` (impulse in N m s, rates in rad/s) or ``m`` (impulse in N s, rates in m/s)."
    )
    value: float = declared("Coordinate of the joint at the event, rad or m.")
    limit: float = declared(LIMIT)
    law: str = declared("Impact law of the result.")
    status: str = declared("Status of the solution: ``ok``, ``energy_guard``, ``jammed`` or ``wedged``, as for contacts.")
    theta: float = declared(THETA)
    restitution: float = declared("Coefficient of restitution of the joint's limits.")
    restitution_used: float = declared(
        "Coefficient of restitution that was applied: 0 if the joint comes to rest at the limit."
    )
    dropped_gap: float = declared(
        "If the joint comes to rest, the greatest gap of the bounces that were skipped, rad or m; else 0."
    )
    dropped_flights_s: float = declared("Total duration of the skipped bounces; else 0.")
    approach_rate: float = declared("Rate towards the limit before the impact, rad/s or m/s.")
    separation_rate: float = declared("Rate away from the limit after the impact, rad/s or m/s.")
    impulse: float = declared("Impulse on the joint, away from the limit, >= 0, N m s or N s.")
    work_J: float = declared("Work of the impulse.")
    gap: float = declared("Distance from the limit at the event, rad or m; zero within the tolerance of the root finder.")
    point_m: Values = declared(ANCHOR)
    axis: Values = declared(AXIS)
    qpos: Values = declared("Configuration, unchanged by the impact.")
    qvel_before: ByName = declared(QVEL_BEFORE)
    qvel_after: ByName = declared(QVEL_AFTER)
    energy_before_J: ByName = declared(ENERGY_BEFORE)
    energy_after_J: ByName = declared(ENERGY_AFTER)
    momentum_before: ByName = declared(MOMENTUM_BEFORE)
    momentum_after: ByName = declared(MOMENTUM_AFTER)
    energy_change_J: float = declared(ENERGY_CHANGE)
    linear_momentum_change_N_s: float = declared(LINEAR_CHANGE)
    angular_momentum_change_N_m_s: float = declared(ANGULAR_CHANGE)
    efforts_after: ByName = declared("Effort by actuator from the impact on.", default_factory=dict)


def force_unit(unit: str) -> str:
    """Unit of the generalised force of a joint with coordinates in ``rad`` or ``m``."""
    return "N m" if unit == "rad" else "N"


def _impulse(record: LimitImpactRecord) -> str:
    return f"{record.impulse:.5g} {force_unit(record.unit)} s"


def _limit_sentence(record: LimitImpactRecord) -> str:
    rests = record.restitution_used == 0.0
    after = "comes to rest" if rests else f"separation {record.separation_rate:.4g} {record.unit}/s"
    status = "" if record.status == "ok" else f", {record.status.replace('_', ' ')}"
    return (
        f"joint {record.joint} hits its {record.side} limit of {record.limit:g} {record.unit}: impulse {_impulse(record)}, "
        f"e = {record.restitution:g}, approach {max(0.0, record.approach_rate):.4g} {record.unit}/s, {after}{status}"
    )


def _limit_marks(record: LimitImpactRecord) -> list[Mark]:
    name = f"{record.joint} {record.side} limit"
    return [Mark(record.point_m, record.axis, record.impulse, _impulse(record), name)]


LIMIT_IMPACT = RecordKind(
    record=LimitImpactRecord,
    name="limit_impact",
    plural="limit_impacts",
    when="when a joint hits a limit",
    sentence=_limit_sentence,
    summary=summary_of,
    marks=_limit_marks,
    warning=lambda record: record.status in ("energy_guard", "jammed"),
    series="impact",
)
