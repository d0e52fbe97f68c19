"""Errors of a sensor, in the order in which they arise in hardware: misalignment, scale, bias, noise, range, quantum."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.sensing.noise import BLOCK, NoiseStream, RandomWalk
from ffsm_mj.sensing.sensor import Sensor

_IDENTITY = np.array((1.0, 0.0, 0.0, 0.0))


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
        self._adds = sensor.noise > 0.0 or sensor.walk > 0.0 or bool(sensor.bias.any())
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
        if sensor.noise > 0.0:
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
