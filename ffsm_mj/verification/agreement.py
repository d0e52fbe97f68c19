"""Differences between logged values and values recomputed from the logged states."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray
from ffsm_mj.records.signals import Layout, unit_of
from ffsm_mj.verification.check_result import share_of

AGREES = 1e-10
"""Numbers agree if they differ by at most this times (1 + scale), in SI units.

On the machine that wrote the log they agree to a few units in the last place. Another machine may sum in another order: some
1e3 operations per step or sample, each with a rounding error of 1.1e-16, and a mass matrix of condition 1e3.
"""
# A change that is zero except for rounding is scaled by the quantity that changes.
_CHANGES_OF = {
    "energy_change_J": "energy_before_J",
    "linear_momentum_change_N_s": "momentum_before",
    "angular_momentum_change_N_m_s": "momentum_before",
}


@dataclass(frozen=True)
class Discrepancy:
    """Difference between a logged value and its value recomputed from the states.

    Attributes:
        what: A column, or a field of an impact: ``impact 1 impulse_N_s``.
        size: Magnitude; infinite if one of the two is not a number.
        allowed: Tolerance.
        unit: Unit of both.
        time_s: Time of the sample or event.
    """

    what: str
    size: float
    allowed: float
    unit: str
    time_s: float

    @property
    def passes(self) -> bool:
        """Whether it is within the tolerance."""
        return self.size <= self.allowed

    @property
    def excess(self) -> float:
        """Magnitude over tolerance."""
        return share_of(self.size, self.allowed)


def impossible(what: str, time_s: float) -> Discrepancy:
    """An infinite difference: something of the log is invalid as a whole."""
    return Discrepancy(what, math.inf, AGREES, "", time_s)


@dataclass
class Agreement:
    """Accumulates comparisons and keeps the worst difference.

    Attributes:
        worst: The worst difference; None before the first comparison.
        numbers: How many numbers were compared.
    """

    worst: Discrepancy | None = None
    numbers: int = 0

    def keep(self, discrepancy: Discrepancy) -> None:
        """Keep a difference if it is the worst so far."""
        if self.worst is None or not discrepancy.excess <= self.worst.excess:
            self.worst = discrepancy

    def rows(
        self,
        layout: Layout,
        columns: npt.NDArray[np.intp],
        logged: FloatArray,
        again: FloatArray,
        scale: FloatArray,
        accuracy: FloatArray | float = 0.0,
    ) -> None:
        """Compare columns of samples.

        Args:
            layout: Columns of a row.
            columns: Indices of the columns to compare, (k,).
            logged: Rows of the log, (n, all columns).
            again: Values recomputed from the states, (n, k).
            scale: Scales of the values, (n, k).
            accuracy: Differences to allow where a state determines values worse than to rounding, (n, k).
        """
        values = logged[:, columns]
        self.numbers += values.size
        same = (values == again) | (np.isnan(values) & np.isnan(again))
        if same.all() and self.worst is not None:
            return
        allowed = np.maximum(AGREES * (1.0 + np.nan_to_num(np.abs(scale), posinf=0.0)), accuracy)
        with np.errstate(invalid="ignore", over="ignore"):
            size = np.where(same, 0.0, np.abs(values - again))
            size = np.where(np.isnan(size), np.inf, size)
            row, place = np.unravel_index(int(np.argmax(size / allowed)), size.shape)
        signal, time = layout.signals[columns[place]], float(logged[row, layout.time])
        self.keep(Discrepancy(signal.key, float(size[row, place]), float(allowed[row, place]), signal.unit, time))

    def record(self, name: str, logged: Any, again: Any, time_s: float, accuracy: Mapping[str, float] | None = None) -> None:
        """Compare all fields of a record.

        Args:
            name: Its name, as of its event.
            logged: The record in the log.
            again: The record computed again.
            time_s: Its time.
            accuracy: Differences to allow in fields that a state determines worse than to rounding, by name.
        """
        for field in fields(logged):
            value, known = getattr(logged, field.name), getattr(again, field.name)
            what = f"{name} {field.name}"
            # Of two runs that take different paths one may list names where the other has none: that an empty tuple holds
            # texts is known from the other one.
            if is_text(value) or is_text(known):
                self.keep(Discrepancy(what, 0.0 if value == known else math.inf, AGREES, "", time_s))
                continue
            a, b = numbers_of(value), numbers_of(known)
            if field.name.endswith("quaternion") and len(a) == len(b) and a.dot(b) < 0.0:
                b = -b  # the same rotation
            self.numbers += len(a)
            scale = numbers_of(getattr(again, _CHANGES_OF.get(field.name, field.name)))
            least = (accuracy or {}).get(field.name, 0.0)
            self.vector(what, a, b, scale, unit_of(field.name), time_s, least)

    def vector(
        self,
        name: str,
        logged: FloatArray,
        again: FloatArray,
        scale: FloatArray,
        unit: str,
        time_s: float,
        accuracy: float = 0.0,
    ) -> None:
        """Compare a vector, relative to the largest element of ``scale``, or to an accuracy if that is worse."""
        size = np.inf
        if logged.shape == again.shape:
            size = float(np.max(np.abs(logged - again), initial=0.0)) if not np.array_equal(logged, again) else 0.0
        allowed = AGREES * (1.0 + float(np.max(np.abs(scale), initial=0.0)))
        self.keep(Discrepancy(name, math.inf if math.isnan(size) else size, max(allowed, accuracy), unit, time_s))


def is_text(value: Any) -> bool:
    """Whether a field of a record is a text or texts."""
    return isinstance(value, str) or (isinstance(value, tuple) and bool(value) and isinstance(value[0], str))


def numbers_of(value: Any) -> FloatArray:
    """The numbers in a field of a record as one array: of a number, a tuple, or a mapping."""
    if isinstance(value, Mapping):
        return np.array([number for name in sorted(value) for number in value[name]], dtype=np.float64)
    return np.atleast_1d(np.asarray(value, dtype=np.float64))


def scales(layout: Layout, columns: npt.NDArray[np.intp], rows: FloatArray, momentum: FloatArray) -> FloatArray:
    """Scale of each value of some columns: its own magnitude, or that of the terms it is summed from, (n, k).

    Energies are scaled by the largest energy of the row; momenta and impulses by the largest of the row, and by a bound on
    the sum of all m |v| with their lever arm: a sum that cancels to zero is known no better than its terms.

    Args:
        layout: Columns of a row.
        columns: Indices of the columns.
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
