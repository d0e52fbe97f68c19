"""A sensor with everything known of it, from the model file with what the scenario sets; its errors and random numbers.

Errors come in the order in which they arise in hardware: misalignment, scale, bias, noise, range, quantum. Random numbers
are a function of (seed, name, sample), so that no other sensor and no restart changes them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from zlib import crc32

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import Faults
from ffsm_mj.model.sensors import ModelSensor
from ffsm_mj.model.system import System
from ffsm_mj.sensing.config import Components, FieldOfViewConfig, SensorConfig

_SHORTEST_S = 1e-6
"""Shortest interval between samples, s."""
BLOCK = 256
"""Samples that are drawn at once."""
_IDENTITY = np.array((1.0, 0.0, 0.0, 0.0))


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
        noise: Standard deviation of the white noise of a sample of each component, (errors,).
        low: Least value of each component.
        high: Greatest value of each component.
        quantum: Resolution; 0: none.
        dropout: Probability that a sample never arrives.
        field_of_view: Where what is measured must be; None: anywhere.
        occlusion: Whether geoms may hide it.
        reference: Attitude of the world axes in those in which a star tracker measures: a unit quaternion that turns vectors
            of world axes into them, (4,).
        part: Part of a force or torque that it measures, see :mod:`ffsm_mj.sensing.parts`; None: all of it.
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
    noise: FloatArray
    low: float
    high: float
    quantum: float
    dropout: float
    field_of_view: FieldOfViewConfig | None
    occlusion: bool
    reference: FloatArray
    part: str | None

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
    system: System,
    configs: Mapping[str, SensorConfig],
    control_period_s: float,
    duration_s: float,
    inertial: FloatArray = _IDENTITY,
) -> tuple[Sensor, ...]:
    """Sensors of the models with what the scenario sets, in MuJoCo's order.

    Args:
        system: Robot and objects.
        configs: What the scenario sets, by name.
        control_period_s: Interval of sensors that state none, s.
        duration_s: Duration of the run, s.
        inertial: Attitude of the world axes in the inertial axes of the central body: a unit quaternion, (4,).

    Raises:
        ScenarioFaults: There is no such sensor or site, or a value does not fit the sensor; paths in the scenario.
    """
    declared_sensors: dict[str, tuple[str, SensorConfig]] = {}
    sensors = []
    with Faults() as faults:
        for key, config in configs.items():
            with faults.below("sensors", key):
                declared_sensors[system.resolve("sensor", key)] = key, config
                if config.field_of_view is not None:
                    system.index("site", config.field_of_view.site)
        for name, model in system.sensors.items():
            key, config = declared_sensors.get(name, (name, SensorConfig()))
            size = int(system.mj.sensor_dim[system.mj.sensor(name).id])
            reasons = list(_faults(model, size, config))
            for of, text in reasons:
                faults.add(text, "sensors", key, of)
            if not reasons:
                reference = inertial if config.axes == "eci" else _IDENTITY
                sensors.append(_sensor(model, size, config, control_period_s, reference))
                late = [of for of in ("delay_s", "first_s") if getattr(config, of) is not None]
                if late and sensors[-1].earliest_s >= duration_s:
                    arrives = f"the first sample would arrive at {sensors[-1].earliest_s:g} s"
                    faults.add(f"{arrives}, not before the end ({duration_s:g} s)", "sensors", key, late[0])
    return tuple(sensors)


def _faults(model: ModelSensor, size: int, config: SensorConfig) -> list[tuple[str, str]]:
    """What does not fit a sensor, by key."""
    errors, kind = (size if model.shape == "vector" else 3), f"a <{model.kind}>"
    faults = []
    for key in ("bias", "scale_error", "noise", "noise_density"):
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


def _sensor(model: ModelSensor, size: int, config: SensorConfig, control_period_s: float, reference: FloatArray) -> Sensor:
    interval = _first(config.interval_s, model.interval_s) or control_period_s
    errors = size if model.shape == "vector" else 3
    cutoff = _first(config.cutoff, model.cutoff) or np.inf
    low, high = config.range or (-np.inf, np.inf)
    noise = _per_component(model.noise if config.noise is None else config.noise, errors)
    if config.noise_density is not None:
        noise = _per_component(config.noise_density, errors) / interval**0.5
    return Sensor(
        model=model,
        size=size,
        errors=errors,
        interval_s=interval,
        first_s=_first(config.first_s, model.first_s),
        delay_s=_first(config.delay_s, model.delay_s),
        delay_jitter_s=config.delay_jitter_s,
        misalignment=np.array(config.misalignment_rad),
        scale=1.0 + _per_component(config.scale_error, errors),
        bias=_per_component(config.bias, errors),
        walk=config.bias_walk * interval**0.5,
        noise=noise,
        low=max(low, -cutoff),
        high=min(high, cutoff),
        quantum=config.quantum or 0.0,
        dropout=config.dropout,
        field_of_view=config.field_of_view,
        occlusion=config.occlusion,
        reference=reference,
        part=config.part,
    )


def _first(stated: float | None, model: float) -> float:
    return model if stated is None else stated


def _per_component(value: Components, count: int) -> FloatArray:
    return np.broadcast_to(np.array(value, dtype=np.float64), count).copy()


class SensorErrors:
    """Turns true values of a sensor into what it measures; sample by sample, in any order.

    Attributes:
        noise: White noise.
        is_elementwise: Whether each component has an error of its own, the same in distribution at every sample.
        turns_by_noise: Whether it measures an orientation, off by a rotation of its own at every sample.
    """

    def __init__(self, sensor: Sensor, seed: int) -> None:
        """Draw nothing yet; ``seed`` is that of the run."""
        self._sensor = sensor
        self._turns = bool(sensor.misalignment.any())
        self._frame = _matrix(sensor.misalignment).T if self._turns else np.eye(3)
        self._scales = bool((sensor.scale != 1.0).any())
        self._clips = math.isfinite(sensor.low) or math.isfinite(sensor.high)
        self.noise = NoiseStream(seed, sensor.name, sensor.errors)
        self._walk = RandomWalk(NoiseStream(seed, f"{sensor.name}/bias_walk", sensor.errors), sensor.errors)
        self._dropout = NoiseStream(seed, f"{sensor.name}/dropout", 1)
        self._jitter = NoiseStream(seed, f"{sensor.name}/delay_jitter", 1)
        self.is_elementwise = sensor.model.shape == "vector" and not self._turns and sensor.walk == 0.0
        self._noisy = bool(sensor.noise.any())
        self._adds = self._noisy or sensor.walk > 0.0 or bool(sensor.bias.any())
        self.turns_by_noise = self._adds and sensor.model.shape == "rotation" and sensor.walk == 0.0

    def measured(self, value: FloatArray, sample: int) -> FloatArray:
        """What the sensor measures of a true value, (size,), at its sample of this number."""
        sensor = self._sensor
        if sensor.model.shape != "vector":
            return self._turned(value, sample) if self._adds else value
        if self._turns:
            value = self._frame @ value
        if self._scales:
            value = value * sensor.scale
        if self._adds:
            value = value + self._added(sample)
        if self._clips:
            value = np.clip(value, sensor.low, sensor.high)
        if sensor.quantum:
            value = sensor.quantum * np.round(value / sensor.quantum)
        return value

    def arrival_s(self, sample: int) -> float:
        """Time from a sample to its arrival, s; infinite if it never arrives."""
        sensor = self._sensor
        if sensor.dropout > 0.0 and self._dropout.uniform(sample)[0] < sensor.dropout:
            return math.inf
        if sensor.delay_jitter_s > 0.0:
            return sensor.delay_s + sensor.delay_jitter_s * float(self._jitter.uniform(sample)[0])
        return sensor.delay_s

    def turns(self, block: int) -> FloatArray:
        """Rotations by which the samples of a block are off, unit quaternions, (BLOCK, 4)."""
        turns = np.tile(_IDENTITY, (BLOCK, 1))
        for k, turn in enumerate(turns):
            mujoco.mju_quatIntegrate(turn, self._added(BLOCK * block + k), 1.0)
        return turns

    def _added(self, sample: int) -> FloatArray:
        """Bias and noise of a sample, (errors,)."""
        sensor, added = self._sensor, self._sensor.bias
        if sensor.walk > 0.0:
            added = added + sensor.walk * self._walk.at(sample)
        if self._noisy:
            added = added + sensor.noise * self.noise.normal(sample)
        return added

    def _turned(self, value: FloatArray, sample: int) -> FloatArray:
        """A unit quaternion or unit vector turned by the error, a rotation vector in the measured or reference frame."""
        error = self._added(sample)
        if self._sensor.model.shape == "direction":
            return _matrix(error) @ value
        turned = np.empty(4)
        mujoco.mju_mulQuat(turned, value, _quaternion(error))
        return turned


def _quaternion(rotation: FloatArray) -> FloatArray:
    quaternion = _IDENTITY.copy()
    mujoco.mju_quatIntegrate(quaternion, rotation, 1.0)
    return quaternion


def _matrix(rotation: FloatArray) -> FloatArray:
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, _quaternion(rotation))
    return matrix.reshape(3, 3)


class NoiseStream:
    """Random numbers of one purpose of one sensor.

    Numbers of a block come from a Philox generator whose key is (seed, CRC-32 of the name) and whose counter begins at the
    block, so that any sample can be drawn without those before it.
    """

    def __init__(self, seed: int, name: str, size: int) -> None:
        """Draw nothing yet.

        Args:
            seed: Seed of the run.
            name: Name of the sensor and of the purpose.
            size: Numbers per sample.
        """
        self._key = np.array((seed, crc32(name.encode())), dtype=np.uint64)
        self._size = size
        self._normal: tuple[int, FloatArray] = -1, np.empty((0, size))
        self._uniform: tuple[int, FloatArray] = -1, np.empty((0, size))

    def _generator(self, block: int) -> np.random.Generator:
        counter = np.array((0, 0, block, 0), dtype=np.uint64)
        return np.random.Generator(np.random.Philox(key=self._key, counter=counter))

    def block(self, block: int) -> FloatArray:
        """Standard normal numbers of a block of samples, (BLOCK, size)."""
        if self._normal[0] != block:
            self._normal = block, self._generator(block).standard_normal((BLOCK, self._size))
        return self._normal[1]

    def normal(self, sample: int) -> FloatArray:
        """Standard normal numbers of a sample, (size,)."""
        block, line = divmod(sample, BLOCK)
        numbers: FloatArray = self.block(block)[line]
        return numbers

    def uniform(self, sample: int) -> FloatArray:
        """Uniform numbers in [0, 1) of a sample, (size,)."""
        block, line = divmod(sample, BLOCK)
        if self._uniform[0] != block:
            self._uniform = block, self._generator(block).random((BLOCK, self._size))
        numbers: FloatArray = self._uniform[1][line]
        return numbers


class RandomWalk:
    """Random walk over the samples of a sensor: the sum of standard normal numbers up to a sample."""

    def __init__(self, stream: NoiseStream, size: int) -> None:
        """At zero before the first sample."""
        self._stream, self._size = stream, size
        self._sample, self._sum = -1, np.zeros(size)

    def at(self, sample: int) -> FloatArray:
        """Sum of the numbers of samples 1 to ``sample``, (size,): zero at sample 0."""
        if sample < self._sample:
            self._sample, self._sum = -1, np.zeros(self._size)
        while self._sample < sample:
            self._sample += 1
            if self._sample > 0:
                self._sum = self._sum + self._stream.normal(self._sample)
        return self._sum
