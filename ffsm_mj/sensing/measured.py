"""What a control law and an estimator are shown of all sensors, and what the estimator writes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import UnknownSensorError
from ffsm_mj.records.signals import Signal
from ffsm_mj.sensing.group import SensorGroup

_NONE = np.zeros(0)
Shown = tuple[FloatArray | None, ...]
"""Newest sample of each group that has arrived; None before the first."""


class Measurement(NamedTuple):
    """The newest sample of a sensor that has arrived; its arrays are read-only.

    Attributes:
        value: What was measured, in the unit of the sensor, (size,); NaN before the first arrival.
        time_s: Time of the sample; NaN before the first arrival.
        age_s: Time since then.
        valid: Whether a sample has arrived, and what it measures was in view.
        impulse_N_s: Impulse through a force sensor since the sample before, in the frame of its site, N s, (3,), or the
            angular impulse through a torque sensor, N m s; empty for other sensors.
        mean: Mean over the interval before the sample, impulses included, as a load cell gives it, (3,): half the sum of the
            values at its ends, plus the impulse over the interval; empty for other sensors.
    """

    value: FloatArray
    time_s: float
    age_s: float
    valid: bool
    impulse_N_s: FloatArray = _NONE
    mean: FloatArray = _NONE


class Place(NamedTuple):
    """Where a sensor is.

    Attributes:
        group: Its group.
        value: Its measured value in a sample.
        time: Time of the sample.
        valid: Whether the sample is valid.
        impulse: Impulse; empty for other sensors than those of forces and torques.
        mean: Mean; likewise.
    """

    group: int
    value: slice
    time: int
    valid: int
    impulse: slice
    mean: slice


def places_of(groups: Sequence[SensorGroup]) -> dict[str, Place]:
    """Place of each sensor by its full name."""
    places = {}
    for g, group in enumerate(groups):
        layout = group.layout
        for k, sensor in enumerate(group.sensors):
            validity = layout.times.start + k, layout.valid.start + k
            places[sensor.name] = Place(g, layout.parts[k], *validity, *layout.sums(k))
    return places


class Measured(Mapping[str, Measurement]):
    """Measurements of all sensors at a time, by full name; made where they are looked up, as read-only parts of samples."""

    __slots__ = ("_places", "_shown", "_time_s")

    def __init__(self, places: Mapping[str, Place], shown: Shown, time_s: float) -> None:
        """Show the newest sample of each group at a time."""
        self._places, self._shown, self._time_s = places, shown, time_s

    def __getitem__(self, name: str) -> Measurement:
        """Newest sample of a sensor.

        Raises:
            UnknownSensorError: No model has it; a ``KeyError`` too.
        """
        try:
            group, value, time, valid, impulse, mean = self._places[name]
        except KeyError:
            raise UnknownSensorError(name, self._places) from None
        sample = self._shown[group]
        if sample is None:
            return Measurement(np.full(value.stop - value.start, np.nan), math.nan, math.nan, False)
        time_s = float(sample[time])
        return Measurement(sample[value], time_s, self._time_s - time_s, bool(sample[valid]), sample[impulse], sample[mean])

    def __iter__(self) -> Iterator[str]:
        """Names of the sensors."""
        return iter(self._places)

    def __len__(self) -> int:
        """Number of sensors."""
        return len(self._places)


class Estimator(Protocol):
    """Estimates the state from measurements; control laws see a state of which they need not know that it is one.

    A class with a ``Config`` is built as ``cls(config, context)``, as a control law is; the instance carries its state. It
    has the pair ``get_state()`` and ``set_state(state)``, as a control law that remembers: an estimator is restored by
    ``start`` with the estimate of that time, and then ``set_state``.
    """

    @property
    def telemetry_signals(self) -> tuple[Signal, ...]:
        """What it reports of every call; a plain attribute of the class will do."""

    def start(self, data: Any) -> None:
        """Begin: ``data`` holds the initial state of the scenario, which is known."""

    def update(self, time_s: float, measured: Mapping[str, Measurement], events: Sequence[Any], data: Any) -> None:
        """Write the estimate at a time into ``data.qpos`` and ``data.qvel``, which hold that of the last call.

        Args:
            time_s: Time, s; ``data.time`` has that of the last call.
            measured: Newest sample of each sensor that has arrived, by full name.
            events: What is reported of the events since the last call: their class, time and pair.
            data: MuJoCo data of the model that control laws use, with the efforts held until now in ``ctrl``.
        """

    def telemetry(self) -> Sequence[float]:
        """Values of ``telemetry_signals`` after the last call."""
