"""Measured values of sensors, made again from their true values and the random numbers of their own channel.

The noise of a channel is documented in docs/sensors.md: sample n of a sensor takes row n mod 256 of the table of 256 rows of
standard normal numbers that NumPy's Philox draws with the key (seed, CRC-32 of the sensor's name) and the counter
(0, 0, n div 256, 0). Random walks of biases, lost samples and jitter of delays have names of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from zlib import crc32

import numpy as np

from ffsm_mj.verification.independent.finding import Array, Finding, Worst
from ffsm_mj.verification.independent.logged_rows import LoggedRows
from ffsm_mj.verification.independent.sensor_settings import SensorSettings
from ffsm_mj.verification.independent.tolerances import SENSOR_NOISE

_BLOCK = 256


class SensorErrors:
    """Makes the measured values of one sensor again."""

    def __init__(self, sensor: SensorSettings) -> None:
        """Take its errors from models and scenario."""
        self.sensor, of = sensor, sensor.value
        self._size = len(sensor.true) if sensor.model.shape == "vector" else 3
        self._draws = cache(self._drawn)
        interval_s = sensor.interval_s
        density = of("noise_density", None)
        self._noise = of("noise", sensor.model.noise) if density is None else density / np.sqrt(interval_s)
        self._walk = of("bias_walk", 0.0) * np.sqrt(interval_s)
        self._bias, self._scale = (np.broadcast_to(of(key, 0.0), self._size) for key in ("bias", "scale_error"))
        self._frame = _turn(np.array([of("misalignment_rad", (0.0, 0.0, 0.0))], dtype=float))[0].T
        cutoff = of("cutoff", sensor.model.cutoff) or np.inf
        low, high = of("range", (-np.inf, np.inf))
        self._low, self._high, self._quantum = max(low, -cutoff), min(high, cutoff), of("quantum", 0.0)

    def _drawn(self, purpose: str, block: int) -> Array:
        """Normal numbers of a block of samples, (256, size); of lost samples and jitter uniform ones, (256, 1)."""
        key = np.array((self.sensor.seed, crc32((self.sensor.name + purpose).encode())), dtype=np.uint64)
        generator = np.random.Generator(np.random.Philox(key=key, counter=np.array((0, 0, block, 0), dtype=np.uint64)))
        if purpose in ("/dropout", "/delay_jitter"):
            return np.asarray(generator.random((_BLOCK, 1)))
        return generator.standard_normal((_BLOCK, self._size))

    def draws(self, purpose: str, samples: Array) -> Array:
        """Random numbers of some samples, (n, size)."""
        numbers = samples.astype(int)
        blocks = numbers // _BLOCK
        out = np.empty((len(numbers), self._draws(purpose, 0).shape[1]))
        for block in np.unique(blocks):
            out[blocks == block] = self._draws(purpose, int(block))[numbers[blocks == block] % _BLOCK]
        return out

    def errors(self, samples: Array) -> Array:
        """Bias, its walk and noise of some samples, (n, size)."""
        added = np.tile(self._bias, (len(samples), 1))
        if self._walk:
            every = np.arange(1.0, max(float(samples.max()), 1.0) + 1.0)
            path = np.vstack((np.zeros(self._size), np.cumsum(self.draws("/bias_walk", every), axis=0)))
            added += self._walk * path[samples.astype(int)]
        return np.asarray(added + self._noise * self.draws("", samples) if self._noise else added)

    def residual(self, samples: Array, true: Array, measured: Array) -> Array:
        """Measured values less those made again, (n, number of components)."""
        shape, errors = self.sensor.model.shape, self.errors(samples)
        if shape == "rotation":
            return measured - _product(true, _quaternions(errors))
        if shape == "direction":
            return np.asarray(measured - np.einsum("nij,nj->ni", _turn(errors), true))
        value = true @ self._frame.T if true.shape[1] == 3 else true
        value = np.clip(value * (1.0 + self._scale) + errors, self._low, self._high)
        if not self._quantum:
            return np.asarray(measured - value)
        away = measured - self._quantum * np.round(value / self._quantum)
        # A value half-way between two steps, to rounding, may be rounded to either.
        tie = np.abs(np.abs(value / self._quantum % 1.0) - 0.5) < 1e-9
        return np.where(tie & (np.abs(away) < 1.5 * self._quantum), 0.0, away)


def sensor_noise(rows: LoggedRows, sensors: Sequence[SensorSettings]) -> list[Finding]:
    """Worst difference of measured values from those made again, each in the unit of its sensor."""
    worst, kept = Worst(SENSOR_NOISE), rows.kept
    for sensor in sensors:
        shown = [kept[number] for number, _ in kept.samples[sensor.sampled].kept if number in kept]
        block = np.array([row for row in shown if not np.isnan(row[list(sensor.true)]).any()])
        if not len(block):
            continue
        true, measured = block[:, list(sensor.true)], block[:, list(sensor.measured)]
        away = np.abs(SensorErrors(sensor).residual(sensor.numbers(block), true, measured)).max(axis=1)
        at = int(np.argmax(np.where(np.isnan(away), np.inf, away)))
        worst.add(sensor.name, away[at], true, float(block[at, sensor.sampled]), sensor.model.unit)
    return worst.found


def _quaternions(turns: Array) -> Array:
    """Unit quaternions of rotation vectors, (n, 4)."""
    angles = np.linalg.norm(turns, axis=1, keepdims=True)
    # sin(a / 2) / a, by NumPy's sin(pi x) / (pi x).
    return np.hstack((np.cos(0.5 * angles), 0.5 * np.sinc(0.5 * angles / np.pi) * turns))


def _product(first: Array, second: Array) -> Array:
    """Products of quaternions, (n, 4)."""
    a, u, b, v = first[:, :1], first[:, 1:], second[:, :1], second[:, 1:]
    return np.hstack((a * b - np.sum(u * v, axis=1, keepdims=True), a * v + b * u + np.cross(u, v)))


def _turn(turns: Array) -> Array:
    """Rotation matrices of rotation vectors, (n, 3, 3)."""
    w, v = (part for part in np.split(_quaternions(turns), (1,), axis=1))
    cross = np.cross(np.eye(3)[None], v[:, None, :])  # rows e_i x v
    outer = v[:, :, None] * v[:, None, :]
    return np.asarray((2.0 * w[..., None] ** 2 - 1.0) * np.eye(3) + 2.0 * outer + 2.0 * w[..., None] * cross)
