"""Configuration of the grasps of a scenario."""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import ConfigDict, Field, PositiveFloat, model_validator

from ffsm_mj.config import Name, StrictModel
from ffsm_mj.model.grasp import LatchJoint, LatchKind


class WithinConfig(StrictModel):
    """Bounds on the relative pose and velocity of the two sites; all stated bounds must hold at the same time."""

    position_m: PositiveFloat | None = None
    """Distance of the sites, m."""
    angle_rad: PositiveFloat | None = None
    """Angle between the frames of the sites, rad."""
    speed_m_s: PositiveFloat | None = None
    """Relative speed of the two bodies at the object's site, m/s."""
    rate_rad_s: PositiveFloat | None = None
    """Relative angular speed of the two bodies, rad/s."""

    @model_validator(mode="before")
    @classmethod
    def _states_one(cls, data: Any) -> Any:
        if isinstance(data, dict) and not any(value is not None for value in data.values()):
            raise ValueError("needs one bound at least: position_m, angle_rad, speed_m_s, rate_rad_s")
        return data

    @property
    def bounds(self) -> tuple[float | None, ...]:
        """The four bounds, in the order of :class:`~.closing_condition.Nearness`; None if not stated."""
        return self.position_m, self.angle_rad, self.speed_m_s, self.rate_rad_s


class WhenConfig(StrictModel):
    """Closing condition of an armed grasp: an impact of a contact rule, or bounds on the relative motion of the sites."""

    model_config = ConfigDict(json_schema_extra={"oneOf": [{"required": ["touch"]}, {"required": ["within"]}]})

    touch: Annotated[tuple[Name, ...], Field(min_length=1)] | None = None
    """Names of contact rules or of their pairs: the grasp closes at the first impact of one of them."""
    within: WithinConfig | None = None
    """The grasp closes as soon as all of these bounds hold."""

    @model_validator(mode="after")
    def _one_of_two(self) -> WhenConfig:
        if (self.touch is None) == (self.within is None):
            raise ValueError("needs 'touch: [rule, ...]' or 'within: {position_m: ..., ...}', one of the two")
        return self


class LoadLimitConfig(StrictModel):
    """Load at which a closed grasp opens by itself: the first stated limit that is reached."""

    force_N: PositiveFloat | None = None
    """Force of the link on the object, N."""
    torque_N_m: PositiveFloat | None = None
    """Torque on the object about the object's site, N m."""

    @model_validator(mode="before")
    @classmethod
    def _states_one(cls, data: Any) -> Any:
        if isinstance(data, dict) and not any(value is not None for value in data.values()):
            raise ValueError("needs one limit at least: force_N, torque_N_m")
        return data


class GraspConfig(StrictModel):
    """A grasp: attaches a floating object to a link of the robot at the relative pose they have when it closes.

    While it is closed, another grasp of the same two sites may be armed. Where that one closes, it takes over, as the hard
    capture of a docking mechanism follows its soft capture.
    """

    robot_site: Name
    """Site of the robot, on the grasping link."""
    object_site: Name
    """Site of a floating object, on its base; impulse and loads are given at this site."""
    when: WhenConfig
    """Closing condition while a phase arms it."""
    joint: LatchKind = "rigid"
    """Relative motion that the closed grasp leaves free: none (``rigid``); rotation about the object's site (``ball``);
    rotation about an axis (``hinge``), translation along it (``slide``), or both (``cylindrical``, as a probe in a cone)."""
    axis: tuple[float, float, float] | None = None
    """Direction of this axis in the frame of ``robot_site``; the axis passes through ``object_site``."""

    load_limit: LoadLimitConfig | None = None
    """Load at which the closed grasp opens; impulses do not count."""

    @model_validator(mode="after")
    def _axis_where_needed(self) -> GraspConfig:
        # An axis that nothing uses would be ignored in silence, where the user expects a motion along it.
        has_axis = self.joint not in ("rigid", "ball")
        if has_axis and (self.axis is None or not any(self.axis)):
            raise ValueError(f"joint: {self.joint} needs 'axis: [x, y, z]', not all zero, in the frame of robot_site")
        if not has_axis and self.axis is not None:
            raise ValueError(f"joint: {self.joint} has no axis; leave out 'axis', or write hinge, slide or cylindrical")
        return self

    @property
    def latch_joint(self) -> LatchJoint:
        """The relative motion that it leaves free, with a unit axis."""
        # A scenario states a direction in any length; rows and rates need a unit vector, or they would be scaled by it.
        length = math.hypot(*self.axis or ())
        return LatchJoint(self.joint, tuple(x / length for x in self.axis or ()))

    @property
    def greatest_load(self) -> tuple[float, float]:
        """Force in N and torque in N m at which it opens by itself; infinite where there is no limit."""
        limit = self.load_limit
        return (math.inf, math.inf) if limit is None else (limit.force_N or math.inf, limit.torque_N_m or math.inf)
