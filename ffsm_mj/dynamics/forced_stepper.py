"""Runge-Kutta steps of order four under state-dependent forces, which are evaluated in each stage.

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
from ffsm_mj.dynamics.rigid_body import rotation_dofs

Push = Callable[[Any], None]
"""Adds generalised forces to ``data.qfrc_applied``; positions and velocities in ``data`` are current."""

WEIGHTS = np.array((1.0, 2.0, 2.0, 1.0)) / 6.0
"""Quadrature weights of the four stages."""
_AFTER_VELOCITIES = int(mujoco.mjtStage.mjSTAGE_VEL)


class ForcedStepper(FreeStepper):
    """Integrates steps under state-dependent applied forces."""

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
        self._pushes, self._follow, self._rotations = tuple(pushes), follow, rotation_dofs(model)
        self._qpos, self._accelerations, self._applied = data.qpos, data.qacc, data.qfrc_applied
        self._start_qpos, self._start_qvel = np.empty(model.nq), np.empty(model.nv)
        # For each stage, the rates of the rotation vectors (and other coordinates) and the accelerations.
        self._slopes = np.empty((4, 2, model.nv))
        self._flat_slopes = self._slopes.reshape(4, -1)

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
        """The same if forces are current at the start (classical RK4 tableau)."""
        data, h = self._data, duration_s
        start_s = data.time
        self._start_qpos[:], self._start_qvel[:] = self._qpos, self._rates
        first, second, third, last = self._slopes
        first[0], first[1] = self._rates, self._accelerations
        self._stage(0.5 * h, first, second)
        self._stage(0.5 * h, second, third)
        self._stage(h, third, last)
        self._set_stage_state(h, WEIGHTS.dot(self._flat_slopes).reshape(2, -1))
        data.time = start_s + h
        self.refresh()

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
