"""Whether the point that a site is to follow is within reach of the arm, and when it was not."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.controller_protocol import ControllerReport, FloatArray, Stateful, System, reach_of


class ReachMonitor(Stateful):
    """Counts the control ticks at which a point is farther from the first joint of the arm than the site ever gets.

    Limits of joints are not considered: a point that is near enough may still be out of reach.
    """

    @dataclass
    class State:
        """Number of ticks out of reach, the first of them, s, and the greatest distance, m."""

        ticks: int
        first_s: float
        farthest_m: float

    def __init__(self, system: System, site: int, period_s: float) -> None:
        """Find the reach.

        Args:
            system: The scene.
            site: Id of the robot's site.
            period_s: Control period.
        """
        data = mujoco.MjData(system.mj)
        mujoco.mj_kinematics(system.mj, data)
        reach = reach_of(system, data, site)
        self._radius_m = math.inf if reach is None else reach.radius_m
        self._joint = -1 if reach is None else int(system.mj.joint(reach.joint).id)
        self._name, self._period_s = "" if reach is None else reach.joint, period_s
        self._ticks, self._first_s, self._farthest_m = 0, math.nan, 0.0

    def look(self, time_s: float, data: Any, point: FloatArray) -> None:
        """Take note of a control tick: where the site is to be, world axes, m, (3,)."""
        distance = float(np.linalg.norm(point - data.xanchor[self._joint]))
        if distance <= self._radius_m:
            return
        self._ticks, self._farthest_m = self._ticks + 1, max(self._farthest_m, distance)
        if self._ticks == 1:
            self._first_s = time_s

    def report(self) -> ControllerReport:
        """Time out of reach, and a note that says so; nothing if there was none."""
        spent = self._ticks * self._period_s
        if not self._ticks:
            return {}
        note = (
            f"out of reach for {spent:.4g} s, first at t = {self._first_s:.6g} s: up to {self._farthest_m:.4g} m from joint "
            f"{self._name}, where the arm reaches {self._radius_m:.4g} m; move the base nearer first"
        )
        return {"out_of_reach_s": spent, "note": note}
