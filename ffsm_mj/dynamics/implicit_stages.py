"""Singly diagonally implicit Runge-Kutta method of order four, for forces that are stiff in the velocities.

The method is L-stable and stiffly accurate: the last stage is the end of the step (Hairer & Wanner, *Solving Ordinary
Differential Equations II*, sec. IV.6, table 6.5). Each stage satisfies

    v_i = v_0 + h sum_j<i a_ij vdot_j + h gamma vdot_i(q_i, v_i)

Stiff forces solve their part of this equation exactly, given the first terms; the rest converges by fixed-point iteration.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rotation_vector import rotation_vector_rate
from ffsm_mj.tolerances import EPSILON

if TYPE_CHECKING:
    from ffsm_mj.dynamics.forced_stepper import ForcedStepper

GAMMA = 0.25
"""Diagonal coefficient."""
COEFFICIENTS = (
    (),
    (1 / 2,),
    (17 / 50, -1 / 25),
    (371 / 1360, -137 / 2720, 15 / 544),
    (25 / 24, -49 / 48, 125 / 16, -85 / 12),
)
"""Coefficients of the previous stages, by stage."""
IMPLICIT_WEIGHTS = np.array((*COEFFICIENTS[-1], GAMMA))
"""Quadrature weights of the five stages."""
_PASSES = 30
"""Largest number of iterations of a stage; 3 or 4 reach rounding."""
_SETTLED = 2.0 * EPSILON
"""Iterations end at changes of the increments below this share of 1 + the largest rate."""
_NEARLY = 1e-10
"""The same for changes that do not get smaller."""


@dataclass(frozen=True)
class StageVelocity:
    """Velocity of an implicit stage: given + step_s * acceleration.

    Attributes:
        given: Terms without the acceleration of the stage, (nv,).
        step_s: Duration of the step times the diagonal coefficient, s.
    """

    given: FloatArray
    step_s: float


def integrate_implicitly(stepper: ForcedStepper, data: Any, duration_s: float) -> None:
    """Set the state at the end of a step.

    Args:
        stepper: Evaluates the forces; at the start of the step.
        data: MuJoCo data.
        duration_s: Duration of the step.
    """
    h, start_s = duration_s, data.time
    slopes: list[FloatArray] = []
    guess = np.stack((data.qvel, data.qacc))
    for coefficients in COEFFICIENTS:
        given = np.zeros_like(guess)
        for coefficient, slope in zip(coefficients, slopes, strict=True):
            given += h * coefficient * slope
        data.time = start_s + h * (GAMMA + sum(coefficients))
        guess = _stage(stepper, data, h * GAMMA, given, guess)
        slopes.append(guess)
    stepper.move_by(given + h * GAMMA * guess)


def _stage(stepper: ForcedStepper, data: Any, step_s: float, given: FloatArray, slope: FloatArray) -> FloatArray:
    """Rates and accelerations of a stage, (2, nv), at the increments ``given`` + ``step_s`` times themselves.

    Args:
        stepper: Evaluates the forces.
        data: MuJoCo data.
        step_s: Duration of the step times the diagonal coefficient, s.
        given: Increments of (rotation vectors and other coordinates, rates) by the previous stages, (2, nv).
        slope: First estimate.
    """
    rates, accelerations, before_it = data.qvel, data.qacc, stepper.start_rates + given[1]
    stepper.stage = StageVelocity(before_it, step_s)
    try:
        change = np.inf
        for _ in range(_PASSES):
            increment = given + step_s * slope
            stepper.move_by(increment)
            stepper.refresh()
            stepper.repeats = True
            before, slope = slope, np.stack((before_it + step_s * accelerations, accelerations))
            turned, spins = increment[0].tolist(), slope[0].tolist()
            for part in stepper.rotations:
                spins[part] = rotation_vector_rate(turned[part], spins[part])
            slope[0] = spins
            last, change = change, step_s * np.abs(slope - before).max() / (1.0 + np.abs(rates).max())
            if change <= _SETTLED or (change <= _NEARLY and change >= 0.5 * last):  # rounding
                break
    finally:
        stepper.stage, stepper.repeats = None, False
    return slope
