"""Sensors that are sampled together: their samples are taken, delayed and shown as one array."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.sensing.group_errors import GroupErrors
from ffsm_mj.sensing.sample_layout import SampleLayout
from ffsm_mj.sensing.sensor import Sensor
from ffsm_mj.state import Stateful, fitting
from ffsm_mj.tolerances import SCHEDULED_S


class SensorGroup(Stateful):
    """Sensors with one clock and one delay, or a single sensor whose samples are lost or late at random.

    Attributes:
        sensors: The sensors.
        layout: Places in a sample.
        number: Number of the next sample, from 0.
        next_s: Time of the next sample.
        arrival_s: Time of the next arrival; infinite if nothing is under way.
        shown: Newest sample that has arrived, laid out as in ``layout``; None before the first.
    """

    @dataclass
    class State:
        """Numbers of the next sample and of the one that is shown, samples on their way, and means and impulses so far."""

        number: int
        shown_number: int
        shown: FloatArray | None
        under_way: list[tuple[float, int, FloatArray]]
        last: FloatArray
        impulses: FloatArray | None

    def __init__(self, sensors: Sequence[Sensor], seed: int) -> None:
        """Before the first sample; ``seed`` is that of the run."""
        self.sensors, self.layout = tuple(sensors), SampleLayout(sensors)
        self._errors = GroupErrors(sensors, seed, self.layout)
        self._given = np.zeros(self.layout.size)
        self._first_s, self._interval_s = sensors[0].first_s, sensors[0].interval_s
        self.begin()

    def begin(self) -> None:
        """Begin a run."""
        self._begin(0)
        self._unknown: dict[int, tuple[int, float]] = {}

    def begin_after_gap(self, time_s: float) -> None:
        """Begin at a time in a log: samples up to it are not known, nor a mean over an interval from before."""
        self._begin(max(0, math.floor((time_s + SCHEDULED_S - self._first_s) / self._interval_s) + 1))
        self._unknown = {}
        for k, sensor in enumerate(self.sensors):
            first_known = self.number + (k in self.layout.cells)
            last_unknown_s = self._first_s + (first_known - 1) * self._interval_s
            if first_known:
                self._unknown[k] = first_known, last_unknown_s + sensor.delay_s + sensor.delay_jitter_s

    def _begin(self, number: int) -> None:
        self.number, self._shown_number = number, -1
        self.next_s = self._first_s + number * self._interval_s
        self.shown: FloatArray | None = None
        self.arrival_s = math.inf
        self._under_way: list[tuple[float, int, FloatArray]] = []
        self._last = np.full(len(self.layout.summed), np.nan)
        self._impulses: FloatArray | None = None

    def set_state(self, state: Any) -> None:
        """Go on from a state."""
        super().set_state(state)
        self.next_s = self._first_s + self.number * self._interval_s
        self.arrival_s = self._under_way[0][0] if self._under_way else math.inf
        for sample in (self.shown, *(sample for *_, sample in self._under_way)):
            if sample is not None:
                fitting(sample, (self.layout.size,), "SensorGroup").setflags(write=False)

    def add_impulses(self, impulses: FloatArray) -> None:
        """Add impulses through force sensors and angular impulses through torque sensors, in their order, (3 n,)."""
        self._impulses = (0.0 if self._impulses is None else self._impulses) + impulses

    def take(self, true: FloatArray, hidden: Collection[int] = ()) -> None:
        """Take the next sample.

        Args:
            true: True values of the sensors one after another, (size,); NaN where there is nothing to measure.
            hidden: Sensors, by their place in the group, whose target is not in view.
        """
        layout, number, time_s = self.layout, self.number, self.next_s
        given = self._given
        given[layout.values] = given[layout.true] = true
        if layout.cells:
            forces = true[layout.summed]
            given[layout.means] = 0.5 * (self._last + forces)
            self._last = forces
        sample = self._errors.sample(given, number)
        if math.isnan(true.dot(true)):
            sample[layout.valid] = [not np.isnan(true[part]).any() for part in layout.parts]
        for k in hidden:
            sample[layout.valid.start + k] = 0.0
        if self._impulses is not None:
            sample[layout.impulses] = self._impulses
            sample[layout.means] = given[layout.means] + self._impulses / self._interval_s
            self._impulses = None
        sample.setflags(write=False)  # control laws see parts of it
        if (after_s := self._errors.arrival_s(number)) < math.inf:
            heappush(self._under_way, (time_s + after_s, number, sample))
            self.arrival_s = self._under_way[0][0]
        self.number = number + 1
        self.next_s = self._first_s + self.number * self._interval_s

    def arrive(self, time_s: float) -> bool:
        """Let everything arrive that is due at a time; returns whether another sample is shown: the newest."""
        under_way, before = self._under_way, self.shown
        while self.arrival_s <= time_s + SCHEDULED_S:
            _, number, sample = heappop(under_way)
            self.arrival_s = under_way[0][0] if under_way else math.inf
            if number > self._shown_number:
                self.shown, self._shown_number = sample, number
        return self.shown is not before

    def may_show_unknown(self, time_s: float) -> list[str]:
        """Names of sensors whose newest arrived sample may be one that is not known; to be asked at each row after a gap."""
        names = []
        for k, (first_known, until_s) in tuple(self._unknown.items()):
            known = self._shown_number >= first_known
            if known or time_s >= until_s:  # the last of them has arrived, at this row at the latest
                del self._unknown[k]
            if not known:
                names.append(self.sensors[k].name)
        return names


def groups_of(sensors: Iterable[Sensor], seed: int) -> tuple[SensorGroup, ...]:
    """Groups of sensors whose samples are taken and arrive at the same times."""
    found: dict[tuple[float, float, float, str], list[Sensor]] = {}
    for sensor in sensors:
        at_random = sensor.dropout > 0.0 or sensor.delay_jitter_s > 0.0
        key = sensor.first_s, sensor.interval_s, sensor.delay_s, sensor.name if at_random else ""
        found.setdefault(key, []).append(sensor)
    return tuple(SensorGroup(each, seed) for each in found.values())
