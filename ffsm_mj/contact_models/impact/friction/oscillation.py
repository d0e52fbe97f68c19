"""Free oscillation of a contact on its springs, and the first zero of a function of it.

With K = diag(kappa, 1 / rho, 1 / rho) and the force F = (f, -s / rho), K^-1/2 F oscillates in the modes of K^1/2 G K^1/2;
see :mod:`ffsm_mj.contact_models.impact.friction.compliant`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import cbrt, inf, sqrt

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.tolerances import EPSILON

_Jet = tuple[float, float, float]
"""A function of time with its first two derivatives."""
_NEWTON = 100
"""Largest number of Newton's steps for a zero of a cubic, which converge quadratically."""
_SAFE_STEPS = 20_000
"""Largest number of steps to a zero, of which a period of the fastest mode takes about ten."""


@dataclass(frozen=True)
class Modes:
    """Free oscillation of a contact whose slider holds, for one stiffness kappa of the normal spring.

    Attributes:
        roots: Square roots of the stiffnesses, (3,): (kappa, 1 / rho, 1 / rho)^1/2.
        frequencies: Angular frequencies, ascending, (3,); zero for what does not move.
        axes: Modes of K^1/2 G K^1/2 as columns, (3, 3).
    """

    roots: FloatArray
    frequencies: FloatArray
    axes: FloatArray

    @classmethod
    def of(cls, G: FloatArray, kappa: float, rho: float) -> Modes:
        """From G = A A^T, (3, 3), and the stiffnesses."""
        roots = np.sqrt([kappa, 1.0 / rho, 1.0 / rho])
        values, axes = np.linalg.eigh(roots[:, None] * G * roots)
        # A combination of forces that moves nothing has an eigenvalue of rounding, which would be a slow oscillation.
        values[values < 64.0 * EPSILON * values[-1]] = 0.0
        return cls(roots, np.sqrt(values), axes)


@dataclass(frozen=True)
class Oscillation:
    """Motion from a state on, t = 0, until the slider slips.

    Attributes:
        modes: Its modes.
        sines: Amplitudes of sin(omega t), (3,).
        cosines: Amplitudes of cos(omega t), (3,).
    """

    modes: Modes
    sines: FloatArray
    cosines: FloatArray

    @classmethod
    def begin(cls, modes: Modes, force: FloatArray, u: FloatArray) -> Oscillation:
        """From the force (f, -s / rho), (3,), and the velocity, (3,)."""
        at, rate = -modes.axes.T @ (force / modes.roots), modes.axes.T @ (modes.roots * u)
        moves = modes.frequencies > 0.0
        return cls(modes, np.divide(rate, modes.frequencies, out=np.zeros(3), where=moves), at)

    @property
    def swing(self) -> float:
        """Bound on the part of the force that oscillates."""
        moves = self.modes.frequencies > 0.0
        parts = np.abs(self.modes.roots[:, None] * self.modes.axes)[:, moves]
        return float((parts @ np.hypot(self.sines, self.cosines)[moves]).max())

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Bounds on the normal force and on the size of the tangential one, with derivatives up to the fourth, (5,) each."""
        sizes = np.hypot(self.sines, self.cosines) * self.modes.frequencies ** np.arange(5)[:, None]
        parts = np.abs(self.modes.roots[:, None] * self.modes.axes)
        return sizes @ parts[0], sizes @ np.hypot(parts[1], parts[2])

    def forces(self, time: float) -> list[list[float]]:
        """Forces and their first three derivatives at a time, (4, 3)."""
        w = self.modes.frequencies
        c, s = np.cos(w * time), np.sin(w * time)
        at, rate = self.sines * s + self.cosines * c, w * (self.sines * c - self.cosines * s)
        modal = np.array((at, rate, -w * w * at, -w * w * rate))
        forces: list[list[float]] = (-modal @ self.modes.axes.T * self.modes.roots).tolist()
        return forces

    def impulse(self, time: float) -> FloatArray:
        """Integral of the force, (3,)."""
        w, moves = self.modes.frequencies, self.modes.frequencies > 0.0
        # 1 - cos without cancellation; what does not move keeps its force.
        modal = self.sines * 2.0 * np.sin(0.5 * w * time) ** 2 + self.cosines * np.sin(w * time)
        modal = np.divide(modal, w, out=self.cosines * time, where=moves)
        return np.asarray(-self.modes.roots * (self.modes.axes @ modal))

    def peaks(self, most: float) -> float:
        """The first time, at most ``most``, at which the normal force ceases to grow; infinite if there is none."""
        return _first_zero(lambda time: self._normal(time, 1), float(self.bounds[0][4]), most)

    def vanishes(self, most: float) -> float:
        """The first time at which the normal force is zero, likewise."""
        return _first_zero(lambda time: self._normal(time, 0), float(self.bounds[0][3]), most)

    def reaches(self, peak: float, most: float, *, from_there: bool) -> float:
        """The first time at which the normal force has grown to ``peak``, where it begins and falls from, or not."""

        def below(time: float) -> _Jet:
            force, rate, bend = self._normal(time, 0)
            # At the peak both are zero: by rounding the force would reach it again at once.
            return (0.0, 0.0, -bend) if from_there and time == 0.0 else (peak - force, -rate, -bend)

        return _first_zero(below, float(self.bounds[0][3]), most)

    def slips(self, mu: float, most: float, *, from_there: bool) -> float:
        """The first time at which the tangential force is mu times the normal one, as it is at the start, or not."""
        square, (along, across) = mu * mu, self.bounds

        def margin(time: float) -> _Jet:
            (f, *t), (f1, *t1), (f2, *t2), _ = self.forces(time)
            bend = 2.0 * (square * (f1 * f1 + f * f2) - _dot(t1, t1) - _dot(t, t2))
            # Where the slider has just stopped both are zero: by rounding it would slip again at once.
            if from_there and time == 0.0:
                return 0.0, 0.0, bend
            return square * f * f - _dot(t, t), 2.0 * (square * f * f1 - _dot(t, t1)), bend

        third = 2.0 * (square * _half_third(along) + _half_third(across))
        return _first_zero(margin, third, most)

    def _normal(self, time: float, order: int) -> _Jet:
        """A derivative of the normal force with the next two."""
        value, rate, bend = (row[0] for row in self.forces(time)[order : order + 3])
        return value, rate, bend


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    return a[0] * b[0] + a[1] * b[1]


def _half_third(bounds: FloatArray) -> float:
    """Bound on half the third derivative of the square of a function, from those on its derivatives."""
    return float(bounds[0] * bounds[3] + 3.0 * bounds[1] * bounds[2])


def _first_zero(jet: Callable[[float], _Jet], third: float, most: float) -> float:
    """The first time at which a function falls to zero, at most ``most``; infinite if it does not.

    From each time the function stays positive for as long as its Taylor polynomial does less the bound on its remainder, so
    that no zero is stepped over; near one these steps are Newton's. It may begin at zero, and rise.

    Args:
        jet: The function with its first two derivatives.
        third: Bound on the size of the third.
        most: End of the search.
    """
    time = 0.0
    for _ in range(_SAFE_STEPS):
        value, rate, bend = jet(time)
        step = _safe_step(max(value, 0.0), rate, bend, third)
        if step <= 4e-16 * time or (step == 0.0 and value <= 0.0):
            return time
        time += step
        if time >= most:
            return inf
    return inf


def _safe_step(value: float, rate: float, bend: float, third: float) -> float:
    """A time up to which value + rate t + bend t^2 / 2 - third t^3 / 6 stays positive: near a zero its zero, to rounding."""
    if rate >= 0.0 and bend >= 0.0:
        return max(cbrt(6.0 * value / third), sqrt(6.0 * rate / third), 3.0 * bend / third)
    # Without a bend that is positive the cubic is concave, and its one zero below this time: Newton's method from there on
    # is monotone.
    bend = min(bend, 0.0)
    step = cbrt(12.0 * value / third) + sqrt(12.0 * max(rate, 0.0) / third)
    for _ in range(_NEWTON):
        slope = rate + step * (bend - 0.5 * third * step)
        below = value + step * (rate + step * (0.5 * bend - third * step / 6.0))
        # Past the zero by rounding, or at it.
        if below >= 0.0 or slope >= 0.0:
            break
        step -= below / slope
    return max(step, 0.0)
