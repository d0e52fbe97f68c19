"""Update of an estimate with one measurement."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ffsm_controllers.estimators.mekf.estimate import Estimate
from ffsm_mj.controller_protocol import FloatArray


class Innovation(NamedTuple):
    """What a measurement said of an estimate.

    Attributes:
        nis: Normalised innovation squared; of a consistent filter chi-square with three degrees of freedom.
        used: Whether it passed the gate.
    """

    nis: float
    used: bool


def update(
    estimate: Estimate, innovation: FloatArray, slope: FloatArray, noise: FloatArray, largest_nis: float = math.inf
) -> Innovation:
    """Update an estimate, in Joseph's form, which keeps a covariance positive whatever rounding does to the gain.

    Args:
        estimate: The estimate.
        innovation: Measured less expected, (3,).
        slope: Derivative of the expected value by the error state, (3, size).
        noise: Covariance of the measurement, positive definite, (3, 3).
        largest_nis: The measurement is left out beyond this normalised innovation squared.
    """
    P = estimate.covariance
    shared = P @ slope.T
    S = slope @ shared + noise
    nis = float(innovation @ np.linalg.solve(S, innovation))
    if not nis <= largest_nis:
        return Innovation(nis, False)
    gain = np.linalg.solve(S, shared.T).T
    rest = np.eye(len(P)) - gain @ slope
    estimate.covariance = rest @ P @ rest.T + gain @ noise @ gain.T
    estimate.correct(gain @ innovation)
    return Innovation(nis, True)
