"""Accelerations of wheels for a rate of change of their angular momentum, and what saturated ones cannot take."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ffsm_mj.controller_protocol import FloatArray

_RANK = 1e-10
_FULL = 1e-3
"""A wheel this close to its maximum speed, relative, is full."""


class WheelShare(NamedTuple):
    """What wheels take of a demand.

    Attributes:
        accelerations: Of each wheel, rad/s^2, (n,).
        full: Wheels that are at their maximum speed in the direction of the demand, (n,).
        left: What they cannot take, N m, (3,).
    """

    accelerations: FloatArray
    full: npt.NDArray[np.bool_]
    left: FloatArray


def wheel_share(
    columns: FloatArray, demand: FloatArray, rates: FloatArray, saturation: FloatArray, period_s: float
) -> WheelShare:
    """Least-norm share of wheels in a demand; one that would pass its maximum speed takes what fits, the others the rest.

    Args:
        columns: Angular momentum per rate of each wheel, (3, n).
        demand: Rate of change of angular momentum, N m, (3,).
        rates: Rates of the wheels, rad/s, (n,).
        saturation: Maximum speed of each, infinite without one, (n,).
        period_s: Time for which the accelerations last, s.
    """
    share, free = np.zeros(len(rates)), np.ones(len(rates), dtype=np.bool_)
    while free.any():
        rest = demand - columns[:, ~free] @ share[~free]
        share[free] = np.linalg.lstsq(columns[:, free], rest, rcond=_RANK)[0]
        beyond = free & (np.abs(rates + period_s * share) > saturation) & (share * rates > 0.0)
        if not beyond.any():
            break
        room = np.maximum(saturation - np.abs(rates), 0.0)
        share[beyond] = np.copysign(room[beyond] / period_s, rates[beyond])
        free &= ~beyond
    full = ~free & (np.abs(rates) >= (1.0 - _FULL) * saturation)
    return WheelShare(share, full, demand - columns @ share)
