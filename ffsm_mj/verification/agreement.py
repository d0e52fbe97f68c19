"""How far the numbers of a log are from what its states say, and where that is worst."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray
from ffsm_mj.records.signals import Layout, unit_of

AGREES = 1e-10
"""Numbers agree when they differ by at most this times (1 + scale), in SI units.

On the machine that wrote the log they are the same to a few units in the last place. Another adds in another order: some 1e3
operations for one step or one sample, each good to 1.1e-16, and a mass matrix of condition 1e3 between forces and rates.
"""
# A change that is zero but for rounding is measured by what changes.
_CHANGES_OF = {
    "energy_change_J": "energy_before_J",
    "linear_momentum_change_N_s": "momentum_before",
    "angular_momentum_change_N_m_s": "momentum_before",
}


@dataclass(frozen=True)
class Discrepancy:
    """Between a number in a log and what the states say of it.

    Attributes:
        what: A column, or a field of an impact: ``impact 1 impulse_N_s``.
        size: Its magnitude; infinite where one of the two is not a number.
        allowed: Largest magnitude that still agrees.
        unit: Unit of both.
        time_s: Where in the run.
    """

    what: str
    size: float
    allowed: float
    unit: str
    time_s: float

    @property
    def passes(self) -> bool:
        """Within what is allowed."""
        return self.size <= self.allowed

    @property
    def excess(self) -> float:
        """Magnitude over what is allowed."""
        return self.size / self.allowed


@dataclass
class Agreement:
    """Keeps the worst difference of all that it is shown.

    Attributes:
        worst: It; None before anything was compared.
        numbers: How many numbers were compared.
    """

    worst: Discrepancy | None = None
    numbers: int = 0

    def keep(self, found: Discrepancy) -> None:
        """Look at one difference."""
        if self.worst is None or not found.excess <= self.worst.excess:
            self.worst = found

    def rows(
        self, layout: Layout, columns: npt.NDArray[np.intp], logged: FloatArray, again: FloatArray, scale: FloatArray
    ) -> None:
        """Compare columns of samples.

        Args:
            layout: Columns of a row.
            columns: Which are compared, (k,).
            logged: Rows of the log, (n, all columns).
            again: The same as the states say, (n, k).
            scale: What their magnitude is measured by, (n, k).
        """
        given = logged[:, columns]
        self.numbers += given.size
        same = (given == again) | (np.isnan(given) & np.isnan(again))
        if same.all() and self.worst is not None:
            return
        allowed = AGREES * (1.0 + np.nan_to_num(np.abs(scale), posinf=0.0))
        with np.errstate(invalid="ignore", over="ignore"):
            size = np.where(same, 0.0, np.abs(given - again))
            size = np.where(np.isnan(size), np.inf, size)
            row, place = np.unravel_index(int(np.argmax(size / allowed)), size.shape)
        signal, time = layout.signals[columns[place]], float(logged[row, layout.time])
        self.keep(Discrepancy(signal.key, float(size[row, place]), float(allowed[row, place]), signal.unit, time))

    def record(self, event: str, logged: Any, again: Any) -> None:
        """Compare all fields of a record of an event."""
        for each in fields(logged):
            given, known = getattr(logged, each.name), getattr(again, each.name)
            name = f"{event} {each.name}"
            if _is_text(known):
                self.keep(Discrepancy(name, 0.0 if given == known else math.inf, AGREES, "", logged.time_s))
                continue
            a, b = numbers_of(given), numbers_of(known)
            self.numbers += len(a)
            scale = numbers_of(getattr(again, _CHANGES_OF.get(each.name, each.name)))
            self.vector(name, a, b, scale, unit_of(each.name), logged.time_s)

    def vector(self, name: str, logged: FloatArray, again: FloatArray, scale: FloatArray, unit: str, time_s: float) -> None:
        """Compare a few numbers, measured by the largest of ``scale``."""
        size = np.inf
        if logged.shape == again.shape:
            size = float(np.max(np.abs(logged - again), initial=0.0)) if not np.array_equal(logged, again) else 0.0
        allowed = AGREES * (1.0 + float(np.max(np.abs(scale), initial=0.0)))
        self.keep(Discrepancy(name, math.inf if math.isnan(size) else size, allowed, unit, time_s))


def _is_text(value: Any) -> bool:
    return isinstance(value, str) or (isinstance(value, tuple) and bool(value) and isinstance(value[0], str))


def numbers_of(value: Any) -> FloatArray:
    """The numbers of a field of an event in one row: a number, several, or several by name."""
    if isinstance(value, Mapping):
        return np.array([number for name in sorted(value) for number in value[name]], dtype=np.float64)
    return np.atleast_1d(np.asarray(value, dtype=np.float64))


def scales(layout: Layout, columns: npt.NDArray[np.intp], rows: FloatArray, momentum: FloatArray) -> FloatArray:
    """What each number of some columns is measured by: its own magnitude, or that of the sums it comes from, (n, k).

    Energies are measured by the largest energy of the row; momenta and impulses by the largest of the row, and by a bound on
    the sum of all m |v| with the lever that they act on: what is zero because much cancels is known no better than that.

    Args:
        layout: Columns of a row.
        columns: Which are wanted.
        rows: Samples, (n, all columns).
        momentum: The bound for each sample, (n,).
    """
    magnitude = np.abs(rows[:, columns])
    units = np.array([layout.signals[i].unit for i in columns])
    energy, impulse = units == "J", np.isin(units, ("N s", "N m s"))
    magnitude[:, energy] = np.max(magnitude[:, energy], axis=1, initial=0.0)[:, None]
    largest = np.max(magnitude[:, impulse], axis=1, initial=0.0)
    magnitude[:, impulse] = np.maximum(largest, momentum)[:, None]
    return magnitude
