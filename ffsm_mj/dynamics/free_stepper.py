"""Steps of free motion, and how far everything can have moved in them."""

from __future__ import annotations

import math
from typing import Any

import mujoco

from ffsm_mj.arrays import FloatArray

WHOLE_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
"""What MuJoCo needs to repeat a step bit by bit. A number: the bindings are slow at looking an enumeration up."""
BOUND_MARGIN = 1.1
"""Energy inside a step may exceed that at its ends."""


class FreeStepper:
    """Integration that keeps account of sqrt(2 T) dt, which bounds the way of any point (times a factor of the robot's).

    Attributes:
        energy: Kinetic energy at the state in ``data``, J.
        way: Sum of margin * sqrt(2 T) * dt since ``clear``, in m kg^1/2.
        last: What the last step added to it.
        horizon: The way that is known to bring no pair into contact.
    """

    def __init__(self, model: Any, data: Any, state: FloatArray, momentum: FloatArray) -> None:
        """Fly from the state in ``data`` (derived quantities current).

        Args:
            model: MuJoCo model, with RK4.
            data: MuJoCo data.
            state: Where the state at the start of each step is kept, of the size of WHOLE_STATE.
            momentum: Where M qdot is kept, (nv,).
        """
        self._model, self._data, self._state = model, data, state
        self._momentum, self._rates = momentum, data.qvel
        self.clear(math.inf)

    def clear(self, horizon: float) -> None:
        """Begin a new account at the state in ``data``."""
        self.way, self.last, self.horizon = 0.0, 0.0, horizon
        self.energy = self._energy()

    def step(self, duration_s: float) -> bool:
        """Integrate for the model's time step, refresh derived quantities; says whether no pair can have touched."""
        mujoco.mj_getState(self._model, self._data, self._state, WHOLE_STATE)
        mujoco.mj_step(self._model, self._data)
        mujoco.mj_forward(self._model, self._data)
        return self.account(duration_s)

    def account(self, duration_s: float) -> bool:
        """Take a step that was made into account; derived quantities are current."""
        before, self.energy = self.energy, self._energy()
        # Not max(), which would hide a NaN; abs(), since the rounding of a body at rest may be negative.
        self.last = BOUND_MARGIN * duration_s * math.sqrt(2.0 * abs(before if before > self.energy else self.energy))
        self.way += self.last
        return self.way < self.horizon

    def _energy(self) -> float:
        mujoco.mj_mulM(self._model, self._data, self._momentum, self._rates)
        return 0.5 * float(self._momentum.dot(self._rates))
