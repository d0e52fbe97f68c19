"""Runge-Kutta steps of order four under state-dependent forces, which are evaluated in each stage.

A step is explicit (the classical method), or implicit where a force is stiff in the velocities (:mod:`.implicit_stages`).

MuJoCo's callbacks would be evaluated in each stage too, but are global to the process. Rotations are integrated as the
rotation vector since the start of the step (Runge-Kutta-Munthe-Kaas), which keeps the order on the rotation group.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.free_stepper import WHOLE_STATE, FreeStepper
from ffsm_mj.dynamics.implicit_stages import COEFFICIENTS, GAMMA, IMPLICIT_WEIGHTS, StageVelocity
from ffsm_mj.dynamics.rigid_body import rotation_dofs
from ffsm_mj.tolerances import EPSILON

Push = Callable[[Any], None]
"""Adds generalised forces to ``data.qfrc_applied``; positions and velocities in ``data`` are current."""

WEIGHTS = np.array((1.0, 2.0, 2.0, 1.0)) / 6.0
"""Quadrature weights of the four stages."""
_AFTER_VELOCITIES = int(mujoco.mjtStage.mjSTAGE_VEL)
_PASSES = 30
"""Largest number of iterations of an implicit stage; 3 or 4 reach rounding."""
_SETTLED = 2.0 * EPSILON
"""Iterations end at changes of the increments below this share of 1 + the largest rate."""
_NEARLY = 1e-10
"""The same for changes that do not get smaller."""


class ForcedStepper(FreeStepper):
    """Integrates steps under state-dependent applied forces.

    Attributes:
        implicit: Whether steps are implicit. Whoever sets it keeps it for all queries of one step.
        stage: Velocity of the current stage as a function of its accelerations; None in an explicit stage, and at the ends
            of a step.
        repeats: Whether the stage is evaluated again, in the iterations of an implicit one.
    """

    def __init__(
        self,
        model: Any,
        data: Any,
        state: FloatArray,
        momentum: FloatArray,
        pushes: Sequence[Push],
        follow: Callable[[], None],
    ) -> None:
        """See :class:`~ffsm_mj.dynamics.free_stepper.FreeStepper`.

        Args:
            model: MuJoCo model.
            data: Its data.
            state: Array for the state at the start of each step.
            momentum: Array for M qdot, (nv,).
            pushes: Applied forces, evaluated in every stage in this order.
            follow: Called before them: transfers the stage's state to the logged system.
        """
        super().__init__(model, data, state, momentum)
        self.implicit, self.repeats = False, False
        self.stage: StageVelocity | None = None
        self._pushes, self._follow, self._rotations = tuple(pushes), follow, rotation_dofs(model)
        self._qpos, self._accelerations, self._applied = data.qpos, data.qacc, data.qfrc_applied
        self._start_qpos, self._start_qvel = np.empty(model.nq), np.empty(model.nv)
        # For each stage, the rates of the rotation vectors (and other coordinates) and the accelerations.
        self._slopes = np.empty((4, 2, model.nv))
        self._flat_slopes = self._slopes.reshape(4, -1)

    @property
    def weights(self) -> FloatArray:
        """Quadrature weights of the stages of a step."""
        return IMPLICIT_WEIGHTS if self.implicit else WEIGHTS

    def refresh(self) -> None:
        """Update forces and all derived quantities for the state in ``data``."""
        mujoco.mj_fwdPosition(self._model, self._data)
        mujoco.mj_fwdVelocity(self._model, self._data)
        self._update_forces()

    def _update_forces(self) -> None:
        """The same if positions and velocities are current and only efforts may have changed."""
        self._follow()
        self._applied.fill(0.0)
        for push in self._pushes:
            push(self._data)
        mujoco.mj_forwardSkip(self._model, self._data, _AFTER_VELOCITIES, 1)

    def integrate(self, duration_s: float) -> None:
        """Integrate for a time; forces and derived quantities are current at its end."""
        self.refresh()
        self._integrate_step(duration_s)

    def _integrate_step(self, duration_s: float) -> None:
        """The same if forces are current at the start."""
        start_s = self._data.time
        self._start_qpos[:], self._start_qvel[:] = self._qpos, self._rates
        (self._integrate_implicitly if self.implicit else self._integrate_explicitly)(duration_s)
        self._data.time = start_s + duration_s
        self.refresh()

    def _integrate_explicitly(self, duration_s: float) -> None:
        """Set the state at the end of a step, by the classical tableau."""
        h, start_s = duration_s, self._data.time
        first, second, third, last = self._slopes
        first[0], first[1] = self._rates, self._accelerations
        self._data.time = start_s + 0.5 * h
        self._stage(0.5 * h, first, second)
        self._stage(0.5 * h, second, third)
        self._data.time = start_s + h
        self._stage(h, third, last)
        self._set_stage_state(h, WEIGHTS.dot(self._flat_slopes).reshape(2, -1))

    def _integrate_implicitly(self, duration_s: float) -> None:
        """The same by the implicit method."""
        h, start_s = duration_s, self._data.time
        slopes: list[FloatArray] = []
        guess = np.stack((self._rates, self._accelerations))
        for coefficients in COEFFICIENTS:
            given = np.zeros_like(guess)
            for coefficient, slope in zip(coefficients, slopes, strict=True):
                given += h * coefficient * slope
            self._data.time = start_s + h * (GAMMA + sum(coefficients))
            guess = self._implicit_stage(h * GAMMA, given, guess)
            slopes.append(guess)
        self._set_increment(given + h * GAMMA * guess)

    def _implicit_stage(self, step_s: float, given: FloatArray, slope: FloatArray) -> FloatArray:
        """Rates and accelerations of a stage, (2, nv), at the increments ``given`` + ``step_s`` times themselves.

        Args:
            step_s: Duration of the step times the diagonal coefficient, s.
            given: Increments of (rotation vectors and other coordinates, rates) by the previous stages, (2, nv).
            slope: First estimate.
        """
        self.stage = StageVelocity(self._start_qvel + given[1], step_s)
        try:
            change = np.inf
            for _ in range(_PASSES):
                increment = given + step_s * slope
                self._set_increment(increment)
                self.refresh()
                self.repeats = True
                before, slope = (
                    slope,
                    np.stack((self._start_qvel + given[1] + step_s * self._accelerations, self._accelerations)),
                )
                turned, rates = increment[0].tolist(), slope[0].tolist()
                for part in self._rotations:
                    rates[part] = _rotation_vector_rate(turned[part], rates[part])
                slope[0] = rates
                last, change = change, step_s * np.abs(slope - before).max() / (1.0 + np.abs(self._rates).max())
                if change <= _SETTLED or (change <= _NEARLY and change >= 0.5 * last):  # rounding
                    break
        finally:
            self.stage, self.repeats = None, False
        return slope

    def _set_increment(self, increment: FloatArray) -> None:
        """Set the state at increments of (rotation vectors and other coordinates, rates) from the start, (2, nv)."""
        self._qpos[:] = self._start_qpos
        mujoco.mj_integratePos(self._model, self._qpos, increment[0], 1.0)
        self._rates[:] = self._start_qvel + increment[1]

    def step(self, duration_s: float) -> bool:
        """Integrate for a time; returns whether the motion bound excludes any event."""
        mujoco.mj_getState(self._model, self._data, self._state, WHOLE_STATE)
        self._update_forces()
        self._integrate_step(duration_s)
        return self.account(duration_s)

    def _set_stage_state(self, after_s: float, slope: FloatArray) -> None:
        """Set the state reached from the start of the step with constant rates and accelerations, (2, nv)."""
        self._qpos[:] = self._start_qpos
        mujoco.mj_integratePos(self._model, self._qpos, slope[0], after_s)
        self._rates[:] = self._start_qvel + after_s * slope[1]

    def _stage(self, after_s: float, slope: FloatArray, found: FloatArray) -> None:
        """Evaluate one stage: rates and accelerations at the state that given ones lead to, (2, nv) each."""
        self._set_stage_state(after_s, slope)
        self.refresh()
        turned, rates = (after_s * slope[0]).tolist(), self._rates.tolist()
        for part in self._rotations:
            rates[part] = _rotation_vector_rate(turned[part], rates[part])
        found[0], found[1] = rates, self._accelerations


def _rotation_vector_rate(turned: list[float], spin: list[float]) -> tuple[float, float, float]:
    """Rate of the rotation vector t for a body-frame angular velocity w: w + t x w / 2 + t x (t x w) / 12.

    The inverse of the exponential map's differential, truncated after second order: enough for a method of order four.
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


def clear_applied_forces(model: Any, data: Any) -> None:
    """Remove all applied forces, and update derived quantities."""
    data.qfrc_applied.fill(0.0)
    mujoco.mj_forward(model, data)
