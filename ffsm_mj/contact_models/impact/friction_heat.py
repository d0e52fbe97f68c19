"""Heat of friction since t = 0, at impacts and in persistent contact: a column of the balance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.signals import FRICTION_HEAT, Signal
from ffsm_mj.state import Stateful

_HEAT = Signal(
    "balance",
    FRICTION_HEAT,
    "J",
    "heat of friction since t = 0, of sliding in persistent contact and of impacts. Sliding: the sum of the columns of the "
    "rules. Impacts with friction: kinetic energy lost, less the loss by the work of the normal impulses, which restitution "
    "explains; for several contacts at one instant this split is a convention",
)


class FrictionHeat(Stateful):
    """Sum of the heat of friction of all pairs.

    Attributes:
        total_J: The sum, J, (1,).
        columns: Its column.
    """

    @dataclass
    class State:
        """The sum so far, J, (1,)."""

        total_J: FloatArray

    def __init__(self) -> None:
        """Start without heat."""
        self.total_J = np.zeros(1)
        self.columns = (Columns((_HEAT,), live=self.total_J, resume=self._resume),)

    def _resume(self, logged: FloatArray) -> None:
        self.total_J[:] = logged

    def add(self, heat_J: float) -> None:
        """Add the heat of an impact or of a (sub-)step."""
        self.total_J += heat_J
