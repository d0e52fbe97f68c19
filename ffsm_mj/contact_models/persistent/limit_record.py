"""Event records of joints at their limits: a joint comes to rest at a limit, leaves it, or starts to press on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ffsm_mj.contact_models.impact.limit_record import force_unit
from ffsm_mj.records.kinds import Mark, RecordKind


@dataclass(frozen=True)
class LimitRecord:
    """An event of a joint that rests at a limit.

    Attributes:
        event: Event number, counted over persistent contacts and grasps from 0; all that changes together shares it.
        time_s: Simulation time.
        step: Index of the integration step, from 0.
        joint: Full name of the joint.
        side: ``lower`` or ``upper``.
        unit: Unit of the coordinate: ``rad`` (forces are torques in N m) or ``m`` (forces in N).
        value: Coordinate of the joint.
        limit: Value of the limit.
        state: ``pressed``, ``touching`` without force, or ``free``, after the event.
        force_before: Force or torque of the limit on the joint just before, >= 0 away from the limit; 0 if there was none.
        force_after: The same just after, under the efforts up to the event.
        impulse: Time integral of the force of this joint's limits since t = 0, N s or N m s.
        point_m: Anchor of the joint in world axes.
        axis: Unit vector along the joint's axis in world axes, in the sense of the force.
        qpos: Configuration.
        qvel_before: Generalised velocity before, by joint.
        qvel_after: Generalised velocity after, by joint; equal to ``qvel_before`` up to rounding.
        efforts_after: Effort by actuator at the event; the controller is not evaluated.
    """

    event: int
    time_s: float
    step: int
    joint: str
    side: str
    unit: str
    value: float
    limit: float
    state: str
    force_before: float
    force_after: float
    impulse: float
    point_m: tuple[float, ...]
    axis: tuple[float, ...]
    qpos: tuple[float, ...]
    qvel_before: Mapping[str, tuple[float, ...]]
    qvel_after: Mapping[str, tuple[float, ...]]
    efforts_after: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class LimitBegins(LimitRecord):
    """A joint comes to rest at a limit; fields as in :class:`LimitRecord`."""


@dataclass(frozen=True)
class LimitEnds(LimitRecord):
    """A joint leaves its limit; fields as in :class:`LimitRecord`."""


@dataclass(frozen=True)
class LimitChanges(LimitRecord):
    """A joint at rest at a limit starts to press on it; fields as in :class:`LimitRecord`."""


def _force(record: Any) -> str:
    return f"{record.force_after:.4g} {force_unit(record.unit)}"


def _marks(record: Any) -> list[Mark]:
    name = f"{record.joint} {record.side} limit"
    if record.force_after == 0.0:
        return [Mark(record.point_m, text="leaves its limit" if record.state == "free" else "at its limit", name=name)]
    return [Mark(record.point_m, record.axis, record.force_after, _force(record), name)]


_COLUMNS = {
    "time_s": ("s", "simulation time"),
    "event": ("", "event number, counted over persistent contacts and grasps from 0"),
    "joint": ("", "full name of the joint"),
    "side": ("", "lower or upper limit"),
    "unit": ("", "unit of the joint's coordinate, rad or m: forces are torques in N m, or in N"),
    "value": ("", "coordinate at the event, rad or m"),
    "limit": ("", "value of the limit, rad or m"),
    "state": ("", "pressed, touching (without force) or free, after the event"),
    "force_before": ("", "force or torque of the limit just before, N or N m"),
    "force_after": ("", "force or torque of the limit just after, N or N m"),
    "impulse": ("", "integral of the force of this joint's limits since t = 0, N s or N m s"),
    "point_{xyz}_m": ("m", "anchor of the joint, world frame"),
    "axis_{xyz}": ("", "axis of the joint in the sense of the force, world frame"),
}


def _kind(record: type, name: str, plural: str, when: str, says: str) -> RecordKind:
    def sentence(record: Any) -> str:
        at = f"its {record.side} limit of {record.limit:g} {record.unit}"
        force = f"{record.force_before:.4g} {force_unit(record.unit)} before, {_force(record)} after"
        return f"joint {record.joint} {says} {at}: {force}"

    return RecordKind(
        record=record,
        name=name,
        plural=plural,
        when=when,
        time=lambda record: record.time_s,
        sentence=sentence,
        columns=_COLUMNS,
        lengths={"point_m": 3, "axis": 3},
        marks=_marks,
        event_group="contact",
    )


LIMIT_BEGINS = _kind(
    LimitBegins, "limit_begins", "limit_beginnings", "when a joint comes to rest at a limit", "comes to rest at"
)
LIMIT_ENDS = _kind(LimitEnds, "limit_ends", "limit_endings", "when it leaves the limit", "leaves")
LIMIT_CHANGES = _kind(
    LimitChanges, "limit_changes", "limit_changes", "when it starts to press on the limit", "starts to press on"
)
LIMIT_KINDS = (LIMIT_BEGINS, LIMIT_ENDS, LIMIT_CHANGES)
