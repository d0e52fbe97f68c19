"""Integration steps without applied forces, with a bound on how far anything can have moved."""

from __future__ import annotations

import math
from typing import Any

import mujoco

from ffsm_mj.arrays import FloatArray

WHOLE_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
"""State that MuJoCo needs to repeat a step bit by bit. A plain int, as enum lookup in the bindings is slow."""
BOUND_MARGIN = 1.1
"""Safety factor: the energy inside a step may exceed that at its ends."""


class FreeStepper:
    """Integrates steps and accumulates the motion bound, the integral of sqrt(2 T) dt.

    With kinetic energy T, the speed of any point is at most k sqrt(2 T), where k depends on masses and dimensions only. The
    integral therefore bounds every displacement, and event detection is skipped until it exceeds ``event_bound``.

    Attributes:
        energy: Kinetic energy at the state in ``data``, J.
        motion_bound: Sum of margin * sqrt(2 T) * dt since ``clear``, in m kg^1/2.
        last_increment: Contribution of the last step.
        event_bound: Motion bound below which no event is possible.
    """

    def __init__(self, model: Any, data: Any, state: FloatArray, momentum: FloatArray) -> None:
        """Start at the state in ``data`` (derived quantities current).

        Args:
            model: MuJoCo model, with RK4.
            data: MuJoCo data.
            state: Array for the state at the start of each step, of the size of WHOLE_STATE.
            momentum: Array for M qdot, (nv,).
        """
        self._model, self._data, self._state = model, data, state
        self._momentum, self._rates = momentum, data.qvel
        self.clear(math.inf)

    def clear(self, event_bound: float) -> None:
        """Reset the motion bound at the state in ``data``."""
        self.motion_bound, self.last_increment, self.event_bound = 0.0, 0.0, event_bound
        self.energy = self._energy()

    def step(self, duration_s: float) -> bool:
        """Integrate for the model's time step and update derived quantities; returns whether no event is possible."""
        mujoco.mj_getState(self._model, self._data, self._state, WHOLE_STATE)
        mujoco.mj_step(self._model, self._data)
        mujoco.mj_forward(self._model, self._data)
        return self.account(duration_s)

    def account(self, duration_s: float) -> bool:
        """Add a finished step to the motion bound; derived quantities must be current."""
        before, self.energy = self.energy, self._energy()
        # Not max(), which would hide a NaN; abs(), since the rounding of a body at rest may be negative.
        self.last_increment = (
            BOUND_MARGIN * duration_s * math.sqrt(2.0 * abs(before if before > self.energy else self.energy))
        )
        self.motion_bound += self.last_increment
        return self.motion_bound < self.event_bound

    def _energy(self) -> float:
        mujoco.mj_mulM(self._model, self._data, self._momentum, self._rates)
        return 0.5 * float(self._momentum.dot(self._rates))
