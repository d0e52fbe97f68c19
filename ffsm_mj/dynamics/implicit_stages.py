"""Implicit Runge-Kutta method Radau IIA of order five, for forces that are stiff in the velocities.

The method has three nodes and is L-stable and stiffly accurate: the last node is the end of the step. Its stage order is
three, so that it keeps most of its order where the stiffness is large, as after a point has begun to slip (Hairer & Wanner,
*Solving Ordinary Differential Equations II*, sec. IV.5 and IV.15). The nodes satisfy

    v_i = v_0 + sum_j W_ij vdot_j(q_j, v_j),   W = h A

Stiff forces solve their part of these equations at all nodes at once, given the rest, which converges by fixed-point
iteration; with stiff actuators by Newton's (:mod:`ffsm_mj.dynamics.stiff_actuators`).
"""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.tolerances import EPSILON

if TYPE_CHECKING:
    from ffsm_mj._core.steppers import ForcedStepper


def rotation_vector_rate(turned: list[float], spin: list[float]) -> tuple[float, float, float]:
    """Rate of the rotation vector t for a body-frame angular velocity w: w + t x w / 2 + t x (t x w) / 12.

    Runge-Kutta methods integrate rotations in these vectors (Runge-Kutta-Munthe-Kaas). The inverse of the exponential map's
    differential, truncated after second order: enough for a method of order four.
    """
    a, b, c = turned
    x, y, z = spin
    u, v, w = b * z - c * y, c * x - a * z, a * y - b * x
    twelfth = 1.0 / 12.0
    return (
        x + 0.5 * u + twelfth * (b * w - c * v),
        y + 0.5 * v + twelfth * (c * u - a * w),
        z + 0.5 * w + twelfth * (a * v - b * u),
    )


_ROOT = sqrt(6.0)
_PLACES = ((4.0 - _ROOT) / 10.0, (4.0 + _ROOT) / 10.0, 1.0)
"""Nodes, as shares of the step."""
_COEFFICIENTS = np.array(
    (
        ((88 - 7 * _ROOT) / 360, (296 - 169 * _ROOT) / 1800, (-2 + 3 * _ROOT) / 225),
        ((296 + 169 * _ROOT) / 1800, (88 + 7 * _ROOT) / 360, (-2 - 3 * _ROOT) / 225),
        ((16 - _ROOT) / 36, (16 + _ROOT) / 36, 1 / 9),
    )
)
"""Coefficients A of the accelerations at the nodes (columns) in the velocities there (rows)."""
IMPLICIT_WEIGHTS = _COEFFICIENTS[-1]
"""Quadrature weights of the three nodes."""
_PASSES = 30
"""Largest number of iterations; 3 or 4 reach rounding."""
_SETTLED = 2.0 * EPSILON
"""Iterations end at changes of the increments below this share of 1 + the largest rate."""
_NEARLY = 1e-10
"""The same for changes that do not get smaller."""


class StiffForces(Protocol):
    """Forces that are stiff in the velocities, evaluated at the nodes of an implicit step."""

    def corrections(self, step: ImplicitStep, accelerations: FloatArray) -> FloatArray | None:
        """Changes of the accelerations that solve the part of these forces, (3, nv); None where there is no solution.

        Args:
            step: The step.
            accelerations: Accelerations at the nodes under the forces evaluated there, (3, nv).
        """

    def held(self) -> tuple[FloatArray, FloatArray]:
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
        self.weights, self.start_rates, self.node = duration_s * _COEFFICIENTS, start_rates, 0
        self.stiff: StiffForces | None = None


def integrate_implicitly(stepper: ForcedStepper, data: Any, duration_s: float) -> bool:
    """Set the state at the end of a step; returns whether its equations were solved.

    Args:
        stepper: Evaluates the forces; at the start of the step.
        data: MuJoCo data.
        duration_s: Duration of the step.
    """
    step = stepper.stage = ImplicitStep(duration_s, stepper.start_rates)
    start_s, nodes = data.time, len(_PLACES)
    slopes, change, solved = np.array((np.stack((data.qvel, data.qacc)),) * nodes), np.inf, True
    actuators = _Actuators(stepper, step, duration_s)
    if stepper.stiff is not None:
        slopes[:, 1] = 0.0  # the accelerations at the start of a transient are none that last
    try:
        for again in range(_PASSES):
            actuators.begin_pass()
            before, increments = slopes, np.tensordot(step.weights, slopes, 1)
            slopes = np.empty_like(before)
            for step.node in range(nodes):
                stepper.repeats = step.node - nodes if again else 0
                data.time = start_s + duration_s * _PLACES[step.node]
                stepper.move_by(increments[step.node])
                actuators.move_to_node()
                stepper.refresh()
                slopes[step.node, 1] = data.qacc
                actuators.note_node()
            found = step.stiff.corrections(step, slopes[:, 1]) if step.stiff is not None else 0.0
            solved = found is not None
            if found is not None:
                slopes[:, 1] += found
            slopes[:, 1] = actuators.corrected(before[:, 1], slopes[:, 1])
            slopes[:, 0] = step.start_rates + step.weights.dot(slopes[:, 1])
            _turn_spins(stepper, slopes, increments)
            moved = np.tensordot(step.weights, slopes - before, 1)
            last, change = change, float(np.abs(moved).max() / (1.0 + np.abs(slopes[:, 0]).max()))
            change = max(change, actuators.change)
            if change <= _SETTLED or (change <= _NEARLY and change >= 0.5 * last):  # rounding
                break
        else:
            solved = False
    finally:
        stepper.stage, stepper.repeats = None, 0
    stepper.move_by(np.tensordot(step.weights[-1], slopes, 1))
    actuators.end()
    return solved


class _Actuators:
    """Actuators in the nodes of an implicit step: their work, activations and stiffness.

    Attributes:
        change: By how much increments of activations have changed in the last pass.
    """

    def __init__(self, stepper: ForcedStepper, step: ImplicitStep, duration_s: float) -> None:
        """Begin a step."""
        self._power, self._stiff, self._activations = stepper.power, stepper.stiff, stepper.activations
        self._step, self._duration_s, self.change = step, duration_s, 0.0
        self._holds = False
        if self._activations is not None:
            self._activations.begin(duration_s, len(_PLACES))
        if self._stiff is not None:
            self._stiff.update()
            self._acting = np.array((self._stiff.acting(),) * len(_PLACES))

    def begin_pass(self) -> None:
        """Begin a pass over the nodes."""
        self.change = 0.0
        if self._power is not None:
            self._power.begin()

    def move_to_node(self) -> None:
        """Set the activations at the node."""
        if self._activations is not None:
            node = self._step.node
            self._activations.move_to_node(self._duration_s * _PLACES[node], self._step.weights[node])

    def note_node(self) -> None:
        """Note power, rates of activations and limits at the node, forces current."""
        node = self._step.node
        if self._power is not None:
            self._power.add(IMPLICIT_WEIGHTS[node])
        if self._activations is not None:
            self.change = max(self.change, self._duration_s * self._activations.set_node(node))
        if self._stiff is not None:
            self._acting[node] = self._stiff.acting()

    def corrected(self, before: FloatArray, accelerations: FloatArray) -> FloatArray:
        """Accelerations at the nodes after Newton's correction of those before, (3, nv)."""
        if self._stiff is None:
            return accelerations
        if self._step.stiff is not None and not self._holds:
            self._stiff.hold(*self._step.stiff.held())
            self._holds = True
        return before + self._stiff.correction(self._step.weights, accelerations - before, self._acting)

    def end(self) -> None:
        """End the step."""
        if self._power is not None:
            self._power.end(self._duration_s)
        if self._activations is not None:
            self._activations.move_to_node(self._duration_s, self._step.weights[-1])


def _turn_spins(stepper: ForcedStepper, slopes: FloatArray, increments: FloatArray) -> None:
    """Replace angular velocities in the rates at the nodes by rates of rotation vectors, (3, 2, nv) each."""
    for slope, increment in zip(slopes, increments, strict=True):
        turned, spins = increment[0].tolist(), slope[0].tolist()
        for part in stepper.rotations:
            spins[part] = rotation_vector_rate(turned[part], spins[part])
        slope[0] = spins
