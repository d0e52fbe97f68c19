"""Measured values of all sensors that are sampled at one instant, as arrays over their components."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.sensing.noise import BLOCK
from ffsm_mj.sensing.samples import Samples


class Batch:
    """Sensors that are due together: the errors of most are sums and products by component.

    The numbers are those of :class:`~ffsm_mj.sensing.sensor_errors.SensorErrors`, bit for bit, whatever else there is.
    Orientations, misaligned sensors and biases that walk are left to it.
    """

    def __init__(self, samples: Sequence[Samples], parts: Sequence[slice]) -> None:
        """Bind to samples and to the parts of the values of all sensors that are theirs."""
        self.samples = tuple(samples)
        places = [np.arange(part.start, part.stop) for part in parts]
        self.places = np.concatenate(places)
        ends = np.cumsum([len(place) for place in places]).tolist()
        self.parts = [slice(end - len(place), end) for end, place in zip(ends, places, strict=True)]
        pairs = list(zip(samples, self.parts, strict=True))
        self._others = [pair for pair in pairs if not pair[0].errors.is_elementwise]
        plain = [pair for pair in pairs if pair[0].errors.is_elementwise]
        count = int(ends[-1])
        self._scale, self._bias, self._sigma = np.ones(count), np.zeros(count), np.zeros(count)
        self._low, self._high, self._quantum = np.full(count, -np.inf), np.full(count, np.inf), np.zeros(count)
        for each, part in plain:
            sensor = each.sensor
            self._scale[part], self._bias[part], self._sigma[part] = sensor.scale, sensor.bias, sensor.noise
            self._low[part], self._high[part], self._quantum[part] = sensor.low, sensor.high, sensor.quantum
        self._noisy = [(each, part) for each, part in plain if each.sensor.noise > 0.0]
        self._clips = bool(np.isfinite(self._low).any() or np.isfinite(self._high).any())
        self._rounds = self._quantum > 0.0
        self._coarse = bool(self._rounds.any())
        self._resolution = np.where(self._rounds, self._quantum, 1.0)
        self._block: tuple[int, FloatArray] = -1, np.empty((0, count))

    def measured(self, values: FloatArray) -> FloatArray:
        """Measured values of the next samples, for true values of these sensors one after another."""
        found = values * self._scale + (self._bias + self._sigma * self._noise())
        if self._clips:
            found = np.clip(found, self._low, self._high)
        if self._coarse:
            found = np.where(self._rounds, self._resolution * np.round(found / self._resolution), found)
        for each, part in self._others:
            found[part] = each.errors.measured(values[part], each.number)
        return found

    def _noise(self) -> FloatArray:
        """Standard normal numbers of the components; those of a block of samples together if the numbers agree."""
        numbers = {each.number for each, _ in self._noisy}
        if len(numbers) == 1:
            block, line = divmod(numbers.pop(), BLOCK)
            if self._block[0] != block:
                table = np.zeros((BLOCK, len(self._scale)))
                for each, part in self._noisy:
                    table[:, part] = each.errors.noise.block(block)
                self._block = block, table
            row: FloatArray = self._block[1][line]
            return row
        drawn = np.zeros(len(self._scale))
        for each, part in self._noisy:
            drawn[part] = each.errors.noise.normal(each.number)
        return drawn
