"""Singly diagonally implicit Runge-Kutta method of order four, for forces that are stiff in the velocities.

The method is L-stable and stiffly accurate: the last stage is the end of the step (Hairer & Wanner, *Solving Ordinary
Differential Equations II*, sec. IV.6, table 6.5). Each stage satisfies

    v_i = v_0 + h sum_j<i a_ij vdot_j + h gamma vdot_i(q_i, v_i)

Stiff forces solve their part of this equation exactly, given the first terms; the rest converges by fixed-point iteration.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ffsm_mj.arrays import FloatArray

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


@dataclass(frozen=True)
class StageVelocity:
    """Velocity of an implicit stage: given + step_s * acceleration.

    Attributes:
        given: Terms without the acceleration of the stage, (nv,).
        step_s: Duration of the step times the diagonal coefficient, s.
    """

    given: FloatArray
    step_s: float
