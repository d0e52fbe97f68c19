"""Columns of sensors in the log: what the control law is shown, when it was measured, and what was true then."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.records.signals import Signal, identifier
from ffsm_mj.sensing.samples import Sample
from ffsm_mj.sensing.sensor import Sensor

_SUFFIXES = {
    "m/s^2": "m_s2",
    "rad/s^2": "rad_s2",
    "N m s": "N_m_s",
    "N m": "N_m",
    "rad/s": "rad_s",
    "m/s": "m_s",
}
_IMPULSES = {"force": ("N_s", "N s"), "torque": ("N_m_s", "N m s")}


class SensorColumns:
    """Columns of all sensors.

    Attributes:
        signals: Their signals.
        values: Their values, (number of signals,); NaN before the first arrival.
    """

    def __init__(self, sensors: Sequence[Sensor]) -> None:
        """Nothing has arrived."""
        found = [tuple(_signals(sensor)) for sensor in sensors]
        ends = np.cumsum([len(each) for each in found]).tolist()
        self._parts = [slice(end - len(each), end) for end, each in zip(ends, found, strict=True)]
        self.signals = tuple(signal for each in found for signal in each)
        self.values = np.full(len(self.signals), np.nan)

    def show(self, i: int, sample: Sample) -> None:
        """Show the newest sample of a sensor."""
        values, start, stop = self.values, self._parts[i].start, self._parts[i].stop
        size = len(sample.value)
        values[start : start + size], values[start + size : start + 2 * size] = sample.value, sample.true
        values[start + 2 * size], values[start + 2 * size + 1] = sample.time_s, sample.valid
        if len(sample.impulse):
            values[stop - 6 : stop - 3], values[stop - 3 : stop] = sample.impulse, sample.mean

    def take_over(self, i: int, logged: FloatArray) -> None:
        """Show of a sensor what a row of a log has, (number of signals,)."""
        self.values[self._parts[i]] = logged[self._parts[i]]

    def forget(self, _logged: FloatArray) -> None:
        """Show nothing, where a replay begins: at the start nothing has arrived, after a gap it is not known."""
        self.values[:] = np.nan


def component_names(sensor: Sensor) -> tuple[str, ...]:
    """Names of the components of a value; one empty name for a number."""
    if sensor.size == 1:
        return ("",)
    return ("w", "x", "y", "z") if sensor.size == 4 else ("x", "y", "z")


def column_names(sensor: Sensor) -> tuple[str, ...]:
    """Names of the columns of the measured value, without the group."""
    unit = _SUFFIXES.get(sensor.model.unit, sensor.model.unit)
    return tuple("_".join(filter(None, (identifier(sensor.name), part, unit))) for part in component_names(sensor))


def _signals(sensor: Sensor) -> Iterator[Signal]:
    name, unit = sensor.name, sensor.model.unit
    for key in column_names(sensor):
        yield Signal("sensor", key, unit, f"newest sample of {name} that has arrived", name)
    own, suffix = identifier(name), _SUFFIXES.get(unit, unit)
    for part in component_names(sensor):
        key = "_".join(filter(None, (own, "true", part, suffix)))
        yield Signal("sensor", key, unit, f"true value of {name} at the time of this sample", name)
    yield Signal("sensor", f"{own}_sampled_s", "s", f"time of this sample of {name}", name)
    yield Signal("sensor", f"{own}_valid", "", f"1 if what {name} measures was in view", name)
    if sensor.model.kind in _IMPULSES:
        ending, of = _IMPULSES[sensor.model.kind]
        for part in "xyz":
            yield Signal(
                "sensor", f"{own}_impulse_{part}_{ending}", of, f"impulse through {name} since its last sample", name
            )
        for part in "xyz":
            yield Signal("sensor", f"{own}_mean_{part}_{suffix}", unit, f"mean of {name} since its last sample", name)
