"""Sensors that are sampled together: their samples are taken, delayed and shown as one array."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.sensing.sensor import BLOCK, Sensor, SensorErrors
from ffsm_mj.state import Stateful, fitting
from ffsm_mj.tolerances import SCHEDULED_S


class SampleLayout:
    """A sample is one array: measured values, true values, times, validity (0 or 1), impulses and means.

    The last two are those of force and torque sensors, of three components each; see
    :class:`~ffsm_mj.sensing.measured.Measurement`.

    Attributes:
        parts: Components of each sensor among the values.
        values: Measured values of all sensors.
        true: Their true values.
        times: Their times, s.
        valid: Whether what they measure is in view.
        cells: Place among the force and torque sensors of each that is one, by its place among all.
        summed: Components of these among the values.
        impulses: Their impulses since the sample before, N s or N m s.
        means: Their means since the sample before.
        size: Length of a sample.
    """

    def __init__(self, sensors: Sequence[Sensor]) -> None:
        """Lay out samples of these sensors."""
        ends = np.cumsum([sensor.size for sensor in sensors]).tolist()
        self.parts = [slice(end - sensor.size, end) for end, sensor in zip(ends, sensors, strict=True)]
        width, count = ends[-1], len(sensors)
        self.values, self.true = slice(0, width), slice(width, 2 * width)
        self.times = slice(self.true.stop, self.true.stop + count)
        self.valid = slice(self.times.stop, self.times.stop + count)
        summing = [k for k, sensor in enumerate(sensors) if sensor.sums]
        self.cells = {k: i for i, k in enumerate(summing)}
        components = [component for k in summing for component in range(self.parts[k].start, self.parts[k].stop)]
        self.summed: IntArray = np.array(components, dtype=np.intp)
        self.impulses = slice(self.valid.stop, self.valid.stop + len(components))
        self.means = slice(self.impulses.stop, self.impulses.stop + len(components))
        self.size = self.means.stop

    def sums(self, k: int) -> tuple[slice, slice]:
        """Impulse and mean of a sensor; empty if it is no force or torque sensor."""
        if k not in self.cells:
            return slice(0, 0), slice(0, 0)
        start = 3 * self.cells[k]
        impulse, mean = self.impulses.start + start, self.means.start + start
        return slice(impulse, impulse + 3), slice(mean, mean + 3)


class GroupErrors:
    """Errors of a group: those of most sensors are sums and products by component.

    The numbers are those of :class:`~ffsm_mj.sensing.sensor.SensorErrors`, bit for bit, whatever else there is.
    What does not depend on the true values is prepared for a block of samples: times, noise and biases, and the rotations by
    which orientations are off. Directions, misaligned sensors and biases that walk are left to it.
    """

    def __init__(self, sensors: Sequence[Sensor], seed: int, layout: SampleLayout) -> None:
        """Draw nothing yet.

        Args:
            sensors: The sensors; the samples of all are taken and arrive together, or there is only one.
            seed: Seed of the run.
            layout: Places in a sample.
        """
        errors = [SensorErrors(sensor, seed) for sensor in sensors]
        self.arrival_s = errors[0].arrival_s
        self._layout, self._first_s, self._interval_s = layout, sensors[0].first_s, sensors[0].interval_s
        count = layout.values.stop
        self._scale, self._bias, self._sigma = np.ones(count), np.zeros(count), np.zeros(count)
        self._low, self._high, self._quantum = np.full(count, -np.inf), np.full(count, np.inf), np.zeros(count)
        self._noisy: list[tuple[SensorErrors, slice]] = []
        self._others: list[tuple[SensorErrors, slice]] = []
        self._turned: list[tuple[SensorErrors, slice]] = []
        for sensor, error, part in zip(sensors, errors, layout.parts, strict=True):
            if not error.is_elementwise:
                (self._turned if error.turns_by_noise else self._others).append((error, part))
                continue
            self._scale[part], self._bias[part], self._sigma[part] = sensor.scale, sensor.bias, sensor.noise
            self._low[part], self._high[part], self._quantum[part] = sensor.low, sensor.high, sensor.quantum
            if sensor.noise.any():
                self._noisy.append((error, part))
        self._scales = bool((self._scale != 1.0).any())
        self._clips = bool(np.isfinite(self._low).any() or np.isfinite(self._high).any())
        self._rounds = self._quantum > 0.0
        self._coarse = bool(self._rounds.any())
        self._resolution = np.where(self._rounds, self._quantum, 1.0)
        self._block, self._prepared = -1, np.empty((0, layout.size))
        self._turns: list[tuple[slice, FloatArray]] = []

    def sample(self, true: FloatArray, number: int) -> FloatArray:
        """A sample by its number, (size,), valid and without impulses.

        Args:
            true: True values in the places of the measured and of the true ones, means in theirs, 0 elsewhere; changed.
            number: Its number.
        """
        block, line = divmod(number, BLOCK)
        if block != self._block:
            self._prepare(block)
        values = self._layout.values
        if self._scales:
            true[values] *= self._scale
        sample: FloatArray = self._prepared[line] + true
        if self._clips or self._coarse:
            sample[values] = self._limited(sample[values])
        if self._turned or self._others:
            exact = sample[self._layout.true]
            for part, turns in self._turns:
                mujoco.mju_mulQuat(sample[part], exact[part], turns[line])
            for error, part in self._others:
                sample[part] = error.measured(exact[part], number)
        return sample

    def _limited(self, values: FloatArray) -> FloatArray:
        """Values within the ranges, rounded."""
        if self._clips:
            np.clip(values, self._low, self._high, out=values)
        if self._coarse:
            values = np.where(self._rounds, self._resolution * np.round(values / self._resolution), values)
        return values

    def _prepare(self, block: int) -> None:
        """Prepare a block of samples: what is added to their true values."""
        layout, noise = self._layout, np.zeros((BLOCK, len(self._scale)))
        for error, part in self._noisy:
            noise[:, part] = error.noise.block(block)
        self._block, self._prepared = block, np.zeros((BLOCK, layout.size))
        self._prepared[:, layout.values] = self._bias + self._sigma * noise
        self._prepared[:, layout.true] = -0.0  # the number that changes no other, not even the sign of 0
        numbers = np.arange(BLOCK * block, BLOCK * (block + 1))
        self._prepared[:, layout.times] = (self._first_s + numbers * self._interval_s)[:, None]
        self._prepared[:, layout.valid] = 1.0
        self._turns = [(part, error.turns(block)) for error, part in self._turned]


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
        self._values = np.zeros(self.layout.size)
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
        values = self._values
        values[layout.values] = values[layout.true] = true
        if layout.cells:
            forces = true[layout.summed]
            values[layout.means] = 0.5 * (self._last + forces)
            self._last = forces
        sample = self._errors.sample(values, number)
        if math.isnan(true.dot(true)):
            sample[layout.valid] = [not np.isnan(true[part]).any() for part in layout.parts]
        for k in hidden:
            sample[layout.valid.start + k] = 0.0
        if self._impulses is not None:
            sample[layout.impulses] = self._impulses
            sample[layout.means] = values[layout.means] + self._impulses / self._interval_s
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
    groups: dict[tuple[float, float, float, str], list[Sensor]] = {}
    for sensor in sensors:
        at_random = sensor.dropout > 0.0 or sensor.delay_jitter_s > 0.0
        key = sensor.first_s, sensor.interval_s, sensor.delay_s, sensor.name if at_random else ""
        groups.setdefault(key, []).append(sensor)
    return tuple(SensorGroup(group, seed) for group in groups.values())
