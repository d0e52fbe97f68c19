"""Kinds of the event records of grasps: their columns, sentences and marks."""

from __future__ import annotations

import math
from typing import Any

from ffsm_mj.contact_models.grasp.record import ArmingRecord, CaptureRecord, NearMissRecord, ReleaseRecord
from ffsm_mj.records.kinds import Mark, RecordKind, all_fields
from ffsm_mj.records.load_columns import load_arrows

NEARLY_SINGULAR = 1e-6
"""Ratio of the smallest singular value that counts to the largest below which a mechanism is nearly singular."""


def _captured(record: CaptureRecord) -> str:
    impulse, moment = math.hypot(*record.impulse_N_s), math.hypot(*record.angular_impulse_N_m_s)
    sites = f"{record.robot_site} on {record.object_site}"
    sites += "" if record.joint == "rigid" else f" by a {record.joint} joint"
    sites += f" instead of {record.replaces}" if record.replaces else ""
    if record.place > 1:
        sites += f", a further grasp of rank {record.rank}, mobility {record.mobility}"
    effect = f"impulse {impulse:.5g} N s and {moment:.5g} N m s, loss {record.loss_J:.5g} J"
    singular = f"; nearly singular: least singular value {record.least_ratio:.1e}" if _singular(record) else ""
    return f"capture {record.grasp}: {sites}, {effect}{singular}"


def _singular(record: CaptureRecord) -> bool:
    """Whether the mechanism is so near a singular configuration that the loads of its grasps are large."""
    return record.least_ratio < NEARLY_SINGULAR


def _capture_marks(record: CaptureRecord) -> list[Mark]:
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
    unit = _SITES[name][0]
    return f"{_SHORT[name]} {getattr(record, name):.4g} {unit}, bound {record.bounds[name][0]:.4g} {unit}"


def _of_near_miss(record: NearMissRecord) -> dict[str, Any]:
    return {name: value for name, value in all_fields(record).items() if name in NEAR_MISS.columns}


_GRASP = {
    "event": ("", "event number, counted over grasps and persistent contacts from 0"),
    "grasp": ("", "name of the grasp"),
}
_SITES = {
    "position_m": ("m", "distance of the sites"),
    "angle_rad": ("rad", "angle between their frames"),
    "speed_m_s": ("m/s", "relative speed of the two bodies at the object's site"),
    "rate_rad_s": ("rad/s", "relative angular speed"),
}
_SHORT = {
    "position_m": "distance",
    "angle_rad": "angle",
    "speed_m_s": "relative speed",
    "rate_rad_s": "relative angular speed",
}

CAPTURE = RecordKind(
    record=CaptureRecord,
    name="capture",
    plural="capture_impulses",
    when="when a grasp closes on its object",
    time=lambda record: record.time_s,
    sentence=_captured,
    summarised=False,  # the summary lists grasp intervals instead
    columns={
        "time_s": ("s", "simulation time"),
        **_GRASP,
        "robot_site": ("", "site of the robot"),
        "object_site": ("", "site of the object"),
        "point_{xyz}_m": ("m", "the object's site, world frame"),
        **_SITES,
        "joint": ("", "relative motion that the latch leaves free: rigid (none), ball, hinge, slide, cylindrical"),
        "axis_{xyz}": ("", "unit vector of its axis in the frame of the robot's site; zeros without an axis"),
        "axis_angle_rad": ("rad", "angle between this axis and the same axis of the object's site"),
        "replaces": ("", "name of the closed grasp of the same two sites that ends with this one; empty if there is none"),
        "place": ("", "place in the order in which the closed grasps closed, from 1"),
        "rank": ("", "number of relative motions that were possible before and that the latch stops"),
        "mobility": ("", "degrees of freedom that are left, with all closed grasps"),
        "least_ratio": ("", "smallest singular value that counts over the largest, of the rows that the impulse stops"),
        "impulse_{xyz}_N_s": ("N s", "impulse on the object, world frame"),
        "angular_impulse_{xyz}_N_m_s": ("N m s", "angular impulse on the object about the object's site, world frame"),
        "loss_J": ("J", "kinetic energy lost, from the formula of the plastic impulse"),
        "energy_change_J": ("J", "kinetic energy gained by the whole system, from the two states"),
        "linear_momentum_change_N_s": ("N s", "norm of the change of the whole system's linear momentum"),
        "angular_momentum_change_N_m_s": ("N m s", "norm of the change of its angular momentum about the origin"),
    },
    lengths={
        "point_m": 3,
        "axis": 3,
        "impulse_N_s": 3,
        "angular_impulse_N_m_s": 3,
        "held_position_m": 3,
        "held_quaternion": 4,
        "energy_before_J.total": 1,
        "energy_after_J.total": 1,
        "momentum_before.total": 6,
        "momentum_after.total": 6,
    },
    marks=_capture_marks,
    warning=_singular,
    arrows=load_arrows,
)

RELEASE = RecordKind(
    record=ReleaseRecord,
    name="release",
    plural="releases",
    when="when a grasp releases its object",
    time=lambda record: record.time_s,
    sentence=_released,
    summarised=False,
    columns={
        "time_s": ("s", "simulation time"),
        **_GRASP,
        "point_{xyz}_m": ("m", "the object's site, world frame"),
        "reason": ("", "request or load_limit"),
        "force_N": ("N", "force on the object right before, if a limit is reached; 0 for a request"),
        "torque_N_m": ("N m", "torque on the object about its site right before, likewise"),
    },
    lengths={"point_m": 3},
    marks=lambda record: [Mark(record.point_m, text=f"{record.grasp} releases", name=record.grasp)],
)

NEAR_MISS = RecordKind(
    record=NearMissRecord,
    name="near_miss",
    plural="near_misses",
    when="when a grasp is disarmed without ever satisfying its bounds",
    time=lambda record: record.time_s,
    sentence=_missed,
    summary=_of_near_miss,
    columns={
        "time_s": ("s", "time of disarming"),
        **_GRASP,
        "least_ratio": ("", "minimum while armed of the largest ratio of a value to its bound"),
        "least_s": ("s", "time of that minimum; of minima that are equal to rounding, of the first"),
        **{name: (unit, f"{meaning} at that time") for name, (unit, meaning) in _SITES.items()},
        "failed": ("", "name of the value with the largest ratio to its bound at that time"),
        "failed_value": ("", "that value, in the unit of its name"),
        "failed_bound": ("", "its bound, in the unit of its name"),
    },
    warning=lambda _: True,
)

ARMING = RecordKind(
    record=ArmingRecord,
    name="arming",
    plural="armings",
    when="when a grasp is armed",
    time=lambda record: record.time_s,
    sentence=lambda record: f"arming {record.grasp}",
    summarised=False,
    columns={"time_s": ("s", "simulation time"), **_GRASP},
)

KINDS = (CAPTURE, RELEASE, NEAR_MISS, ARMING)
