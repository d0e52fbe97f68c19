"""Event records of grasps: arming, closing, release and near miss, with their sentences and marks."""

from __future__ import annotations

import math
from typing import Any

from ffsm_mj.records.events import (
    ANGULAR_CHANGE,
    ENERGY_AFTER,
    ENERGY_BEFORE,
    EVENT,
    LINEAR_CHANGE,
    MOMENTUM_AFTER,
    MOMENTUM_BEFORE,
    QPOS,
    QVEL,
    QVEL_AFTER,
    QVEL_BEFORE,
    QVEL_UNCHANGED,
    STEP,
)
from ffsm_mj.records.kinds import Mark, RecordKind, all_fields
from ffsm_mj.records.load_columns import load_arrows
from ffsm_mj.records.record import ByName, Meaning, Values, declared, record
from ffsm_mj.records.signals import unit_of

_GRASP = Meaning("Name of the grasp.")
_OBJECT_SITE = Meaning("Position of the object's site in world axes.", components="xyz")
_QPOS = Meaning("Configuration, the same before and after, in the order of the sample's ``q_`` fields.")
_EFFORTS = Meaning("Effort by actuator after the event.")


@record
class GraspRecord:
    """A grasp closes on its object."""

    event: int = declared(EVENT)
    grasp: str = declared(_GRASP)
    time_s: float = declared("Time of closing.")
    step: int = declared(STEP)
    robot_site: str = declared("Site of the robot.")
    object_site: str = declared("Site of the object.")
    point_m: Values = declared(_OBJECT_SITE)
    position_m: float = declared("Distance of the sites.")
    angle_rad: float = declared("Angle between their frames.")
    speed_m_s: float = declared("Relative speed of the two bodies at the object's site, before.")
    rate_rad_s: float = declared("Relative angular speed, before.")
    joint: str = declared(
        "Relative motion that the latch leaves free: ``rigid`` (none), ``ball``, ``hinge``, ``slide``, ``cylindrical``."
    )
    axis: Values = declared(
        "Unit vector of its axis in the frame of the robot's site; zeros for kinds without one.", components="xyz"
    )
    axis_angle_rad: float = declared(
        "Angle between this axis and the same axis of the object's site; 0 for kinds without one."
    )
    replaces: str = declared(
        "Name of the closed grasp of the same two sites that ends with this one; empty if there is none."
    )
    place: int = declared(
        "Its place in the order in which the closed grasps closed, from 1. The object of the first one of the "
        "robot is attached as a child body of the link; further ones are held by rows.",
    )
    object_position_m: Values = declared(
        "Origin of the object's base in the frame of the grasping link: of an attached object where the latch's "
        "joints are at 0, of a further grasp at its closing.",
        column=False,
        components="xyz",
    )
    object_quaternion: Values = declared(
        "Orientation of the object's base in that frame, w, x, y, z; likewise.", column=False, components="wxyz"
    )
    rank: int = declared(
        "Number of relative motions that were possible before and that the latch stops: a rigid one 3 in a plane,"
        " 6 in space, fewer where it closes a loop that cannot move so.",
    )
    mobility: int = declared("Degrees of freedom that are left, with all closed grasps.")
    least_ratio: float = declared(
        "Smallest singular value that counts over the largest, of the rows that the impulse stops; a small one "
        "says that the mechanism is nearly singular.",
    )
    impulse_N_s: Values = declared("Impulse on the object in world axes.", components="xyz")
    angular_impulse_N_m_s: Values = declared(
        "Angular impulse on the object about the object's site in world axes.", components="xyz"
    )
    loss_J: float = declared("Kinetic energy lost, from the formula of the plastic impulse.")
    energy_before_J: ByName = declared(ENERGY_BEFORE)
    energy_after_J: ByName = declared(ENERGY_AFTER)
    momentum_before: ByName = declared(MOMENTUM_BEFORE)
    momentum_after: ByName = declared(MOMENTUM_AFTER)
    energy_change_J: float = declared("Change of the total kinetic energy, computed from the two states.")
    linear_momentum_change_N_s: float = declared(LINEAR_CHANGE)
    angular_momentum_change_N_m_s: float = declared(ANGULAR_CHANGE)
    qpos: Values = declared(_QPOS)
    qvel_before: ByName = declared(QVEL_BEFORE)
    qvel_after: ByName = declared(QVEL_AFTER)
    efforts_after: ByName = declared(
        "Effort by actuator after closing, set by the controller at that time.", default_factory=dict
    )


@record
class ReleaseRecord:
    """A grasp releases its object, on request or because its load limit is reached; no velocity changes."""

    event: int = declared(EVENT)
    grasp: str = declared(_GRASP)
    time_s: float = declared("Time of the release.")
    step: int = declared(STEP)
    point_m: Values = declared(_OBJECT_SITE)
    reason: str = declared("``request`` or ``load_limit``.")
    force_N: float = declared("Force on the object right before, if a limit is reached; 0 for a request.")
    torque_N_m: float = declared("Torque on the object about its site right before, likewise.")
    qpos: Values = declared(_QPOS)
    qvel_before: ByName = declared(QVEL_BEFORE)
    qvel_after: ByName = declared(QVEL_AFTER)
    efforts_after: ByName = declared(
        "Effort by actuator after the release, set by the controller at that time.", default_factory=dict
    )


@record
class ArmingRecord:
    """A grasp is armed: it may close from now on."""

    event: int = declared(EVENT)
    grasp: str = declared(_GRASP)
    time_s: float = declared("Time of arming.")
    step: int = declared(STEP)
    qpos: Values = declared(QPOS)
    qvel_before: ByName = declared(QVEL)
    qvel_after: ByName = declared(QVEL_UNCHANGED)
    efforts_after: ByName = declared(_EFFORTS, default_factory=dict)


@record
class NearMissRecord:
    """A grasp is disarmed without ever having satisfied its bounds."""

    event: int = declared(EVENT)
    grasp: str = declared(_GRASP)
    time_s: float = declared("Time of disarming.")
    step: int = declared(STEP)
    least_ratio: float = declared(
        "Minimum over the armed time, within steps too, of the largest ratio of a value to its bound.",
    )
    least_s: float = declared("Time of that minimum; of minima that are equal to rounding, of the first.")
    position_m: float = declared("Distance of the sites at that time.")
    angle_rad: float = declared("Angle between their frames at that time.")
    speed_m_s: float = declared("Relative speed of the two bodies at the object's site at that time.")
    rate_rad_s: float = declared("Relative angular speed at that time.")
    bounds: ByName = declared("Bounds of the grasp, by the name of the bounded value.")
    failed: str = declared("Name of the value with the largest ratio to its bound at that time.")
    failed_value: float = declared("That value, in the unit of its name.")
    failed_bound: float = declared("Its bound, in the same unit.")
    qpos: Values = declared("Configuration when it was disarmed, in the order of the sample's ``q_`` fields.")
    qvel_before: ByName = declared("Generalised velocity at that time, by joint.")
    qvel_after: ByName = declared(QVEL_UNCHANGED)
    efforts_after: ByName = declared(_EFFORTS, default_factory=dict)


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
    return f"grasp {record.grasp!r} closes: {sites}, {effect}{singular}"


def _singular(record: GraspRecord) -> bool:
    """Whether the mechanism is so near a singular configuration that the loads of its grasps are large."""
    return record.least_ratio < NEARLY_SINGULAR


def _grasp_marks(record: GraspRecord) -> list[Mark]:
    size = math.hypot(*record.impulse_N_s)
    # Sites at rest to each other need no impulse: it has no direction then.
    along = tuple(x / size for x in record.impulse_N_s) if size else (0.0, 0.0, 0.0)
    return [Mark(record.point_m, along, size, f"{record.grasp}: {size:.4g} N s", record.grasp)]


def _released(record: ReleaseRecord) -> str:
    load = (
        f" at its load limit: {record.force_N:.5g} N and {record.torque_N_m:.5g} N m" if record.reason != "request" else ""
    )
    return f"release of {record.grasp!r}{load}"


def _missed(record: NearMissRecord) -> str:
    """The violated bounds at the closest approach, the worst first."""
    beyond = [(getattr(record, name) / bound, name) for name, (bound,) in record.bounds.items()]
    # A miss may exceed several bounds: all of them are named, as each kept the latch open.
    failed = [f"{_beyond(record, name)} ({ratio:.4g} times)" for ratio, name in sorted(beyond, reverse=True) if ratio > 1.0]
    return f"near miss of {record.grasp!r}: {'; '.join(failed)}; closest approach at t = {record.least_s:.6g} s"


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
    in_every_report=True,
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
    in_every_report=True,
    marks=lambda record: [Mark(record.point_m, text=f"{record.grasp} releases", name=record.grasp)],
)

NEAR_MISS = RecordKind(
    record=NearMissRecord,
    name="near_miss",
    plural="near_misses",
    when="when a grasp is disarmed without ever satisfying its bounds",
    sentence=_missed,
    summary=_of_near_miss,
    in_every_report=True,
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
