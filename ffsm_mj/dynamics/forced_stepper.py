"""Steps under forces that depend on the state: they are asked for in each stage of a Runge-Kutta step of order four.

MuJoCo would call back in each stage too, but for the whole process; here nothing outside the run knows of it. Rotations are
integrated in the chart of their rotation vector since the start of the step (Munthe-Kaas), which keeps the order.
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
"""Of the stages of a step."""
_AFTER_VELOCITIES = int(mujoco.mjtStage.mjSTAGE_VEL)


class ForcedStepper(FreeStepper):
    """Flight under pushes."""

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
            state: Where the state at the start of each step is kept.
            momentum: Where M qdot is kept, (nv,).
            pushes: Asked in every stage, in this order.
            follow: Called before them: lets others follow the state of the stage.
        """
        super().__init__(model, data, state, momentum)
        self._pushes, self._follow, self._rotations = tuple(pushes), follow, rotation_dofs(model)
        self._qpos, self._accelerations, self._applied = data.qpos, data.qacc, data.qfrc_applied
        self._start_qpos, self._start_qvel = np.empty(model.nq), np.empty(model.nv)
        # Of each stage the rates of the chart and the accelerations.
        self._slopes = np.empty((4, 2, model.nv))
        self._flat_slopes = self._slopes.reshape(4, -1)

    def refresh(self) -> None:
        """Bring forces and all derived quantities up to the state in ``data``."""
        mujoco.mj_fwdPosition(self._model, self._data)
        mujoco.mj_fwdVelocity(self._model, self._data)
        self._force()

    def _force(self) -> None:
        """The same where positions and velocities are current: efforts may have changed."""
        self._follow()
        self._applied.fill(0.0)
        for push in self._pushes:
            push(self._data)
        mujoco.mj_forwardSkip(self._model, self._data, _AFTER_VELOCITIES, 1)

    def integrate(self, duration_s: float) -> None:
        """Move on by a time, forces and derived quantities current at its end."""
        self.refresh()
        self._move(duration_s)

    def _move(self, duration_s: float) -> None:
        """The same from where they are current."""
        data, h = self._data, duration_s
        start_s = data.time
        self._start_qpos[:], self._start_qvel[:] = self._qpos, self._rates
        first, second, third, last = self._slopes
        first[0], first[1] = self._rates, self._accelerations
        self._stage(0.5 * h, first, second)
        self._stage(0.5 * h, second, third)
        self._stage(h, third, last)
        self._go(h, WEIGHTS.dot(self._flat_slopes).reshape(2, -1))
        data.time = start_s + h
        self.refresh()

    def step(self, duration_s: float) -> bool:
        """Integrate for a time; says whether nothing that is watched can have happened."""
        mujoco.mj_getState(self._model, self._data, self._state, WHOLE_STATE)
        self._force()
        self._move(duration_s)
        return self.account(duration_s)

    def _go(self, after_s: float, slope: FloatArray) -> None:
        """To where rates of the chart and accelerations, (2, nv), lead in a time from the start of the step."""
        self._qpos[:] = self._start_qpos
        mujoco.mj_integratePos(self._model, self._qpos, slope[0], after_s)
        self._rates[:] = self._start_qvel + after_s * slope[1]

    def _stage(self, after_s: float, slope: FloatArray, found: FloatArray) -> None:
        """Rates of the chart and accelerations where given ones lead in a time, (2, nv) each."""
        self._go(after_s, slope)
        self.refresh()
        turned, rates = (after_s * slope[0]).tolist(), self._rates.tolist()
        for part in self._rotations:
            rates[part] = _rate_of_chart(turned[part], rates[part])
        found[0], found[1] = rates, self._accelerations


def _rate_of_chart(turned: list[float], spin: list[float]) -> tuple[float, float, float]:
    """Rate of the rotation vector at a spin in body axes: spin + t x spin / 2 + t x (t x spin) / 12, in plain floats."""
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
    """Take all pushes away; derived quantities follow."""
    data.qfrc_applied.fill(0.0)
    mujoco.mj_forward(model, data)
