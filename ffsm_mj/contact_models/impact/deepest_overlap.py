"""Deepest overlap of all pairs, and how far joints moved beyond their limits: columns of the log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ffsm_mj._core.tick import Maxima
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.signals import LIMIT_OVERRUN, OVERLAP, Signal
from ffsm_mj.state import Stateful

_SINCE = "at the ends of the steps and sub-steps since the sample before"
_JOINTS = {"rad": "hinge", "m": "slide"}


class DeepestOverlap(Stateful):
    """Largest overlap of any pair, and overrun of any joint limit, at the ends of (sub-)steps since the sample before.

    Attributes:
        deepest: The numbers since the last sample: of geoms in m, then of hinges in rad and slides in m where there are any.
        columns: Its columns: the overlap, then the overrun of hinges and of slides where there are limited ones.
    """

    @dataclass
    class State:
        """The numbers since the last sample."""

        deepest: FloatArray

    def __init__(self, limits: Sequence[JointLimit] = ()) -> None:
        """Start without overlap.

        Args:
            limits: Limits of the run.
        """
        units = sorted({limit.unit for limit in limits}, reverse=True)
        self._column = {unit: k for k, unit in enumerate(units, start=1)}
        self.deepest, logged = np.zeros((2, 1 + len(units)))
        signals = (
            Signal("balance", OVERLAP, "m", f"deepest overlap of a pair of the contact rules {_SINCE}"),
            *(
                Signal(
                    "balance",
                    LIMIT_OVERRUN[unit],
                    unit,
                    f"largest travel of a {_JOINTS[unit]} joint past its limit {_SINCE}",
                )
                for unit in units
            ),
        )
        self.columns = (Columns(signals, live=logged, on_sample=Maxima(self.deepest, logged)),)

    def add(self, constraint: UnilateralConstraint, gap: float) -> None:
        """Update it with the gap of a pair in m, or of a joint limit in rad or m, at the end of a (sub-)step."""
        place = self._column[constraint.unit] if isinstance(constraint, JointLimit) else 0
        self.deepest[place] = max(self.deepest[place], -gap)
