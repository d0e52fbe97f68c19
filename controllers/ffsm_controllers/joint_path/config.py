"""What a scenario says of the law ``joint_path``."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, PositiveFloat, model_validator

from ffsm_controllers.joint_servo import ServoConfig
from ffsm_mj.controller_protocol import StrictModel


class Waypoint(StrictModel):
    """Where the joints are to be at a time."""

    at_s: PositiveFloat
    """Time since the start of the phase, s."""
    positions: tuple[float, ...]
    """Position of each joint, rad or m."""


class JointPathConfig(ServoConfig):
    """Joints move through waypoints on the path of least jerk, from where they are to rest at the last one."""

    kind: Literal["joint_path"]
    waypoints: Annotated[tuple[Waypoint, ...], Field(min_length=1)]
    """Waypoints in the order of their times."""
    max_speed: tuple[PositiveFloat, ...] | PositiveFloat | None = None
    """Bound on the speed of each joint, rad/s (m/s for slides), one for all or one each; left out: no bound."""
    max_effort: tuple[PositiveFloat, ...] | PositiveFloat | None = None
    """Bound on the effort of each joint, N m (N for slides), one for all or one each, in addition to the limits of its
    actuator."""

    @model_validator(mode="after")
    def _times_ascend(self) -> JointPathConfig:
        times = [waypoint.at_s for waypoint in self.waypoints]
        for one, other in pairwise(times):
            if other <= one:
                raise ValueError(f"the times of waypoints must ascend; {other:g} s follows {one:g} s")
        return self
