"""A sensor with everything known of it: from the model file, with what the scenario sets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import Fault, ScenarioFaults
from ffsm_mj.model.sensors import ModelSensor
from ffsm_mj.model.system import System
from ffsm_mj.sensing.sensor_config import Components, FieldOfViewConfig, SensorConfig

_SHORTEST_S = 1e-6
"""Shortest interval between samples, s."""


@dataclass(frozen=True)
class Sensor:
    """A sensor of the run.

    Attributes:
        model: The sensor of the model file.
        size: Number of components of its value.
        errors: Number of components of its errors: three for an orientation, whose value has four.
        interval_s: Time between samples, s.
        first_s: Time of the first sample, s.
        delay_s: Least time from a sample to its arrival, s.
        delay_jitter_s: Greatest further delay, s.
        misalignment: Rotation vector from the true frame to that of the sensor, rad, (3,).
        scale: Factor of each component, (errors,).
        bias: Constant error of each component, (errors,).
        walk: Standard deviation of the change of the bias from sample to sample.
        noise: Standard deviation of the white noise of a sample.
        low: Least value of each component.
        high: Greatest value of each component.
        quantum: Resolution; 0: none.
        dropout: Probability that a sample never arrives.
        field_of_view: Where what is measured must be; None: anywhere.
        occlusion: Whether geoms may hide it.
    """

    model: ModelSensor
    size: int
    errors: int
    interval_s: float
    first_s: float
    delay_s: float
    delay_jitter_s: float
    misalignment: FloatArray
    scale: FloatArray
    bias: FloatArray
    walk: float
    noise: float
    low: float
    high: float
    quantum: float
    dropout: float
    field_of_view: FieldOfViewConfig | None
    occlusion: bool

    @property
    def name(self) -> str:
        """Full name."""
        return self.model.name

    @property
    def earliest_s(self) -> float:
        """Earliest arrival of a sample, s."""
        return self.first_s + self.delay_s

    @property
    def sums(self) -> bool:
        """Whether it measures forces or torques, and so also impulses and means between samples."""
        return self.model.kind in ("force", "torque")


def sensors_of(
    system: System, configs: Mapping[str, SensorConfig], control_period_s: float, duration_s: float
) -> tuple[Sensor, ...]:
    """Sensors of the models with what the scenario sets, in MuJoCo's order.

    Args:
        system: Robot and objects.
        configs: What the scenario sets, by name.
        control_period_s: Interval of sensors that state none, s.
        duration_s: Duration of the run, s.

    Raises:
        ScenarioFaults: There is no such sensor or site, or a value does not fit the sensor; paths in the scenario.
    """
    found: dict[str, tuple[str, SensorConfig]] = {}
    faults: list[Fault] = []
    for key, config in configs.items():
        try:
            found[system.resolve("sensor", key)] = key, config
            if config.field_of_view is not None:
                system.index("site", config.field_of_view.site)
        except LookupError as error:
            faults.append(Fault(str(error.args[0]), ("sensors", key)))
    made = []
    for name, model in system.sensors.items():
        key, config = found.get(name, (name, SensorConfig()))
        size = int(system.mj.sensor_dim[system.mj.sensor(name).id])
        reasons = list(_faults(model, size, config))
        faults += [Fault(text, ("sensors", key, of)) for of, text in reasons]
        if not reasons:
            made.append(_sensor(model, size, config, control_period_s))
            late = [of for of in ("delay_s", "first_s") if getattr(config, of) is not None]
            if late and made[-1].earliest_s >= duration_s:
                text = f"the first sample would arrive at {made[-1].earliest_s:g} s, not before the end ({duration_s:g} s)"
                faults.append(Fault(text, ("sensors", key, late[0])))
    if faults:
        raise ScenarioFaults(faults)
    return tuple(made)


def _faults(model: ModelSensor, size: int, config: SensorConfig) -> list[tuple[str, str]]:
    """What does not fit a sensor, by key."""
    errors, kind = (size if model.shape == "vector" else 3), f"a <{model.kind}>"
    faults = []
    for key in ("bias", "scale_error"):
        value = getattr(config, key)
        if isinstance(value, tuple) and len(value) != errors:
            faults.append((key, f"has {len(value)} numbers; the errors of {kind} have {errors} components"))
    if any(config.misalignment_rad) and (size != 3 or model.shape != "vector"):
        faults.append(("misalignment_rad", f"only vectors of three components have a frame, and {kind} has none"))
    for key in ("scale_error", "range", "cutoff", "quantum"):
        if model.shape != "vector" and getattr(config, key) not in (None, 0.0):
            faults.append((key, f"has no meaning for {kind}, whose value has unit length"))
    if config.field_of_view is not None and not model.kind.startswith("frame"):
        faults.append(("field_of_view", f"only frame sensors see something at a place, and {kind} does not"))
    interval = config.interval_s if config.interval_s is not None else model.interval_s
    if 0.0 < interval < _SHORTEST_S:
        faults.append(("interval_s", f"{interval:g} s is shorter than {_SHORTEST_S:g} s"))
    return faults


def _sensor(model: ModelSensor, size: int, config: SensorConfig, control_period_s: float) -> Sensor:
    interval = _first(config.interval_s, model.interval_s) or control_period_s
    errors = size if model.shape == "vector" else 3
    cutoff = _first(config.cutoff, model.cutoff) or np.inf
    low, high = config.range or (-np.inf, np.inf)
    noise = config.noise_density / interval**0.5 if config.noise_density is not None else _first(config.noise, model.noise)
    return Sensor(
        model=model,
        size=size,
        errors=errors,
        interval_s=interval,
        first_s=_first(config.first_s, model.first_s),
        delay_s=_first(config.delay_s, model.delay_s),
        delay_jitter_s=config.delay_jitter_s,
        misalignment=np.array(config.misalignment_rad),
        scale=1.0 + _each(config.scale_error, errors),
        bias=_each(config.bias, errors),
        walk=config.bias_walk * interval**0.5,
        noise=noise,
        low=max(low, -cutoff),
        high=min(high, cutoff),
        quantum=config.quantum or 0.0,
        dropout=config.dropout,
        field_of_view=config.field_of_view,
        occlusion=config.occlusion,
    )


def _first(given: float | None, model: float) -> float:
    return model if given is None else given


def _each(value: Components, count: int) -> FloatArray:
    return np.broadcast_to(np.array(value, dtype=np.float64), count).copy()
