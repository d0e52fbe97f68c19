"""Kinds of the event records of grasps: their sentences and marks."""

from __future__ import annotations

import math
from typing import Any

from ffsm_mj.contact_models.grasp.record import ArmingRecord, GraspRecord, NearMissRecord, ReleaseRecord
from ffsm_mj.records.kinds import Mark, RecordKind, all_fields
from ffsm_mj.records.load_columns import load_arrows
from ffsm_mj.records.signals import unit_of

NEARLY_SINGULAR = 1e-6
"""Ratio of the smallest singular value that counts to the largest below which a mechanism is nearly singular."""


def _grasped(record: GraspRecord) -> str:
    impulse, moment = math.hypot(*record.impulse_N_s), math.hypot(*record.angular_impulse_N_m_s)
    sites = f"{record.robot_site} on {record.object_site}"
    sites += "" if record.joint == "rigid" else f" by a {record.joint} joint"
    sites += f" instead of {record.replaces}" if record.replaces else ""
    if record.place > 1:
        sites += f", a further grasp of rank {record.rank}, mobility {record.mobility}"
    effect = f"impulse {impulse:.5g} N s and {moment:.5g} N m s, loss {record.loss_J:.5g} J"
    singular = f"; nearly singular: least singular value {record.least_ratio:.1e}" if _singular(record) else ""
    return f"grasp {record.grasp} closes: {sites}, {effect}{singular}"


def _singular(record: GraspRecord) -> bool:
    """Whether the mechanism is so near a singular configuration that the loads of its grasps are large."""
    return record.least_ratio < NEARLY_SINGULAR


def _grasp_marks(record: GraspRecord) -> list[Mark]:
    size = math.hypot(*record.impulse_N_s)
    along = tuple(x / size for x in record.impulse_N_s) if size else (0.0, 0.0, 0.0)
    return [Mark(record.point_m, along, size, f"{record.grasp}: {size:.4g} N s", record.grasp)]


def _released(record: ReleaseRecord) -> str:
    load = (
        f" at its load limit: {record.force_N:.5g} N and {record.torque_N_m:.5g} N m" if record.reason != "request" else ""
    )
    return f"release {record.grasp}{load}"


def _missed(record: NearMissRecord) -> str:
    """The violated bounds at the closest approach, the worst first."""
    beyond = [(getattr(record, name) / bound, name) for name, (bound,) in record.bounds.items()]
    failed = [f"{_beyond(record, name)} ({ratio:.4g} times)" for ratio, name in sorted(beyond, reverse=True) if ratio > 1.0]
    return f"near miss {record.grasp}: {'; '.join(failed)}; closest approach at t = {record.least_s:.6g} s"


def _beyond(record: NearMissRecord, name: str) -> str:
    unit = unit_of(name)
    return f"{_SHORT[name]} {getattr(record, name):.4g} {unit}, bound {record.bounds[name][0]:.4g} {unit}"


def _of_near_miss(record: NearMissRecord) -> dict[str, Any]:
    return {name: value for name, value in all_fields(record).items() if name in NEAR_MISS.columns}


_SHORT = {
    "position_m": "distance",
    "angle_rad": "angle",
    "speed_m_s": "relative speed",
    "rate_rad_s": "relative angular speed",
}

GRASP = RecordKind(
    record=GraspRecord,
    name="grasp",
    plural="grasp_impulses",
    when="when a grasp closes on its object",
    sentence=_grasped,
    summarised=False,  # the summary lists grasp intervals instead
    marks=_grasp_marks,
    warning=_singular,
    arrows=load_arrows,
)

RELEASE = RecordKind(
    record=ReleaseRecord,
    name="release",
    plural="releases",
    when="when a grasp releases its object",
    sentence=_released,
    summarised=False,
    marks=lambda record: [Mark(record.point_m, text=f"{record.grasp} releases", name=record.grasp)],
)

NEAR_MISS = RecordKind(
    record=NearMissRecord,
    name="near_miss",
    plural="near_misses",
    when="when a grasp is disarmed without ever satisfying its bounds",
    sentence=_missed,
    summary=_of_near_miss,
    warning=lambda _: True,
)

ARMING = RecordKind(
    record=ArmingRecord,
    name="arming",
    plural="armings",
    when="when a grasp is armed",
    sentence=lambda record: f"arming {record.grasp}",
    summarised=False,
)

KINDS = (GRASP, RELEASE, NEAR_MISS, ARMING)
