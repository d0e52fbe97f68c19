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
from ffsm_mj.dynamics.implicit_stages import IMPLICIT_WEIGHTS, ImplicitStep, integrate_implicitly
from ffsm_mj.dynamics.rigid_body import rotation_dofs
from ffsm_mj.dynamics.rotation_vector import rotation_vector_rate

Push = Callable[[Any], None]
"""Adds generalised forces to ``data.qfrc_applied``; positions and velocities in ``data`` are current."""

WEIGHTS = np.array((1.0, 2.0, 2.0, 1.0)) / 6.0
"""Quadrature weights of the four stages."""
_AFTER_VELOCITIES = int(mujoco.mjtStage.mjSTAGE_VEL)


class ForcedStepper(FreeStepper):
    """Integrates steps under state-dependent applied forces.

    Attributes:
        implicit: Whether steps are implicit. Whoever sets it keeps it for all queries of one step.
        stage: The implicit step whose nodes are evaluated; None in an explicit stage, and at the ends of a step.
        solved: Whether the equations of the last implicit step were solved; with a shorter step they may be.
        inside: Whether the state is that of an explicit stage inside a step, which is evaluated once and then left.
        repeats: Which of the stages so far, counted from the last one, -1, is evaluated again in the iterations of an
            implicit step; 0 for a stage that is new.
        start_rates: Generalised velocity at the start of the step, (nv,).
        rotations: Degrees of freedom of rotations in space.
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
        self.implicit, self.inside, self.repeats, self.solved = False, False, 0, True
        self.stage: ImplicitStep | None = None
        self._pushes, self._follow, self.rotations = tuple(pushes), follow, rotation_dofs(model)
        self._qpos, self._accelerations, self._applied = data.qpos, data.qacc, data.qfrc_applied
        self._start_qpos, self.start_rates = np.empty(model.nq), np.empty(model.nv)
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
        self._start_qpos[:], self.start_rates[:] = self._qpos, self._rates
        self.solved = True
        if self.implicit:
            self.solved = integrate_implicitly(self, self._data, duration_s)
        else:
            self._integrate_explicitly(duration_s)
        self._data.time = start_s + duration_s
        self.refresh()

    def _integrate_explicitly(self, duration_s: float) -> None:
        """Set the state at the end of a step, by the classical tableau."""
        h, start_s = duration_s, self._data.time
        first, second, third, last = self._slopes
        first[0], first[1] = self._rates, self._accelerations
        self._data.time, self.inside = start_s + 0.5 * h, True
        try:
            self._stage(0.5 * h, first, second)
            self._stage(0.5 * h, second, third)
            self._data.time = start_s + h
            self._stage(h, third, last)
        finally:
            self.inside = False
        self._set_stage_state(h, WEIGHTS.dot(self._flat_slopes).reshape(2, -1))

    def move_by(self, increment: FloatArray) -> None:
        """Set the state at increments of (rotation vectors and other coordinates, rates) from the start, (2, nv)."""
        self._set_stage_state(1.0, increment)

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
        np.multiply(slope[1], after_s, out=self._rates)
        self._rates += self.start_rates

    def _stage(self, after_s: float, slope: FloatArray, found: FloatArray) -> None:
        """Evaluate one stage: rates and accelerations at the state that given ones lead to, (2, nv) each."""
        self._set_stage_state(after_s, slope)
        self.refresh()
        turned, rates = (after_s * slope[0]).tolist(), self._rates.tolist()
        for part in self.rotations:
            rates[part] = rotation_vector_rate(turned[part], rates[part])
        found[0], found[1] = rates, self._accelerations


def clear_applied_forces(model: Any, data: Any) -> None:
    """Remove all applied forces, and update derived quantities."""
    data.qfrc_applied.fill(0.0)
    mujoco.mj_forward(model, data)
