"""Samples of one sensor on their way: when they are taken, when they arrive, and which is the newest."""

from __future__ import annotations

import math
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
        next_s: Time of the next sample.
        shown: Newest sample that has arrived; None before the first.
    """

    def __init__(self, sensor: Sensor, seed: int) -> None:
        """Before the first sample."""
        self.sensor, self._errors = sensor, SensorErrors(sensor, seed)
        self._sums = sensor.model.kind in ("force", "torque")
        self.begin(0.0)

    def begin(self, time_s: float) -> None:
        """Begin at a time: samples before it are taken to have been lost."""
        sensor = self.sensor
        self._number = max(0, math.ceil((time_s - sensor.first_s) / sensor.interval_s - 1e-9))
        self.next_s = sensor.first_s + self._number * sensor.interval_s
        self.shown: Sample | None = None
        self._under_way: list[tuple[float, int, Sample]] = []
        self._impulse, self._last = np.zeros(3), np.full(3, np.nan)

    def add_impulse(self, impulse: FloatArray) -> None:
        """Add an impulse through a force sensor, or an angular impulse through a torque sensor, (3,)."""
        self._impulse = self._impulse + impulse

    def take(self, true: FloatArray, valid: bool) -> None:
        """Take the next sample."""
        number, time_s, impulse, mean = self._number, self.next_s, _NONE, _NONE
        if self._sums:
            impulse = self._impulse
            mean = 0.5 * (self._last + true) + impulse / self.sensor.interval_s
            self._impulse, self._last = np.zeros(3), true
        sample = Sample(time_s, number, self._errors.measured(true, number), true, valid, impulse, mean)
        if (after_s := self._errors.arrival_s(number)) < math.inf:
            heappush(self._under_way, (time_s + after_s, number, sample))
        self._number = number + 1
        self.next_s = self.sensor.first_s + self._number * self.sensor.interval_s

    def arrive(self, time_s: float) -> None:
        """Let everything arrive that is due at a time; the newest sample is shown, whenever it arrives."""
        under_way = self._under_way
        while under_way and under_way[0][0] <= time_s + SAME_TIME_S:
            sample = heappop(under_way)[2]
            if self.shown is None or sample.number > self.shown.number:
                self.shown = sample

    def measurement(self, time_s: float) -> Measurement:
        """What a control law is shown at a time."""
        shown = self.shown
        if shown is None:
            nan = np.full(self.sensor.size, np.nan)
            return Measurement(nan, math.nan, math.nan, False)
        return Measurement(shown.value, shown.time_s, time_s - shown.time_s, shown.valid, shown.impulse, shown.mean)
