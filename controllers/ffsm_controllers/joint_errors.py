"""Errors of joints as a law reports them: the largest of hinges in rad and the largest of slides in m."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ffsm_mj.controller_protocol import ControllerReport, FloatArray, Signal, Stateful, System

_UNITS = {"hinge": "rad", "slide": "m"}


class JointErrors(Stateful):
    """Largest errors at the last tick and so far.

    Attributes:
        signals: Columns: one for hinges and one for slides, where there are any.
        values: Largest errors at the last tick, in the order of the signals.
    """

    @dataclass
    class State:
        """Largest errors at the last tick and so far, rad and m."""

        values: list[float]
        largest: list[float]

    def __init__(self, system: System, joints: Sequence[str], prefix: str, meaning: str) -> None:
        """Sort the joints.

        Args:
            system: The system.
            joints: Full names.
            prefix: First word of the names of the columns.
            meaning: What an error is, for the descriptions of the columns.
        """
        kinds = np.array([system.joints[name].kind for name in joints])
        units = [unit for kind, unit in _UNITS.items() if kind in kinds]
        self._of_unit = [np.flatnonzero(kinds == kind) for kind in _UNITS if kind in kinds]
        self._units = units
        self.signals = tuple(Signal("controller", f"{prefix}_error_{unit}", unit, meaning) for unit in units)
        self.values = [0.0] * len(units)
        self._largest = [0.0] * len(units)

    def look(self, errors: FloatArray) -> None:
        """Take note of the errors of all joints at a tick, (n,)."""
        sizes = np.abs(errors)
        self.values = [float(sizes[which].max()) for which in self._of_unit]
        self._largest = [max(pair) for pair in zip(self._largest, self.values, strict=True)]

    def report(self) -> ControllerReport:
        """Largest errors so far."""
        return {f"largest_error_{unit}": largest for unit, largest in zip(self._units, self._largest, strict=True)}
