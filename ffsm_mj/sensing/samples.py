"""Samples of one sensor on their way: when they are taken, when they arrive, and which is the newest."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from heapq import heappop, heappush
from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.sensing.measurement import Measurement
from ffsm_mj.sensing.sensor import Sensor
from ffsm_mj.sensing.sensor_errors import SensorErrors

_NONE = np.zeros(0)
SAME_TIME_S = 1e-9
"""Times within this of each other are one: products of steps and sums of delays differ by rounding."""


class Sample(NamedTuple):
    """A sample.

    Attributes:
        time_s: When it was taken.
        number: Its number, from 0.
        value: What was measured, (size,).
        true: The true value, (size,).
        valid: Whether what is measured was in view.
        impulse: See :class:`~ffsm_mj.sensing.measurement.Measurement`.
        mean: Likewise.
    """

    time_s: float
    number: int
    value: FloatArray
    true: FloatArray
    valid: bool
    impulse: FloatArray = _NONE
    mean: FloatArray = _NONE


class Samples:
    """Samples of one sensor.

    Attributes:
        sensor: The sensor.
        errors: Its errors.
        number: Number of the next sample, from 0.
        next_s: Time of the next sample.
        arrival_s: Time of the next arrival; infinite if nothing is under way.
        shown: Newest sample that has arrived; None before the first.
    """

    def __init__(self, sensor: Sensor, seed: int) -> None:
        """Before the first sample."""
        self.sensor, self.errors = sensor, SensorErrors(sensor, seed)
        self._sums = sensor.model.kind in ("force", "torque")
        self.begin()

    def begin(self) -> None:
        """Begin a run."""
        self._begin(0)
        self._first_known, self._unknown_until_s = 0, -math.inf

    def begin_after_gap(self, time_s: float) -> None:
        """Begin at a time in a log: samples up to it are not known, nor a mean over an interval from before."""
        sensor = self.sensor
        self._begin(max(0, math.floor((time_s + SAME_TIME_S - sensor.first_s) / sensor.interval_s) + 1))
        self._first_known = self.number + 1 if self._sums else self.number
        last_unknown_s = sensor.first_s + (self._first_known - 1) * sensor.interval_s
        self._unknown_until_s = last_unknown_s + sensor.delay_s + sensor.delay_jitter_s if self._first_known else -math.inf

    def _begin(self, number: int) -> None:
        self.number = number
        self.next_s = self.sensor.first_s + number * self.sensor.interval_s
        self.shown: Sample | None = None
        self.arrival_s = math.inf
        self._under_way: list[tuple[float, int, Sample]] = []
        self._impulse, self._last = np.zeros(3), np.full(3, np.nan)

    def add_impulse(self, impulse: FloatArray) -> None:
        """Add an impulse through a force sensor, or an angular impulse through a torque sensor, (3,)."""
        self._impulse = self._impulse + impulse

    def take(self, true: FloatArray, measured: FloatArray, valid: bool) -> None:
        """Take the next sample: the true value, what the sensor measures of it, and whether that is in view."""
        number, time_s, impulse, mean = self.number, self.next_s, _NONE, _NONE
        if self._sums:
            impulse = self._impulse
            mean = 0.5 * (self._last + true) + impulse / self.sensor.interval_s
            self._impulse, self._last = np.zeros(3), true
        sample = Sample(time_s, number, measured, true, valid, impulse, mean)
        if (after_s := self.errors.arrival_s(number)) < math.inf:
            heappush(self._under_way, (time_s + after_s, number, sample))
            self.arrival_s = self._under_way[0][0]
        self.number = number + 1
        self.next_s = self.sensor.first_s + self.number * self.sensor.interval_s

    def may_show_unknown(self, time_s: float) -> bool:
        """Whether the newest sample that has arrived may be one that is not known; to be asked at each row after a gap."""
        if self._unknown_until_s == -math.inf:
            return False
        known = self.shown is not None and self.shown.number >= self._first_known
        if known or time_s >= self._unknown_until_s:  # the last of them has arrived, at this row at the latest
            self._unknown_until_s = -math.inf
        return not known

    def arrive(self, time_s: float) -> bool:
        """Let everything arrive that is due at a time; returns whether another sample is shown: the newest."""
        under_way, before = self._under_way, self.shown
        while self.arrival_s <= time_s + SAME_TIME_S:
            sample = heappop(under_way)[2]
            self.arrival_s = under_way[0][0] if under_way else math.inf
            if self.shown is None or sample.number > self.shown.number:
                self.shown = sample
        return self.shown is not before


class Measured(Mapping[str, Measurement]):
    """What a control law is shown of all sensors at a time: measurements by full name, made where they are looked up."""

    def __init__(self, shown: Mapping[str, Sample | int], time_s: float) -> None:
        """Show the newest sample of each sensor, or the size of its value if none has arrived."""
        self._shown, self._time_s = shown, time_s

    def __getitem__(self, name: str) -> Measurement:
        """Newest sample of a sensor."""
        shown = self._shown[name]
        if isinstance(shown, int):
            return Measurement(np.full(shown, np.nan), math.nan, math.nan, False)
        age_s = self._time_s - shown.time_s
        return Measurement(shown.value, shown.time_s, age_s, shown.valid, shown.impulse, shown.mean)

    def __iter__(self) -> Iterator[str]:
        """Names of the sensors."""
        return iter(self._shown)

    def __len__(self) -> int:
        """Number of sensors."""
        return len(self._shown)
