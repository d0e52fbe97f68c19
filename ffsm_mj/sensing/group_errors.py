"""Errors of sensors that are sampled together, as arrays over their components."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.sensing.noise import BLOCK
from ffsm_mj.sensing.sensor import Sensor
from ffsm_mj.sensing.sensor_errors import SensorErrors


class GroupErrors:
    """Errors of a group: those of most sensors are sums and products by component.

    The numbers are those of :class:`~ffsm_mj.sensing.sensor_errors.SensorErrors`, bit for bit, whatever else there is.
    Rotations by which orientations are off are made for a block of samples; directions, misaligned sensors and biases that
    walk are left to it.
    """

    def __init__(self, sensors: Sequence[Sensor], seed: int, parts: Sequence[slice]) -> None:
        """Draw nothing yet.

        Args:
            sensors: The sensors; the samples of all arrive together, or there is only one.
            seed: Seed of the run.
            parts: Components of each among the values of all.
        """
        errors = [SensorErrors(sensor, seed) for sensor in sensors]
        self.arrival_s = errors[0].arrival_s
        count = parts[-1].stop
        self._scale, self._bias, self._sigma = np.ones(count), np.zeros(count), np.zeros(count)
        self._low, self._high, self._quantum = np.full(count, -np.inf), np.full(count, np.inf), np.zeros(count)
        self._noisy: list[tuple[SensorErrors, slice]] = []
        self._others: list[tuple[SensorErrors, slice]] = []
        self._turned: list[tuple[SensorErrors, slice]] = []
        for sensor, each, part in zip(sensors, errors, parts, strict=True):
            if not each.is_elementwise:
                (self._turned if each.turns_by_noise else self._others).append((each, part))
                continue
            self._scale[part], self._bias[part], self._sigma[part] = sensor.scale, sensor.bias, sensor.noise
            self._low[part], self._high[part], self._quantum[part] = sensor.low, sensor.high, sensor.quantum
            if sensor.noise > 0.0:
                self._noisy.append((each, part))
        self._clips = bool(np.isfinite(self._low).any() or np.isfinite(self._high).any())
        self._rounds = self._quantum > 0.0
        self._coarse = bool(self._rounds.any())
        self._resolution = np.where(self._rounds, self._quantum, 1.0)
        self._block, self._added = -1, np.empty((0, count))
        self._turns: list[tuple[slice, FloatArray]] = []

    def measured(self, true: FloatArray, number: int) -> FloatArray:
        """Measured values of a sample by its number, for true values of the sensors one after another."""
        block, line = divmod(number, BLOCK)
        if block != self._block:
            self._draw(block)
        found: FloatArray = true * self._scale
        found += self._added[line]
        if self._clips:
            np.clip(found, self._low, self._high, out=found)
        if self._coarse:
            found = np.where(self._rounds, self._resolution * np.round(found / self._resolution), found)
        for part, turns in self._turns:
            mujoco.mju_mulQuat(found[part], true[part], turns[line])
        for each, part in self._others:
            found[part] = each.measured(true[part], number)
        return found

    def _draw(self, block: int) -> None:
        """Draw the errors of a block of samples."""
        noise = np.zeros((BLOCK, len(self._scale)))
        for each, part in self._noisy:
            noise[:, part] = each.noise.block(block)
        self._block, self._added = block, self._bias + self._sigma * noise
        self._turns = [(part, each.turns(block)) for each, part in self._turned]
