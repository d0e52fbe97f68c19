"""What an independent check finds: its worst residual, with the scale of the numbers that cancel in it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Finding:
    """Worst residual of one check over a run.

    Attributes:
        name: Name of the check.
        component: Where the residual is: a sensor, a grasp, an impact.
        residual: Its magnitude; infinite if a number is none.
        scale: Largest magnitude of the numbers that cancel in it, in the same unit.
        time_s: Its time.
        unit: Unit of both.
    """

    name: str
    component: str
    residual: float
    scale: float
    time_s: float
    unit: str


class Worst:
    """Keeps the residual that is largest relative to 1 + its scale.

    Attributes:
        finding: It; None before the first one.
    """

    def __init__(self, name: str) -> None:
        """Start without residuals of a check."""
        self._name, self._share = name, -1.0
        self.finding: Finding | None = None

    def add(self, component: str, residual: Any, scale: Any, time_s: float, unit: str) -> None:
        """Process the residual of a vector or a number, of the same unit in all its components.

        Args:
            component: Where it is.
            residual: Numbers that should be zero.
            scale: Numbers that cancel in them.
            time_s: Time.
            unit: Unit.
        """
        size, of = (float(np.max(np.abs(each), initial=0.0)) for each in (residual, scale))
        size, of = (size if math.isfinite(size) else math.inf), (of if math.isfinite(of) else 0.0)
        if (share := size / (1.0 + of)) > self._share:
            self._share = share
            self.finding = Finding(self._name, component, size, of, time_s, unit)

    @property
    def found(self) -> list[Finding]:
        """The finding as a list; empty if there was nothing to check."""
        return [] if self.finding is None else [self.finding]
