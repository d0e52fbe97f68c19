"""Columns of sensors in the log: what the control law is shown, when it was measured, and what was true then."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.records.signals import Signal, identifier
from ffsm_mj.sensing.group import SensorGroup
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

    def __init__(self, sensors: Sequence[Sensor], groups: Sequence[SensorGroup]) -> None:
        """Nothing has arrived.

        Args:
            sensors: The sensors, in the order of the columns.
            groups: The same in groups.
        """
        by_sensor = [tuple(_signals(sensor)) for sensor in sensors]
        ends = np.cumsum([len(of_sensor) for of_sensor in by_sensor]).tolist()
        pairs = zip(sensors, ends, by_sensor, strict=True)
        self._parts = {sensor.name: slice(end - len(of_sensor), end) for sensor, end, of_sensor in pairs}
        self._places = [self._columns_of(group) for group in groups]
        self.signals = tuple(signal for of_sensor in by_sensor for signal in of_sensor)
        self.values = np.full(len(self.signals), np.nan)

    def _columns_of(self, group: SensorGroup) -> IntArray:
        """Column of each number of a sample of a group."""
        layout, columns = group.layout, np.empty(group.layout.size, dtype=np.intp)
        for k, sensor in enumerate(group.sensors):
            part, size = self._parts[sensor.name], sensor.size
            of_sensor = np.arange(part.start, part.stop)
            columns[layout.values][layout.parts[k]] = of_sensor[:size]
            columns[layout.true][layout.parts[k]] = of_sensor[size : 2 * size]
            columns[layout.times.start + k], columns[layout.valid.start + k] = of_sensor[2 * size : 2 * size + 2]
            if k in layout.cells:
                impulse, mean = layout.sums(k)
                columns[impulse], columns[mean] = of_sensor[-6:-3], of_sensor[-3:]
        return columns

    def show(self, group: int, sample: FloatArray) -> None:
        """Show the newest sample of a group."""
        self.values[self._places[group]] = sample

    def take_over(self, name: str, logged: FloatArray) -> None:
        """Show of a sensor what a row of a log has, (number of signals,)."""
        self.values[self._parts[name]] = logged[self._parts[name]]

    def forget(self) -> None:
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
    sensor_name, suffix = identifier(name), _SUFFIXES.get(unit, unit)
    for part in component_names(sensor):
        key = "_".join(filter(None, (sensor_name, "true", part, suffix)))
        yield Signal("sensor", key, unit, f"true value of {name} at the time of this sample", name)
    yield Signal("sensor", f"{sensor_name}_sampled_s", "s", f"time of this sample of {name}", name)
    yield Signal("sensor", f"{sensor_name}_valid", "", f"1 if what {name} measures was in view", name)
    if sensor.model.kind in _IMPULSES:
        ending, of = _IMPULSES[sensor.model.kind]
        for part in "xyz":
            yield Signal(
                "sensor", f"{sensor_name}_impulse_{part}_{ending}", of, f"impulse through {name} since its last sample", name
            )
        for part in "xyz":
            yield Signal(
                "sensor", f"{sensor_name}_mean_{part}_{suffix}", unit, f"mean of {name} since its last sample", name
            )
