"""Errors of sensors that are sampled together, as arrays over their components."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.sensing.noise import BLOCK
from ffsm_mj.sensing.sample_layout import SampleLayout
from ffsm_mj.sensing.sensor import Sensor
from ffsm_mj.sensing.sensor_errors import SensorErrors


class GroupErrors:
    """Errors of a group: those of most sensors are sums and products by component.

    The numbers are those of :class:`~ffsm_mj.sensing.sensor_errors.SensorErrors`, bit for bit, whatever else there is.
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
        for sensor, each, part in zip(sensors, errors, layout.parts, strict=True):
            if not each.is_elementwise:
                (self._turned if each.turns_by_noise else self._others).append((each, part))
                continue
            self._scale[part], self._bias[part], self._sigma[part] = sensor.scale, sensor.bias, sensor.noise
            self._low[part], self._high[part], self._quantum[part] = sensor.low, sensor.high, sensor.quantum
            if sensor.noise > 0.0:
                self._noisy.append((each, part))
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
            for each, part in self._others:
                sample[part] = each.measured(exact[part], number)
        return sample

    def _limited(self, found: FloatArray) -> FloatArray:
        """Values within the ranges, rounded."""
        if self._clips:
            np.clip(found, self._low, self._high, out=found)
        if self._coarse:
            found = np.where(self._rounds, self._resolution * np.round(found / self._resolution), found)
        return found

    def _prepare(self, block: int) -> None:
        """Prepare a block of samples: what is added to their true values."""
        layout, noise = self._layout, np.zeros((BLOCK, len(self._scale)))
        for each, part in self._noisy:
            noise[:, part] = each.noise.block(block)
        self._block, self._prepared = block, np.zeros((BLOCK, layout.size))
        self._prepared[:, layout.values] = self._bias + self._sigma * noise
        self._prepared[:, layout.true] = -0.0  # the number that changes no other, not even the sign of 0
        numbers = np.arange(BLOCK * block, BLOCK * (block + 1))
        self._prepared[:, layout.times] = (self._first_s + numbers * self._interval_s)[:, None]
        self._prepared[:, layout.valid] = 1.0
        self._turns = [(part, each.turns(block)) for each, part in self._turned]
