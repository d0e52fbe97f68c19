"""Trajectories: the path of least jerk through waypoints, and motions of a target along it or with a site.

Among all paths through given positions at given times, with given position, rate and acceleration at both ends, the integral
of the squared jerk is least for the spline of polynomials of degree 5 whose first four derivatives are continuous (Flash &
Hogan 1985). From rest to rest in one segment it is 10 s^3 - 15 s^4 + 6 s^5.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import perm
from typing import Any, Protocol

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.site_motion import MovingFrame

_DEGREE = 5
_REAL = 1e-6
"""A root with an imaginary part below this share of a segment is real."""


class MinimumJerk:
    """Positions over time, from some rates at the start, without acceleration there, to rest at the end.

    Attributes:
        times: Times of the waypoints, (m + 1,), s.
    """

    def __init__(self, times: Sequence[float], positions: FloatArray, rates: FloatArray) -> None:
        """Solve for the spline.

        Args:
            times: Times of start and waypoints, ascending, (m + 1,), s.
            positions: Positions there, (m + 1, n).
            rates: Rates at the start, (n,).
        """
        self.times = np.asarray(times, dtype=np.float64)
        lengths, count, size = np.diff(self.times), len(times) - 1, _DEGREE + 1
        right = np.zeros((size * count, positions.shape[1]))
        entries: list[tuple[int, int, float]] = []
        row = 0

        def require(value: FloatArray | float, *terms: tuple[int, FloatArray]) -> None:
            nonlocal row
            for segment, coefficients in terms:
                entries.extend((row, size * segment + i, c) for i, c in enumerate(coefficients.tolist()) if c)
            right[row], row = value, row + 1

        for k in range(count):
            require(positions[k], (k, _row(0.0, 0)))
            require(positions[k + 1], (k, _row(1.0, 0)))
        for order, value in ((1, rates * lengths[0]), (2, 0.0)):
            require(value, (0, _row(0.0, order)))
            require(0.0, (count - 1, _row(1.0, order)))
        for k in range(count - 1):
            for order in range(1, _DEGREE):
                scale = (lengths[k] / lengths[k + 1]) ** order
                require(0.0, (k, _row(1.0, order)), (k + 1, -scale * _row(0.0, order)))
        self._lengths = lengths
        self._coefficients = _solved(entries, right).reshape(count, size, -1)

    def at(self, time_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, rate and acceleration at a time, (n,) each; at rest after the last waypoint."""
        k = min(max(int(np.searchsorted(self.times, time_s, side="right")) - 1, 0), len(self._lengths) - 1)
        length = self._lengths[k]
        s = min(max((time_s - self.times[k]) / length, 0.0), 1.0)
        rows = np.array([_row(s, order) / length**order for order in range(3)])
        position, rate, acceleration = rows @ self._coefficients[k]
        if time_s >= self.times[-1]:
            rate, acceleration = np.zeros_like(rate), np.zeros_like(acceleration)
        return position, rate, acceleration

    def extremes(self, order: int) -> list[tuple[float, FloatArray]]:
        """Times and values, (n,) each, that contain the least and the greatest of a derivative of every joint.

        Args:
            order: 0 for positions, 1 for rates.
        """
        extremal = []
        for k, (length, coefficients) in enumerate(zip(self._lengths, self._coefficients, strict=True)):
            ends = {0.0, 1.0}
            for joint in coefficients.T:
                roots = np.roots(np.polynomial.polynomial.polyder(joint, order + 1)[::-1])
                # A double root, as where a path rests on its way, may come with an imaginary part of rounding.
                ends |= {float(root.real) for root in roots if abs(root.imag) < _REAL and 0.0 < root.real < 1.0}
            for s in sorted(ends):
                extremal.append((float(self.times[k] + s * length), _row(s, order) @ coefficients / length**order))
        return extremal


def _solved(entries: Sequence[tuple[int, int, float]], right: FloatArray) -> FloatArray:
    """Solution of linear equations whose matrix has a few entries (row, column, value) near its diagonal."""
    from scipy.sparse import csc_array  # half a second to import, needed by runs with a path only
    from scipy.sparse.linalg import splu

    rows, columns, values = zip(*entries, strict=True)
    matrix = csc_array((values, (rows, columns)), shape=(len(right), len(right)))
    return np.asarray(splu(matrix).solve(right))


def _row(s: float, order: int) -> FloatArray:
    """Derivatives of 1, s, ..., s^5 of some order, (6,)."""
    return np.array([perm(i, order) * s ** (i - order) if i >= order else 0.0 for i in range(_DEGREE + 1)])


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
