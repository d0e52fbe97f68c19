"""Timing of sensors and actuators in a model file, read as numbers: MuJoCo would keep delayed values in its state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class SensorTiming:
    """Timing and cutoff of a sensor as its file has them.

    Attributes:
        interval_s: Time between samples; 0: not stated.
        phase_s: Time of a sample.
        delay_s: Time from a sample to its arrival.
        buffered: Whether MuJoCo would keep samples, and so use interval and delay.
        cutoff: Greatest absolute value; 0: none.
    """

    interval_s: float
    phase_s: float
    delay_s: float
    buffered: bool
    cutoff: float


@dataclass(frozen=True)
class Timing:
    """Timing of the sensors and actuators of a model file.

    Attributes:
        sensors: Of each sensor, by its name in the file.
        actuator_delays_s: Delay of each actuator that has one, by its name in the file, s.
        interpolated: Actuators and sensors between whose delayed values MuJoCo would interpolate, as text.
    """

    sensors: dict[str, SensorTiming]
    actuator_delays_s: dict[str, float]
    interpolated: tuple[str, ...]


def take_timing(spec: Any) -> Timing:
    """Read the timing in a specification, whose elements have names, and set it to zero there.

    MuJoCo would keep delayed values in its state, and refuses a delay without a buffer for it.
    """
    sensors, delays = {}, {}
    interpolated = [
        f"{kind} {each.name!r}"
        for kind, listed in (("sensor", spec.sensors), ("actuator", spec.actuators))
        for each in listed
        if each.interp and each.nsample
    ]
    for each in spec.sensors:
        every, phase = map(float, each.interval)
        sensors[each.name] = SensorTiming(every, phase, float(each.delay), bool(each.nsample), float(each.cutoff))
        each.interval, each.delay, each.nsample, each.cutoff = [0.0, 0.0], 0.0, 0, 0.0
    for each in spec.actuators:
        if each.delay > 0.0:
            delays[each.name] = float(each.delay)
        each.delay, each.nsample = 0.0, 0
    return Timing(sensors, delays, tuple(interpolated))
