"""Event records of grasps: arming, capture, release and near miss."""

from __future__ import annotations

from ffsm_mj.records.events import (
    ENERGY_AFTER,
    ENERGY_BEFORE,
    QPOS,
    QVEL,
    QVEL_AFTER,
    QVEL_BEFORE,
    QVEL_UNCHANGED,
    STEP,
)
from ffsm_mj.records.record import ByName, Meaning, Values, logged, record

_EVENT = Meaning("Event number, counted over grasps and persistent contacts from 0.")
_GRASP = Meaning("Name of the grasp.")
_OBJECT_SITE = Meaning(
    "Position of the object's site, world axes.", column="the object's site, world frame", components="xyz"
)
_QPOS = Meaning("Configuration, the same before and after, in the order of the sample's ``q_`` fields.")
_EFFORTS = Meaning("Effort by actuator after the event.")


@record
class CaptureRecord:
    """A grasp closes on its object."""

    event: int = logged(_EVENT)
    grasp: str = logged(_GRASP)
    time_s: float = logged("Time of the capture.", column="simulation time")
    step: int = logged(STEP)
    robot_site: str = logged("Site of the robot.")
    object_site: str = logged("Site of the object.")
    point_m: Values = logged(_OBJECT_SITE)
    position_m: float = logged("Distance of the sites.")
    angle_rad: float = logged("Angle between their frames.")
    speed_m_s: float = logged(
        "Relative speed of the two bodies at the object's site, before.",
        column="relative speed of the two bodies at the object's site",
    )
    rate_rad_s: float = logged("Relative angular speed, before.", column="relative angular speed")
    joint: str = logged(
        "Relative motion that the latch leaves free: ``rigid`` (none), ``ball``, ``hinge``, ``slide``, ``cylindrical``."
    )
    axis: Values = logged(
        "Unit vector of its axis in the frame of the robot's site; zeros for kinds without one.",
        column="unit vector of its axis in the frame of the robot's site; zeros without an axis",
        components="xyz",
    )
    axis_angle_rad: float = logged(
        "Angle between this axis and the same axis of the object's site; 0 for kinds without one.",
        column="angle between this axis and the same axis of the object's site",
    )
    replaces: str = logged("Name of the closed grasp of the same two sites that ends with this one; empty if there is none.")
    place: int = logged(
        "Its place in the order in which the closed grasps closed, from 1. The object of the first one of the "
        "robot is attached as a child body of the link; further ones are held by rows.",
        column="place in the order in which the closed grasps closed, from 1",
    )
    held_position_m: Values = logged(
        "Origin of the object's base in the frame of the grasping link: of an attached object where the latch's "
        "joints are at 0, of a further grasp at its closing.",
        column=None,
        components="xyz",
    )
    held_quaternion: Values = logged(
        "Orientation of the object's base in that frame, w, x, y, z; likewise.", column=None, components="wxyz"
    )
    rank: int = logged(
        "Number of relative motions that were possible before and that the latch stops: a rigid one 3 in a plane,"
        " 6 in space, fewer where it closes a loop that cannot move so.",
        column="number of relative motions that were possible before and that the latch stops",
    )
    mobility: int = logged("Degrees of freedom that are left, with all closed grasps.")
    least_ratio: float = logged(
        "Smallest singular value that counts over the largest, of the rows that the impulse stops; a small one "
        "says that the mechanism is nearly singular.",
        column="smallest singular value that counts over the largest, of the rows that the impulse stops",
    )
    impulse_N_s: Values = logged(
        "Impulse on the object, world axes.", column="impulse on the object, world frame", components="xyz"
    )
    angular_impulse_N_m_s: Values = logged(
        "Angular impulse on the object about the object's site, world axes.",
        column="angular impulse on the object about the object's site, world frame",
        components="xyz",
    )
    loss_J: float = logged("Kinetic energy lost, from the formula of the plastic impulse.")
    energy_before_J: ByName = logged(ENERGY_BEFORE)
    energy_after_J: ByName = logged(ENERGY_AFTER)
    momentum_before: ByName = logged(
        "Total P and L about the world origin before, six numbers, in N s and N m s.", entries={"total": 6}
    )
    momentum_after: ByName = logged("The same after.", entries={"total": 6})
    energy_change_J: float = logged(
        "Kinetic energy after minus before, computed from the two states.",
        column="kinetic energy gained by the whole system, from the two states",
    )
    linear_momentum_change_N_s: float = logged(
        "Norm of the change of total linear momentum: zero up to rounding.",
        column="norm of the change of the whole system's linear momentum",
    )
    angular_momentum_change_N_m_s: float = logged(
        "Norm of the change of total angular momentum about the world origin; likewise.",
        column="norm of the change of its angular momentum about the origin",
    )
    qpos: Values = logged(_QPOS)
    qvel_before: ByName = logged(QVEL_BEFORE)
    qvel_after: ByName = logged(QVEL_AFTER)
    efforts_after: ByName = logged(
        "Effort by actuator after the capture, set by the controller at that time.", default_factory=dict
    )


@record
class ReleaseRecord:
    """A grasp releases its object, on request or because its load limit is reached; no velocity changes."""

    event: int = logged(_EVENT)
    grasp: str = logged(_GRASP)
    time_s: float = logged("Time of the release.", column="simulation time")
    step: int = logged(STEP)
    point_m: Values = logged(_OBJECT_SITE)
    reason: str = logged("``request`` or ``load_limit``.")
    force_N: float = logged(
        "Force on the object right before, if its limit is reached; 0 for a request.",
        column="force on the object right before, if a limit is reached; 0 for a request",
    )
    torque_N_m: float = logged("Torque on the object about its site right before, likewise.")
    qpos: Values = logged(_QPOS)
    qvel_before: ByName = logged(QVEL_BEFORE)
    qvel_after: ByName = logged(QVEL_AFTER)
    efforts_after: ByName = logged(
        "Effort by actuator after the release, set by the controller at that time.", default_factory=dict
    )


@record
class ArmingRecord:
    """A grasp is armed: it may close from now on."""

    event: int = logged(_EVENT)
    grasp: str = logged(_GRASP)
    time_s: float = logged("Time of arming.", column="simulation time")
    step: int = logged(STEP)
    qpos: Values = logged(QPOS)
    qvel_before: ByName = logged(QVEL)
    qvel_after: ByName = logged(QVEL_UNCHANGED)
    efforts_after: ByName = logged(_EFFORTS, default_factory=dict)


@record
class NearMissRecord:
    """A grasp is disarmed without ever having satisfied its bounds."""

    event: int = logged(_EVENT)
    grasp: str = logged(_GRASP)
    time_s: float = logged("Time of disarming.")
    step: int = logged(STEP)
    least_ratio: float = logged(
        "Minimum over the armed time, within steps too, of the largest ratio of a value to its bound.",
        column="minimum while armed of the largest ratio of a value to its bound",
    )
    least_s: float = logged("Time of that minimum; of minima that are equal to rounding, of the first.")
    position_m: float = logged("Distance of the sites at that time.")
    angle_rad: float = logged("Angle between their frames at that time.")
    speed_m_s: float = logged(
        "Relative speed at the object's site at that time.",
        column="relative speed of the two bodies at the object's site at that time",
    )
    rate_rad_s: float = logged("Relative angular speed at that time.")
    bounds: ByName = logged("Bounds of the grasp, by the name of the bounded value.")
    failed: str = logged("Name of the value with the largest ratio to its bound at that time.")
    failed_value: float = logged("That value, in the unit of its name.")
    failed_bound: float = logged("Its bound.", column="its bound, in the unit of its name")
    qpos: Values = logged("Configuration when it was disarmed, in the order of the sample's ``q_`` fields.")
    qvel_before: ByName = logged("Generalised velocity at that time, by joint.")
    qvel_after: ByName = logged(QVEL_UNCHANGED)
    efforts_after: ByName = logged(_EFFORTS, default_factory=dict)
