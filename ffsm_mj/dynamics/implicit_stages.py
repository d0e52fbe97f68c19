"""Implicit Runge-Kutta method Radau IIA of order five, for forces that are stiff in the velocities.

The method has three nodes and is L-stable and stiffly accurate: the last node is the end of the step. Its stage order is
three, so that it keeps most of its order where the stiffness is large, as after a point has begun to slip (Hairer & Wanner,
*Solving Ordinary Differential Equations II*, sec. IV.5 and IV.15). The nodes satisfy

    v_i = v_0 + sum_j W_ij vdot_j(q_j, v_j),   W = h A

Stiff forces solve their part of these equations at all nodes at once, given the rest, which converges by fixed-point
iteration; with stiff actuators by Newton's (:mod:`ffsm_mj.dynamics.stiff_actuators`). The iterations are in
:mod:`ffsm_mj._core.steppers`.
"""

from __future__ import annotations

from math import sqrt
from typing import Protocol

import numpy as np

from ffsm_mj.arrays import FloatArray

_ROOT = sqrt(6.0)
PLACES = np.array(((4.0 - _ROOT) / 10.0, (4.0 + _ROOT) / 10.0, 1.0))
"""Nodes, as shares of the step."""
COEFFICIENTS = np.array(
    (
        ((88 - 7 * _ROOT) / 360, (296 - 169 * _ROOT) / 1800, (-2 + 3 * _ROOT) / 225),
        ((296 + 169 * _ROOT) / 1800, (88 + 7 * _ROOT) / 360, (-2 - 3 * _ROOT) / 225),
        ((16 - _ROOT) / 36, (16 + _ROOT) / 36, 1 / 9),
    )
)
"""Coefficients A of the accelerations at the nodes (columns) in the velocities there (rows)."""
IMPLICIT_WEIGHTS = COEFFICIENTS[-1]
"""Quadrature weights of the three nodes."""


class StiffForces(Protocol):
    """Forces that are stiff in the velocities, evaluated at the nodes of an implicit step."""

    def corrections(self, step: ImplicitStep, accelerations: FloatArray) -> FloatArray | None:
        """Changes of the accelerations that solve the part of these forces, (3, nv); None where there is no solution.

        Args:
            step: The step.
            accelerations: Accelerations at the nodes under the forces evaluated there, (3, nv).
        """

    def active_rows(self) -> tuple[FloatArray, FloatArray]:
        """Rows that these forces hold at the first node, and accelerations by forces along them without, (n, nv) each."""


class ImplicitStep:
    """An implicit step, as the forces in its nodes see it.

    Attributes:
        weights: Coefficients of the accelerations in the velocities, h A, s, (3, 3).
        start_rates: Generalised velocity at the start, (nv,).
        node: The node that is evaluated now.
        stiff: Stiff forces, set by whoever evaluates them; None without any.
    """

    def __init__(self, duration_s: float, start_rates: FloatArray) -> None:
        """Begin a step."""
        self.weights, self.start_rates, self.node = duration_s * COEFFICIENTS, start_rates, 0
        self.stiff: StiffForces | None = None
