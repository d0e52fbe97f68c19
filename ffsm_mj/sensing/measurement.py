"""A measurement, as shown to a control law."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import FloatArray

_NONE = np.zeros(0)


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
