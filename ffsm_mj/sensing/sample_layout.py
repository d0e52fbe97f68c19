"""Places in a sample of several sensors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ffsm_mj.arrays import IntArray
from ffsm_mj.sensing.sensor import Sensor


class SampleLayout:
    """A sample is one array: measured values, true values, times, validity (0 or 1), impulses and means.

    The last two are those of force and torque sensors, of three components each; see
    :class:`~ffsm_mj.sensing.measurement.Measurement`.

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
        found = [k for k, sensor in enumerate(sensors) if sensor.sums]
        self.cells = {k: i for i, k in enumerate(found)}
        components = [component for k in found for component in range(self.parts[k].start, self.parts[k].stop)]
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
