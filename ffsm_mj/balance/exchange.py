"""What wrenches between bodies exchange over a (sub-)step: energy and impulse, by subsystem.

By Simpson's rule with a cubic Hermite midpoint, as external forces in the balance: what follows the bodies' motion is then
known to the order of the integrator. A pair of equal and opposite wrenches exchanges nothing within one subsystem.

What is carried is a part of the robot here, for what moves has it so: whoever holds it books all that it gains as given by
the robot. What it gets from fixed bodies is booked to the objects, as from outside, and taken off what the robot gave.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.midpoint import hermite_midpoint
from ffsm_mj.balance.simpson import simpson
from ffsm_mj.balance.wrenches import rates_by_subsystem
from ffsm_mj.model.system import System
from ffsm_mj.records.wrench import Wrench

_NOTHING = np.zeros((2, 6))
_NOTHING.flags.writeable = False


class Exchange(NamedTuple):
    """What contacts did at an event or over a (sub-)step, by subsystem.

    Attributes:
        energy_J: Energy that they gave to (total, robot, objects), (3,).
        impulse: Impulse of the robot on the objects: force part in N s and moment about the world origin in N m s, (6,).
        outside: The same of fixed bodies, on the robot and on the objects, (2, 6): it comes from outside the system.
    """

    energy_J: FloatArray
    impulse: FloatArray
    outside: FloatArray = _NOTHING


class ExchangeIntegrator:
    """Books the wrenches of one contact model over steps."""

    def __init__(self, system: System, data: Any, wrenches: Callable[[Any], Sequence[Wrench]]) -> None:
        """Bind to the system's data, and to what gives the wrenches at a state of it."""
        self._system, self._data, self._wrenches = system, data, wrenches
        self._scratch = mujoco.MjData(system.mj)

    def begin(self, carried: frozenset[int]) -> None:
        """A (sub-)step begins at the state in ``data``, with these bodies of objects as parts of the robot."""
        self._carried = carried
        self._qpos, self._qvel = self._data.qpos.copy(), self._data.qvel.copy()
        self._first = self._rates(self._data)

    def end(self, duration_s: float) -> Exchange:
        """It ends at the state in ``data``."""
        model, data, scratch = self._system.mj, self._data, self._scratch
        middle = hermite_midpoint(model, self._qpos, self._qvel, data.qpos, data.qvel, duration_s)
        scratch.qpos[:], scratch.qvel[:] = middle
        mujoco.mj_fwdPosition(model, scratch)
        mujoco.mj_fwdVelocity(model, scratch)
        done = simpson(self._first, self._rates(scratch), self._rates(data), duration_s)
        return Exchange(done[:3], done[3:9], done[9:].reshape(2, 6))

    def _rates(self, data: Any) -> FloatArray:
        return rates_by_subsystem(self._system, data, self._wrenches(data), self._carried)
