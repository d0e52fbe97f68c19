"""Joints, whose coordinates and rates are taken as they are measured."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ffsm_controllers.estimators.mekf.estimate import Estimate
from ffsm_controllers.estimators.readings import Reading
from ffsm_mj.controller_protocol import FloatArray, Measurement, Sensor


@dataclass(frozen=True)
class EncoderErrors:
    """Errors of measured coordinates and rates of joints; those of coordinates are independent from sample to sample.

    A place or attitude that is measured across joints is expected where their coordinates put it, so that their errors are
    errors of the expectation: noise of the measurement, with the covariance ``G diag(variances) G^T`` and G the derivative
    by the coordinates.

    Attributes:
        dofs: Degrees of freedom of the joints, (n,).
        variances: Variance of each coordinate, rad^2 or m^2; of ball joints of the rotation vector in the axes of the body.
        rate_variances: Variance of each rate, (rad/s)^2 or (m/s)^2.
    """

    dofs: tuple[int, ...]
    variances: FloatArray
    rate_variances: FloatArray


def encoder_errors(
    readings: Iterable[Reading], sensors: Mapping[str, Sensor], believed: Mapping[str, float]
) -> EncoderErrors:
    """Errors of all joints whose sensors have noise or are rounded.

    Args:
        readings: What is measured of joints.
        sensors: The sensors by name.
        believed: Standard deviations that the configuration states, by name.
    """
    coordinates, rates = dict[int, float](), dict[int, float]()
    for reading in readings:
        sensor = sensors[reading.sensor]
        dofs = range(reading.dofs.start, reading.dofs.stop)
        squared = np.broadcast_to(believed.get(reading.sensor, white_noise(sensor)), len(dofs)) ** 2
        if reading.measures_coordinates:
            coordinates |= zip(dofs, squared.tolist(), strict=True)
        rates |= zip(dofs, (reading.rate_gain(sensor.interval_s) * squared).tolist(), strict=True)
    uncertain = tuple(dof for dof in rates if max(coordinates.get(dof, 0.0), rates[dof]) > 0.0)
    variances = ([variance.get(dof, 0.0) for dof in uncertain] for variance in (coordinates, rates))
    return EncoderErrors(uncertain, *map(np.array, variances))


def white_noise(sensor: Sensor) -> FloatArray:
    """Standard deviation of white noise and rounding of each component of a sample, (errors,)."""
    return np.hypot(sensor.noise, sensor.quantum / math.sqrt(12.0))


def joint_values(reading: Reading, sample: Measurement, scratch: Any) -> tuple[FloatArray, FloatArray]:
    """Coordinates and rates of a joint by a sample; rates from differences are taken now, once, and NaN at the first sample.

    Args:
        reading: What the sensor measures.
        sample: Its sample.
        scratch: MuJoCo data to write into.
    """
    scratch.qvel[reading.dofs] = np.nan
    reading.write(sample, scratch)
    return scratch.qpos[reading.qpos].copy(), scratch.qvel[reading.dofs].copy()


def write_joint(estimate: Estimate, reading: Reading, coordinates: FloatArray, rates: FloatArray) -> None:
    """Write coordinates and rates by a sample of a joint into an estimate of its time; rates that are NaN stay."""
    estimate.data.qpos[reading.qpos] = coordinates
    if np.isfinite(rates).all():
        estimate.data.qvel[reading.dofs] = rates
