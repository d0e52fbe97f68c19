"""What a control law is shown of all sensors."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import UnknownSensorError
from ffsm_mj.sensing.group import SensorGroup
from ffsm_mj.sensing.measurement import Measurement

Shown = tuple[FloatArray | None, ...]
"""Newest sample of each group that has arrived; None before the first."""


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
    found = {}
    for g, group in enumerate(groups):
        layout = group.layout
        for k, sensor in enumerate(group.sensors):
            own = layout.times.start + k, layout.valid.start + k
            found[sensor.name] = Place(g, layout.parts[k], *own, *layout.sums(k))
    return found


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
