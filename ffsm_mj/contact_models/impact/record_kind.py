"""Record kind of impacts: how logs, tables, reports and viewers present each contact."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.records.kinds import Mark, RecordKind


def _sentence(record: ImpactRecord) -> str:
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
    if size == 0.0:
        return [normal]
    along = tuple(x / size for x in record.tangential_impulse_N_s)
    return [normal, Mark(record.point_m, along, size, f"{size:.4g} N s friction", record.pair)]


def _summary(record: ImpactRecord) -> dict[str, Any]:
    return {
        "event": record.event,
        "time_s": record.time_s,
        "pair": record.pair,
        "rule": record.rule,
        "geoms": list(record.geoms),
        **({"robot_geom": record.robot_geom, "object_geom": record.object_geom} if record.robot_geom else {}),
        "point_m": list(record.point_m),
        "normal": list(record.normal),
        "manifold": record.manifold,
        "law": record.law,
        "status": record.status,
        "theta": record.theta,
        "restitution": record.restitution,
        "restitution_used": record.restitution_used,
        "dropped_gap_m": record.dropped_gap_m,
        "dropped_flights_s": record.dropped_flights_s,
        "approach_speed_m_s": record.approach_speed_m_s,
        "separation_speed_m_s": record.separation_speed_m_s,
        "impulse_N_s": record.impulse_N_s,
        "angular_impulse_N_m_s": list(record.angular_impulse_N_m_s),
        "mu": record.mu,
        "tangential_impulse_N_s": list(record.tangential_impulse_N_s),
        "slip_before_m_s": list(record.slip_before_m_s),
        "slip_after_m_s": list(record.slip_after_m_s),
        "path": record.path,
        "normal_work_J": record.normal_work_J,
        "friction_work_J": record.friction_work_J,
        "compression_work_J": record.compression_work_J,
        "qvel_before": by_joint(record.qvel_before),
        "qvel_after": by_joint(record.qvel_after),
        "energy_change_J": record.energy_change_J,
        "linear_momentum_change_N_s": record.linear_momentum_change_N_s,
        "angular_momentum_change_N_m_s": record.angular_momentum_change_N_m_s,
    }


def by_joint(qvel: Mapping[str, tuple[float, ...]]) -> dict[str, float | list[float]]:
    """Generalised velocities by joint for a summary: a number for a joint with one degree of freedom."""
    return {joint: v[0] if len(v) == 1 else list(v) for joint, v in qvel.items()}


_COLUMNS = {
    "time_s": ("s", "simulation time"),
    "event": ("", "number of the impact, from 0; contacts at one instant share it"),
    "pair": ("", "name of the pair of geoms that touch"),
    "rule": ("", "name of its contact rule"),
    "geoms_{ab}": ("", "geom of the pair; the normal points from a to b"),
    "robot_geom": ("", "geom a if the robot touches an object, else empty"),
    "object_geom": ("", "geom b if the robot touches an object, else empty"),
    "manifold": ("", "point, edge or face"),
    "law": ("", "impact law that gave the result"),
    "status": ("", "status of the solution: ok, energy_guard, jammed or wedged"),
    "theta": ("", "factor by which the energy guard reduced the restitution; 1 if it was not needed"),
    "restitution": ("", "coefficient of restitution of the pair"),
    "restitution_used": ("", "coefficient of restitution that was used: 0 if the contact comes to rest"),
    "dropped_gap_m": ("m", "if the contact comes to rest: highest gap of the omitted flights"),
    "dropped_flights_s": ("s", "total duration of the omitted flights"),
    "point_{xyz}_m": ("m", "contact point, world frame"),
    "normal_{xyz}": ("", "normal from a to b, world frame"),
    "approach_speed_m_s": ("m/s", "approach speed along the normal before the impact"),
    "separation_speed_m_s": ("m/s", "separation speed along the normal after the impact"),
    "impulse_N_s": ("N s", "impulse on b along the normal"),
    "angular_impulse_{xyz}_N_m_s": (
        "N m s",
        "angular impulse on b, with friction, about the centre of mass of its robot or object; if fixed, its model's origin",
    ),
    "mu": ("", "coefficient of friction of the pair"),
    "tangential_impulse_{xyz}_N_s": ("N s", "friction impulse on b, world frame"),
    "slip_before_{xyz}_m_s": ("m/s", "tangential velocity of b relative to a before, world frame; zero without friction"),
    "slip_after_{xyz}_m_s": ("m/s", "tangential velocity of b relative to a after, world frame; zero without friction"),
    "path": ("", "sequence of slip, stick and reverse slip during the impact"),
    "normal_work_J": ("J", "work of the normal impulse"),
    "friction_work_J": ("J", "work of the friction impulse"),
    "compression_work_J": ("J", "work of the normal impulse until the end of compression; contacts with friction only"),
    "gap_m": ("m", "signed distance at the event"),
    "energy_change_J": ("J", "kinetic energy gained by the whole system"),
    "linear_momentum_change_N_s": ("N s", "norm of the change of the whole system's linear momentum"),
    "angular_momentum_change_N_m_s": ("N m s", "norm of the change of the whole system's angular momentum about the origin"),
}

IMPACT = RecordKind(
    record=ImpactRecord,
    name="impact",
    plural="impacts",
    when="at every impact, one per contact point",
    time=lambda record: record.time_s,
    sentence=_sentence,
    summary=_summary,
    columns=_COLUMNS,
    lengths={
        "geoms": 2,
        "point_m": 3,
        "normal": 3,
        "angular_impulse_N_m_s": 3,
        "tangential_impulse_N_s": 3,
        "slip_before_m_s": 3,
        "slip_after_m_s": 3,
        "energy_before_J.total": 1,
        "energy_after_J.total": 1,
        "momentum_before.total": 6,
        "momentum_after.total": 6,
    },
    marks=_marks,
    warning=_warns,
    in_every_run=True,
    own_numbers=True,
    event_group="impact",
)
