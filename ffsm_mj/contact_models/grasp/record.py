"""What the log says of captures: that an object is held from here on, that it is let go, that an armed grasp missed it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ffsm_mj.records.kinds import Mark, RecordKind, all_fields


@dataclass(frozen=True)
class CaptureRecord:
    """A grasp holds its object from here on.

    Attributes:
        event: Number of what happened to grasps and to lasting contacts, from 0.
        grasp: Name of the grasp.
        time_s: Instant of the capture.
        step: Integration step in which it happened, from 0.
        robot_site: Site of the robot.
        object_site: Site of the object.
        point_m: Where the object's site is, world axes.
        position_m: Distance of the sites.
        angle_rad: Angle between their frames.
        speed_m_s: Relative speed of the two bodies at the object's site, before.
        rate_rad_s: Relative angular speed, before.
        held_position_m: Origin of the object's base in the frame of the link that holds it, from here on.
        held_quaternion: Its attitude there, w, x, y, z.
        rank: Number of relative motions that the joints leave, all of which are stopped: 3 in a plane, 6 in space.
        impulse_N_s: Impulse on the object, world axes.
        angular_impulse_N_m_s: Its moment on the object about the object's site, world axes.
        loss_J: Kinetic energy lost, by the formula of the plastic impulse.
        energy_before_J: Kinetic energy before, by subsystem: total, robot, objects.
        energy_after_J: Kinetic energy after, by subsystem.
        momentum_before: P and L about the world origin before, six numbers, in N s and N m s, of the total.
        momentum_after: The same after.
        energy_change_J: Kinetic energy after less that before, as measured.
        linear_momentum_change_N_s: Norm of the change of the total linear momentum: rounding.
        angular_momentum_change_N_m_s: Norm of the change of the total angular momentum about the world origin; likewise.
        qpos: Configuration, the same before and after, in the order of the sample's ``q_`` fields.
        qvel_before: Generalised velocity before, by joint.
        qvel_after: Generalised velocity after, by joint.
        efforts_after: Effort by actuator from here on, as the controller decided at the capture.
    """

    event: int
    grasp: str
    time_s: float
    step: int
    robot_site: str
    object_site: str
    point_m: tuple[float, ...]
    position_m: float
    angle_rad: float
    speed_m_s: float
    rate_rad_s: float
    held_position_m: tuple[float, ...]
    held_quaternion: tuple[float, ...]
    rank: int
    impulse_N_s: tuple[float, ...]
    angular_impulse_N_m_s: tuple[float, ...]
    loss_J: float
    energy_before_J: Mapping[str, tuple[float, ...]]
    energy_after_J: Mapping[str, tuple[float, ...]]
    momentum_before: Mapping[str, tuple[float, ...]]
    momentum_after: Mapping[str, tuple[float, ...]]
    energy_change_J: float
    linear_momentum_change_N_s: float
    angular_momentum_change_N_m_s: float
    qpos: tuple[float, ...]
    qvel_before: Mapping[str, tuple[float, ...]]
    qvel_after: Mapping[str, tuple[float, ...]]
    efforts_after: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class ReleaseRecord:
    """A grasp lets its object go; no velocity changes.

    Attributes:
        event: Number of what happened to grasps and to lasting contacts, from 0.
        grasp: Name of the grasp.
        time_s: Instant of the release.
        step: Integration step in which it happened, from 0.
        point_m: Where the object's site is, world axes.
        qpos: Configuration, the same before and after, in the order of the sample's ``q_`` fields.
        qvel_before: Generalised velocity before, by joint.
        qvel_after: Generalised velocity after, by joint.
        efforts_after: Effort by actuator from here on, as the controller decided at the release.
    """

    event: int
    grasp: str
    time_s: float
    step: int
    point_m: tuple[float, ...]
    qpos: tuple[float, ...]
    qvel_before: Mapping[str, tuple[float, ...]]
    qvel_after: Mapping[str, tuple[float, ...]]
    efforts_after: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class ArmingRecord:
    """A grasp may close from here on.

    Attributes:
        event: Number of what happened to grasps and to lasting contacts, from 0.
        grasp: Name of the grasp.
        time_s: When it is armed.
        step: Integration step in which that is, from 0.
        qpos: Configuration then, in the order of the sample's ``q_`` fields.
        qvel_before: Generalised velocity then, by joint.
        qvel_after: The same.
        efforts_after: Effort by actuator from here on.
    """

    event: int
    grasp: str
    time_s: float
    step: int
    qpos: tuple[float, ...]
    qvel_before: Mapping[str, tuple[float, ...]]
    qvel_after: Mapping[str, tuple[float, ...]]
    efforts_after: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class NearMissRecord:
    """A grasp is armed no more, and its bounds have never held.

    Attributes:
        event: Number of what happened to grasps and to lasting contacts, from 0.
        grasp: Name of the grasp.
        time_s: When it was disarmed.
        step: Integration step in which that was, from 0.
        least_ratio: Least of the largest value over its bound while it was armed, inside steps too.
        least_s: When that was.
        position_m: Distance of the sites then.
        angle_rad: Angle between their frames then.
        speed_m_s: Relative speed at the object's site then.
        rate_rad_s: Relative angular speed then.
        bounds: Bounds of the grasp by the name of the value that they bound.
        failed: Name of the value that was furthest beyond its bound then, over that bound.
        failed_value: That value, in the unit of its name.
        failed_bound: Its bound.
        qpos: Configuration when it was disarmed, in the order of the sample's ``q_`` fields.
        qvel_before: Generalised velocity then, by joint.
        qvel_after: The same.
        efforts_after: Effort by actuator from here on.
    """

    event: int
    grasp: str
    time_s: float
    step: int
    least_ratio: float
    least_s: float
    position_m: float
    angle_rad: float
    speed_m_s: float
    rate_rad_s: float
    bounds: Mapping[str, tuple[float, ...]]
    failed: str
    failed_value: float
    failed_bound: float
    qpos: tuple[float, ...]
    qvel_before: Mapping[str, tuple[float, ...]]
    qvel_after: Mapping[str, tuple[float, ...]]
    efforts_after: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


def _captured(record: CaptureRecord) -> str:
    impulse, moment = math.hypot(*record.impulse_N_s), math.hypot(*record.angular_impulse_N_m_s)
    sites = f"{record.robot_site} takes hold at {record.object_site}"
    return f"{impulse:.5g} N s and {moment:.5g} N m s, {sites}, {record.loss_J:.5g} J lost: capture by {record.grasp}"


def _capture_marks(record: CaptureRecord) -> list[Mark]:
    size = math.hypot(*record.impulse_N_s)
    along = tuple(x / size for x in record.impulse_N_s) if size else (0.0, 0.0, 0.0)
    return [Mark(record.point_m, along, size, f"{record.grasp}: {size:.4g} N s", record.grasp)]


def _missed(record: NearMissRecord) -> str:
    """The values beyond their bounds where all were nearest to them, the worst first."""
    beyond = [(getattr(record, name) / bound, name) for name, (bound,) in record.bounds.items()]
    failed = [f"{_beyond(record, name)} ({ratio:.4g} times)" for ratio, name in sorted(beyond, reverse=True) if ratio > 1.0]
    return f"{record.grasp} missed: {'; '.join(failed)}; nearest at t = {record.least_s:.6g} s"


def _beyond(record: NearMissRecord, name: str) -> str:
    unit = _SITES[name][0]
    return f"{_SHORT[name]} {getattr(record, name):.4g} {unit}, bound {record.bounds[name][0]:.4g} {unit}"


def _of_near_miss(record: NearMissRecord) -> dict[str, Any]:
    return {name: value for name, value in all_fields(record).items() if name in NEAR_MISS.columns}


_GRASP = {
    "event": ("", "number of what happened to grasps and to lasting contacts, from 0"),
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
    when="when a grasp takes hold of its object",
    time=lambda record: record.time_s,
    sentence=_captured,
    summarised=False,  # a capture is summed up with its release
    columns={
        "time_s": ("s", "simulation time"),
        **_GRASP,
        "robot_site": ("", "site of the robot"),
        "object_site": ("", "site of the object"),
        "point_{xyz}_m": ("m", "the object's site, world frame"),
        **_SITES,
        "rank": ("", "relative motions that the joints leave"),
        "impulse_{xyz}_N_s": ("N s", "impulse on the object, world frame"),
        "angular_impulse_{xyz}_N_m_s": ("N m s", "its moment on the object about the object's site, world frame"),
        "loss_J": ("J", "kinetic energy lost, by the formula"),
        "energy_change_J": ("J", "kinetic energy gained by the whole system, as measured"),
        "linear_momentum_change_N_s": ("N s", "norm of the change of the whole system's linear momentum"),
        "angular_momentum_change_N_m_s": ("N m s", "norm of the change of its angular momentum about the origin"),
    },
    lengths={
        "point_m": 3,
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
)

RELEASE = RecordKind(
    record=ReleaseRecord,
    name="release",
    plural="releases",
    when="when a grasp lets its object go",
    time=lambda record: record.time_s,
    sentence=lambda record: f"{record.grasp} lets go",
    summarised=False,
    columns={
        "time_s": ("s", "simulation time"),
        **_GRASP,
        "point_{xyz}_m": ("m", "the object's site, world frame"),
    },
    lengths={"point_m": 3},
    marks=lambda record: [Mark(record.point_m, text=f"{record.grasp} lets go", name=record.grasp)],
)

NEAR_MISS = RecordKind(
    record=NearMissRecord,
    name="near_miss",
    plural="near_misses",
    when="when a grasp is disarmed whose bounds have never held",
    time=lambda record: record.time_s,
    sentence=_missed,
    summary=_of_near_miss,
    columns={
        "time_s": ("s", "when it is disarmed"),
        **_GRASP,
        "least_ratio": ("", "least of the largest value over its bound while it was armed"),
        "least_s": ("s", "when that was"),
        **{name: (unit, f"{meaning} then") for name, (unit, meaning) in _SITES.items()},
        "failed": ("", "name of the value that was furthest beyond its bound then, over that bound"),
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
    sentence=lambda record: f"{record.grasp} may close",
    summarised=False,
    columns={"time_s": ("s", "simulation time"), **_GRASP},
)

KINDS = (CAPTURE, RELEASE, NEAR_MISS, ARMING)
