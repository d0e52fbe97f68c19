"""When and how near a law came to a singularity of the free-floating robot."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ffsm_mj.controller_protocol import ControllerReport, FloatArray, Stateful


def _of_inertia(least: float, largest: float) -> str:
    inertia = f"{1.0 / least:.3g}" if least > 0.0 else "infinite"
    return f"effective inertia up to {inertia} (kg or kg m^2; singular_mass_kg {largest:g})"


class SingularityMonitor(Stateful):
    """Counts the control ticks at which a direction that the arm can move its site in has too little mobility."""

    @dataclass
    class State:
        """Number of ticks near a singularity, the first of them, s, and the least mobility."""

        ticks: int
        first_s: float
        least: float

    def __init__(
        self, directions: int, largest: float, period_s: float, describe: Callable[[float, float], str] = _of_inertia
    ) -> None:
        """Know the bound.

        Args:
            directions: Number of directions in which the arm can move the site at all.
            largest: Effective inertia above which a direction is near a singularity, kg or kg m^2.
            period_s: Control period.
            describe: Text for the least mobility and ``largest``.
        """
        self._describe = describe
        self._directions, self._largest, self._period_s = directions, largest, period_s
        self._ticks, self._first_s, self._least = 0, math.nan, math.inf

    def look(self, time_s: float, mobilities: FloatArray) -> None:
        """Take note of a control tick.

        Args:
            time_s: Its time.
            mobilities: Mobilities of the site along its principal directions, ascending, 1/kg or 1/(kg m^2).
        """
        least = float(mobilities[len(mobilities) - self._directions]) if self._directions else math.inf
        if least * self._largest >= 1.0:
            return
        self._ticks, self._least = self._ticks + 1, min(self._least, least)
        if self._ticks == 1:
            self._first_s = time_s

    def report(self) -> ControllerReport:
        """Time spent near a singularity, and a note that says so; a time of zero alone if there was none."""
        spent = self._ticks * self._period_s
        if not self._ticks:
            return {"near_singularity_s": spent}
        note = (
            f"near a singularity for {spent:.4g} s, first at t = {self._first_s:.6g} s: "
            f"{self._describe(self._least, self._largest)}, where the site does not follow in all directions"
        )
        return {"near_singularity_s": spent, "note": note}


def damped_inverse(matrix: FloatArray, largest: float) -> tuple[FloatArray, FloatArray]:
    """The inverse of a symmetric positive matrix, damped along principal directions in which it is above a bound.

    Along a direction with the eigenvalue a the inverse is 1/a down to a_0 = 1/largest, and below it (2 - a/a_0)/a_0: the
    same value and slope there, finite for a = 0. What is wanted along it is had to the share (2 - a/a_0) a/a_0. Applied to
    the mobility alpha M_c^-1 alpha^T in 1/kg and 1/(kg m^2) the inverse is the effective inertia of the site.

    Args:
        matrix: The matrix, (p, p).
        largest: Value of the inverse above which a direction is damped.

    Returns:
        The inverse (p, p), and the eigenvalues of the matrix, ascending, (p,).
    """
    values, directions = np.linalg.eigh(matrix)
    smallest = float(values[0])
    if smallest * largest >= 1.0:
        return (directions / values).dot(directions.T), values
    share = np.minimum(np.maximum(values, 0.0) * largest, 1.0)
    inverse = np.where(share < 1.0, (2.0 - share) * largest, 1.0 / np.maximum(values, 1.0 / largest))
    return (directions * inverse).dot(directions.T), values
