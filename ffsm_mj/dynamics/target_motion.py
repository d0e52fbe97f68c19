"""Motions of a target: along a path of least jerk, or with a site of an object."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.minimum_jerk import MinimumJerk
from ffsm_mj.dynamics.moving_frame import MovingFrame


class TargetMotion(Protocol):
    """Where a target is along some world axes, and how it moves, at the time and state of the last ``update``."""

    position_m: FloatArray
    """Position, m, (number of axes,)."""
    rates_m_s: FloatArray
    """Velocity, m/s, (number of axes,)."""

    def update(self, time_s: float, data: Any) -> None:
        """Move on to a time and a state, whose derived quantities must be current."""

    def accelerations(self, qacc: FloatArray) -> FloatArray:
        """Acceleration in m/s^2, (number of axes,), for accelerations of all dofs, (nv,)."""


class PathMotion:
    """A target on the path of least jerk through waypoints: at rest before the first and after the last one."""

    def __init__(self, times_s: Sequence[float], positions_m: FloatArray) -> None:
        """Lay the path.

        Args:
            times_s: Simulation times of the waypoints, ascending, s, (m,).
            positions_m: Positions there, (m, number of axes).
        """
        self._path = MinimumJerk(times_s, positions_m, np.zeros(positions_m.shape[1]))
        self.position_m, self.rates_m_s, self._accelerations = self._path.at(times_s[0])

    def update(self, time_s: float, data: Any) -> None:  # noqa: ARG002 (a path knows its time alone)
        """Move on to a time."""
        self.position_m, self.rates_m_s, self._accelerations = self._path.at(time_s)

    def accelerations(self, qacc: FloatArray) -> FloatArray:  # noqa: ARG002
        """Acceleration on the path, m/s^2."""
        return self._accelerations


class SiteTarget:
    """A target that is fixed to a site, coasting as the body of the site does."""

    def __init__(self, frame: MovingFrame, axes: Sequence[int]) -> None:
        """Bind to a frame and the world axes that count."""
        self._frame, self._axes = frame, list(axes)
        self.position_m, self.rates_m_s = np.zeros(len(axes)), np.zeros(len(axes))

    def update(self, time_s: float, data: Any) -> None:  # noqa: ARG002 (the state says it all)
        """Move on to a state."""
        self._frame.update(data)
        self.position_m, self.rates_m_s = self._frame.point[self._axes], self._frame.rates[self._axes]

    def accelerations(self, qacc: FloatArray) -> FloatArray:
        """Acceleration for those of all dofs, m/s^2."""
        return self._frame.accelerations(qacc)[self._axes]
