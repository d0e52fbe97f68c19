"""What a scenario says of the law ``track``."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, PositiveFloat

from ffsm_controllers.base_control import Frame
from ffsm_controllers.pd import Gain
from ffsm_mj.controller_protocol import StrictModel

_Name = Annotated[str, Field(min_length=1)]


class PositionGains(StrictModel):
    """Feedback on the position of the robot's site against where it is to be."""

    kp_1_s2: Gain
    """Acceleration per distance, 1/s^2."""
    kd_1_s: PositiveFloat
    """Acceleration per relative velocity, 1/s; 2 sqrt(kp) damps critically."""
    max_speed_m_s: PositiveFloat | None = None
    """Relative speed that a distance asks for at most, m/s; left out: no bound, far away it is kp/kd times the distance."""


class AttitudeGains(StrictModel):
    """Feedback on the attitude of the robot's site against that of the object's."""

    kp_1_s2: Gain
    """Angular acceleration per angle, 1/s^2."""
    kd_1_s: PositiveFloat
    """Angular acceleration per relative angular velocity, 1/s; 2 sqrt(kp) damps critically."""
    max_rate_rad_s: PositiveFloat | None = None
    """Relative angular speed that an angle asks for at most, rad/s; left out: no bound."""


class TranslationGains(StrictModel):
    """Feedback on the base's position against that at the start of the phase."""

    kp_N_m: Gain
    """N/m; 0 only brings it to rest."""
    kd_N_s_m: Gain
    """N s/m."""


class RotationGains(StrictModel):
    """Feedback on the base's attitude against that at the start of the phase."""

    kp_N_m_rad: Gain
    """N m/rad; 0 only brings it to rest."""
    kd_N_m_s_rad: Gain
    """N m s/rad."""


class BaseConfig(StrictModel):
    """The base held by the actuators that are named; what they do to the site is known to the arm."""

    frame: Frame = "world"
    """Axes in which it is held: ``world``, or with an orbit ``lvlh``, which turn."""
    thrusters: tuple[_Name, ...] = ()
    """Actuators that push the base: body-fixed at sites, or ideal ones on base joints."""
    wheels: tuple[_Name, ...] = ()
    """Motors of reaction wheels, or an ideal one on a base hinge; without any the thrusters turn the base too."""
    translation: TranslationGains | None = None
    """Left out: the base's translation is not controlled."""
    rotation: RotationGains | None = None
    """Left out: the base's rotation is not controlled."""


class TrackConfig(StrictModel):
    """A site of the robot follows a site of an object: ydd = ydd_object - kd (yd - yd_object) - kp e."""

    kind: Literal["track"]
    object_site: _Name
    """Site to follow, of any object."""
    robot_site: _Name | None = None
    """Site that follows; left out: the task's tip."""
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where the robot's site is to be, in the frame of the object's site, m."""
    joints: tuple[_Name, ...] | None = None
    """Joints to drive; left out: the motor-driven joints that move the robot's site, so not its fingers, other than those of
    the base and of other parts."""
    position: PositionGains
    """Gains of the position."""
    attitude: AttitudeGains | None = None
    """Gains of the attitude, frame of the robot's site onto that of the object's; left out: it is not controlled."""
    joint_damping_N_m_s_rad: Gain = 0.0
    """Damping of motions of the arm that the site does not feel, N m s/rad."""
    singular_mass_kg: PositiveFloat = 1000.0
    """Effective inertia of the site, kg for pushes and kg m^2 for turns, above which a direction is near a singularity: its
    torques fade out, to nothing where the arm cannot move the site that way at all (out of the plane of a planar arm)."""
    max_torque_N_m: tuple[PositiveFloat, ...] | PositiveFloat | None = None
    """Bound on each joint's torque, one for all or one each, N m: feedback is scaled down as one vector to keep it; left
    out: the actuators' own limits clip each joint by itself."""
    max_joint_rate: tuple[PositiveFloat, ...] | PositiveFloat | None = None
    """Bound on each joint's rate, one for all or one each, rad/s (m/s for slides): of the relative rates that an error asks
    for so much is left as the joints can give beside what following takes; left out: no bound."""
    base: BaseConfig | None = None
    """Left out: the base floats."""
