"""Configuration of the task of a scenario: a site of the robot, and a target, which may move."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat, model_validator

from ffsm_mj.config import FileName, Name, StrictModel

Axis = Literal["x", "y", "z"]


class TargetWaypoint(StrictModel):
    """Where the target is at a time."""

    at_s: PositiveFloat
    """Simulation time, s."""
    position_m: tuple[float, ...]
    """Position along the axes of the task in world coordinates, m."""


class TrajectoryConfig(StrictModel):
    """Motion of the target: through waypoints, through those of a file, or with a site of an object."""

    start_s: NonNegativeFloat = 0.0
    """Simulation time at which the target leaves ``target_m``, s; with ``waypoints`` or ``file``."""
    waypoints: Annotated[tuple[TargetWaypoint, ...], Field(min_length=1)] | None = None
    """Waypoints in the order of their times; between them the target is on the path of least jerk, from rest at ``target_m``
    to rest at the last one."""
    file: FileName | None = None
    """Table with the waypoints, at most 2000 rows: columns ``time_s`` and ``x_m``, ``y_m``, ``z_m`` by axis of the task."""
    site: Name | None = None
    """Site of an object: the target is fixed to it."""
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """With ``site``: position of the target in the frame of the site, m."""

    @model_validator(mode="after")
    def _is_one_motion(self) -> TrajectoryConfig:
        if sum(given is not None for given in (self.waypoints, self.file, self.site)) != 1:
            raise ValueError("needs 'waypoints', 'file' or 'site', one of the three")
        if self.site is None and self.offset_m != (0.0, 0.0, 0.0):
            raise ValueError("'offset_m' has no effect without 'site'; leave it out")
        if self.site is not None and self.start_s > 0.0:
            raise ValueError("'start_s' has no effect with 'site'; leave it out")
        times = [self.start_s, *(waypoint.at_s for waypoint in self.waypoints or ())]
        for one, other in pairwise(times):
            if other <= one:
                raise ValueError(f"the times of waypoints must ascend from start_s; {other:g} s follows {one:g} s")
        return self


class TaskConfig(StrictModel):
    """Task of the arm: bring a site of the robot to a point, which may move."""

    tip: Name
    """Site of the robot to regulate."""
    axes: Annotated[tuple[Axis, ...], Field(min_length=2, max_length=3)] = ("x", "y", "z")
    """Regulated world axes: two for a planar task, three in space."""
    target_m: tuple[float, ...]
    """Target of the tip along these axes in world coordinates, m; with a trajectory through waypoints where it begins."""
    trajectory: TrajectoryConfig | None = None
    """Motion of the target; left out: it is at rest."""

    @model_validator(mode="after")
    def _one_number_per_axis(self) -> TaskConfig:
        if len(set(self.axes)) != len(self.axes):
            raise ValueError("axes must be different")
        if len(self.target_m) != len(self.axes):
            raise ValueError(f"target_m has {len(self.target_m)} numbers for {len(self.axes)} axes")
        for i, waypoint in enumerate((self.trajectory and self.trajectory.waypoints) or ()):
            if len(waypoint.position_m) != len(self.axes):
                raise ValueError(f"waypoint {i} has {len(waypoint.position_m)} numbers for {len(self.axes)} axes")
        return self
