"""Event records of grasps: arming, capture, release and near miss."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class CaptureRecord:
    """A grasp closes on its object.

    Attributes:
        event: Event number, counted over grasps and persistent contacts from 0.
        grasp: Name of the grasp.
        time_s: Time of the capture.
        step: Index of the integration step, from 0.
        robot_site: Site of the robot.
        object_site: Site of the object.
        point_m: Position of the object's site, world axes.
        position_m: Distance of the sites.
        angle_rad: Angle between their frames.
        speed_m_s: Relative speed of the two bodies at the object's site, before.
        rate_rad_s: Relative angular speed, before.
        joint: Relative motion that the latch leaves free: ``rigid`` (none), ``ball``, ``hinge``, ``slide``, ``cylindrical``.
        axis: Unit vector of its axis in the frame of the robot's site; zeros for kinds without one.
        axis_angle_rad: Angle between this axis and the same axis of the object's site; 0 for kinds without one.
        replaces: Name of the closed grasp of the same two sites that ends with this one; empty if there is none.
        place: Its place in the order in which the closed grasps closed, from 1. The object of the first one of the robot is
            attached as a child body of the link; further ones are held by rows.
        held_position_m: Origin of the object's base in the frame of the grasping link: of an attached object where the
            latch's joints are at 0, of a further grasp at its closing.
        held_quaternion: Orientation of the object's base in that frame, w, x, y, z; likewise.
        rank: Number of relative motions that were possible before and that the latch stops: a rigid one 3 in a plane, 6 in
            space, fewer where it closes a loop that cannot move so.
        mobility: Degrees of freedom that are left, with all closed grasps.
        least_ratio: Smallest singular value that counts over the largest, of the rows that the impulse stops; a small one
            says that the mechanism is nearly singular.
        impulse_N_s: Impulse on the object, world axes.
        angular_impulse_N_m_s: Angular impulse on the object about the object's site, world axes.
        loss_J: Kinetic energy lost, from the formula of the plastic impulse.
        energy_before_J: Kinetic energy before, by subsystem: total, robot, objects.
        energy_after_J: Kinetic energy after, by subsystem.
        momentum_before: Total P and L about the world origin before, six numbers, in N s and N m s.
        momentum_after: The same after.
        energy_change_J: Kinetic energy after minus before, computed from the two states.
        linear_momentum_change_N_s: Norm of the change of total linear momentum: zero up to rounding.
        angular_momentum_change_N_m_s: Norm of the change of total angular momentum about the world origin; likewise.
        qpos: Configuration, the same before and after, in the order of the sample's ``q_`` fields.
        qvel_before: Generalised velocity before, by joint.
        qvel_after: Generalised velocity after, by joint.
        efforts_after: Effort by actuator after the capture, set by the controller at that time.
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
    joint: str
    axis: tuple[float, ...]
    axis_angle_rad: float
    replaces: str
    place: int
    held_position_m: tuple[float, ...]
    held_quaternion: tuple[float, ...]
    rank: int
    mobility: int
    least_ratio: float
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
    """A grasp releases its object, on request or because its load limit is reached; no velocity changes.

    Attributes:
        event: Event number, counted over grasps and persistent contacts from 0.
        grasp: Name of the grasp.
        time_s: Time of the release.
        step: Index of the integration step, from 0.
        point_m: Position of the object's site, world axes.
        reason: ``request`` or ``load_limit``.
        force_N: Force on the object right before, if its limit is reached; 0 for a request.
        torque_N_m: Torque on the object about its site right before, likewise.
        qpos: Configuration, the same before and after, in the order of the sample's ``q_`` fields.
        qvel_before: Generalised velocity before, by joint.
        qvel_after: Generalised velocity after, by joint.
        efforts_after: Effort by actuator after the release, set by the controller at that time.
    """

    event: int
    grasp: str
    time_s: float
    step: int
    point_m: tuple[float, ...]
    reason: str
    force_N: float
    torque_N_m: float
    qpos: tuple[float, ...]
    qvel_before: Mapping[str, tuple[float, ...]]
    qvel_after: Mapping[str, tuple[float, ...]]
    efforts_after: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class ArmingRecord:
    """A grasp is armed: it may close from now on.

    Attributes:
        event: Event number, counted over grasps and persistent contacts from 0.
        grasp: Name of the grasp.
        time_s: Time of arming.
        step: Index of the integration step, from 0.
        qpos: Configuration, in the order of the sample's ``q_`` fields.
        qvel_before: Generalised velocity, by joint.
        qvel_after: Equal to ``qvel_before``.
        efforts_after: Effort by actuator after the event.
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
    """A grasp is disarmed without ever having satisfied its bounds.

    Attributes:
        event: Event number, counted over grasps and persistent contacts from 0.
        grasp: Name of the grasp.
        time_s: Time of disarming.
        step: Index of the integration step, from 0.
        least_ratio: Minimum over the armed time, within steps too, of the largest ratio of a value to its bound.
        least_s: Time of that minimum; of minima that are equal to rounding, of the first.
        position_m: Distance of the sites at that time.
        angle_rad: Angle between their frames at that time.
        speed_m_s: Relative speed at the object's site at that time.
        rate_rad_s: Relative angular speed at that time.
        bounds: Bounds of the grasp, by the name of the bounded value.
        failed: Name of the value with the largest ratio to its bound at that time.
        failed_value: That value, in the unit of its name.
        failed_bound: Its bound.
        qpos: Configuration when it was disarmed, in the order of the sample's ``q_`` fields.
        qvel_before: Generalised velocity at that time, by joint.
        qvel_after: Equal to ``qvel_before``.
        efforts_after: Effort by actuator after the event.
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
