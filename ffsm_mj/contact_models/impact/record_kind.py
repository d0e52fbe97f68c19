"""Record kind of impacts: how logs, tables, reports and viewers present each contact."""

from __future__ import annotations

import math
from typing import Any

from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.records.kinds import Mark, RecordKind, all_fields, field_of
from ffsm_mj.records.record import ByName, columns_of, table_order


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


def summary_of(record: Any) -> dict[str, Any]:
    """Entry of an impact in a summary: the columns of its table but the gap, and the velocities by joint."""
    rates = {name: _by_joint(getattr(record, name)) for name in ("qvel_before", "qvel_after")}
    cls: type = type(record)
    values, shown = all_fields(record) | rates, {field_of(column)[0] for column in columns_of(cls)} - {"gap", "gap_m"}
    return {name: values[name] for name in table_order(cls) if name in rates or name in shown}


def _by_joint(qvel: ByName) -> dict[str, float | list[float]]:
    """Generalised velocities by joint: a number for a joint with one degree of freedom."""
    return {joint: v[0] if len(v) == 1 else list(v) for joint, v in qvel.items()}


def _summary(record: ImpactRecord) -> dict[str, Any]:
    """The place of the contact comes before the solution, the geoms of robot and object if there are such."""
    found = summary_of(record)
    first = ("event", "time_s", "pair", "rule", "geoms", "robot_geom", "object_geom", "point_m", "normal")
    without = () if record.robot_geom else ("robot_geom", "object_geom")
    return {name: found[name] for name in (*first, *found) if name not in without}


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
    own_numbers=True,
    event_group="impact",
)
